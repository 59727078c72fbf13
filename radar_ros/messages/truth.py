"""Truth to and from ROS messages."""

from __future__ import annotations

from typing import Any, Final

import handwave.msg
import numpy as np

from radar_core import GESTURES
from radar_ros.messages.convert import from_time, header, pack_all, to_time, unpack_all
from radar_sim.truth import Truth

_HANDS: Final = ("hand_position", "hand_velocity", "other_hand_position", "other_hand_velocity")
_PLACES: Final = dict.fromkeys(("position", "velocity", *_HANDS), "d") | {"scatterer_position": "f"}
_LISTS: Final = {"person_id": "I", "gesture": "B", "gesture_index": "I", "scatterer_owner": "i", "scatterer_rcs": "f"}


def truth_to_msg(truth: Truth) -> handwave.msg.Truth:
    """Put the truth of one frame into a message."""
    return handwave.msg.Truth(
        header=header(truth.stamp_ns, truth.frame_id),
        sequence=truth.sequence,
        walking=truth.walking.tolist(),
        drawing=truth.drawing.tolist(),
        gesture_start=[to_time(stamp) for stamp in truth.gesture_start_ns.tolist()],
        gesture_end=[to_time(stamp) for stamp in truth.gesture_end_ns.tolist()],
        labels=[] if truth.labels == GESTURES else list(truth.labels),
        **pack_all(truth, _PLACES | _LISTS),
    )


def truth_from_msg(msg: Any) -> Truth:
    """Take the truth of one frame out of a message."""
    return Truth(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        walking=np.array(msg.walking, bool),
        drawing=np.array(msg.drawing, bool),
        gesture_start_ns=np.array([from_time(time) for time in msg.gesture_start], np.int64),
        gesture_end_ns=np.array([from_time(time) for time in msg.gesture_end], np.int64),
        **{name: values.reshape(-1, 3) for name, values in unpack_all(msg, _PLACES).items()},
        **unpack_all(msg, _LISTS),
        labels=tuple(msg.labels) or GESTURES,
    )
