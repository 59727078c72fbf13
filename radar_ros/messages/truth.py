"""Truth to and from ROS messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from handwave.msg import Truth as TruthMsg

from radar_ros.messages.convert import from_time, header, pack, to_time, unpack
from radar_sim.truth import Truth


def truth_to_msg(truth: Truth) -> TruthMsg:
    """Put the truth of one frame into a message."""
    return TruthMsg(
        header=header(truth.stamp_ns, truth.frame_id),
        sequence=truth.sequence,
        person_id=pack(truth.person_id, "I"),
        position=pack(truth.position, "d"),
        velocity=pack(truth.velocity, "d"),
        hand_position=pack(truth.hand_position, "d"),
        hand_velocity=pack(truth.hand_velocity, "d"),
        gesture=pack(truth.gesture, "B"),
        gesture_index=pack(truth.gesture_index, "I"),
        walking=truth.walking.tolist(),
        drawing=truth.drawing.tolist(),
        gesture_start=[to_time(stamp) for stamp in truth.gesture_start_ns.tolist()],
        gesture_end=[to_time(stamp) for stamp in truth.gesture_end_ns.tolist()],
        other_hand_position=pack(truth.other_hand_position, "d"),
        other_hand_velocity=pack(truth.other_hand_velocity, "d"),
        scatterer_position=pack(truth.scatterer_position, "f"),
        scatterer_owner=pack(truth.scatterer_owner, "i"),
        scatterer_rcs=pack(truth.scatterer_rcs, "f"),
    )


def truth_from_msg(msg: Any) -> Truth:
    """Take the truth of one frame out of a message."""
    return Truth(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        person_id=unpack(msg.person_id, np.uint32),
        position=unpack(msg.position, np.float64).reshape(-1, 3),
        velocity=unpack(msg.velocity, np.float64).reshape(-1, 3),
        hand_position=unpack(msg.hand_position, np.float64).reshape(-1, 3),
        hand_velocity=unpack(msg.hand_velocity, np.float64).reshape(-1, 3),
        gesture=np.array(msg.gesture, np.uint8)
        if not isinstance(msg.gesture, (bytes, bytearray))
        else np.frombuffer(msg.gesture, np.uint8).copy(),
        gesture_index=unpack(msg.gesture_index, np.uint32),
        walking=np.array(msg.walking, bool),
        drawing=np.array(msg.drawing, bool),
        gesture_start_ns=np.array([from_time(time) for time in msg.gesture_start], np.int64),
        gesture_end_ns=np.array([from_time(time) for time in msg.gesture_end], np.int64),
        other_hand_position=unpack(msg.other_hand_position, np.float64).reshape(-1, 3),
        other_hand_velocity=unpack(msg.other_hand_velocity, np.float64).reshape(-1, 3),
        scatterer_position=unpack(msg.scatterer_position, np.float32).reshape(-1, 3),
        scatterer_owner=unpack(msg.scatterer_owner, np.int32),
        scatterer_rcs=unpack(msg.scatterer_rcs, np.float32),
    )
