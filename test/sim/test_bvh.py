"""Motion captures: what a BVH file says is what the skeleton does, whatever its channels, units and rest pose; what is wrong is named."""

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_sim.bodies.base import BONES
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.motions.bvh import load_bvh
from radar_sim.motions.capture import BLEND, JOINTS, Capture
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Person, Play, Variation, Walk

FILE = Path(__file__).parent / "data" / "turn_and_raise.bvh"
PERSON = Person(position=(2.5, 0.0), heading=0.0, variation=Variation(sway=0.0))
SKELETON = Skeleton(Subject.of(PERSON))
# name, parent, offset to the left, up, forward in CMU's units (1 / 0.45 inches): our own numbers, CMU's names and order
TREE = (
    ("Hips", None, (0, 0, 0)),
    ("LHipJoint", "Hips", (0, 0, 0)),
    ("LeftUpLeg", "LHipJoint", (1.5, -1.6, 0.6)),
    ("LeftLeg", "LeftUpLeg", (0, -7.2, 0)),
    ("LeftFoot", "LeftLeg", (0, -7.4, 0)),
    ("LeftToeBase", "LeftFoot", (0, -0.9, 2.3)),
    ("RHipJoint", "Hips", (0, 0, 0)),
    ("RightUpLeg", "RHipJoint", (-1.5, -1.6, 0.6)),
    ("RightLeg", "RightUpLeg", (0, -7.2, 0)),
    ("RightFoot", "RightLeg", (0, -7.4, 0)),
    ("RightToeBase", "RightFoot", (0, -0.9, 2.3)),
    ("LowerBack", "Hips", (0, 0, 0)),
    ("Spine", "LowerBack", (0, 2.1, 0)),
    ("Spine1", "Spine", (0, 2.1, 0)),
    ("Neck", "Spine1", (0, 2.1, 0)),
    ("Neck1", "Neck", (0, 1.6, 0.2)),
    ("Head", "Neck1", (0, 1.7, 0)),
    ("LeftShoulder", "Spine1", (0, 0, 0)),
    ("LeftArm", "LeftShoulder", (3.4, 1.5, -0.3)),
    ("LeftForeArm", "LeftArm", (5.2, 0, 0)),
    ("LeftHand", "LeftForeArm", (3.4, 0, 0)),
    ("LeftFingerBase", "LeftHand", (0.7, 0, 0)),
    ("RightShoulder", "Spine1", (0, 0, 0)),
    ("RightArm", "RightShoulder", (-3.4, 1.5, -0.3)),
    ("RightForeArm", "RightArm", (-5.2, 0, 0)),
    ("RightHand", "RightForeArm", (-3.4, 0, 0)),
    ("RightFingerBase", "RightHand", (-0.7, 0, 0)),
)
TIPS = {"LeftToeBase": (0, 0, 1.1), "RightToeBase": (0, 0, 1.1), "Head": (0, 1.6, 0)}
TIPS |= {f"{side}FingerBase": (sign * 0.6, 0, 0) for side, sign in (("Left", 1), ("Right", -1))}
TIPS |= {f"{side}ForeArm": (sign * 3.4, 0, 0) for side, sign in (("Left", 1), ("Right", -1))}  # of a file without hands
NAMES = [name for name, _, _ in TREE]
UP = 16.9  # of the hips, legs straight: 1.6 + 7.2 + 7.4 + the ankle's height
HANGING = {"LeftArm": (-80.0, 0.0, 0.0), "RightArm": (80.0, 0.0, 0.0)}


def write(path: Path, frames, *, interval=0.05, order="Zrotation Yrotation Xrotation", scale=1.0, leave=()) -> Path:
    """Write a file in CMU's manner; each frame is (root, {joint: angles in the order of the channels} [deg])."""
    lines = ["HIERARCHY"]

    def joint(name: str, depth: int) -> None:
        pad, parent, offset = "\t" * depth, *next((p, o) for n, p, o in TREE if n == name)
        lines.append(f"{pad}{'ROOT' if parent is None else 'JOINT'} {name}")
        lines.append(f"{pad}{{")
        lines.append(f"{pad}\tOFFSET " + " ".join(f"{scale * v:.5f}" for v in offset))
        root = "Xposition Yposition Zposition " if parent is None else ""
        lines.append(f"{pad}\tCHANNELS {6 if root else 3} {root}{order}")
        children = [n for n, p, _ in TREE if p == name and n not in leave]
        for child in children:
            joint(child, depth + 1)
        if not children:
            tip = " ".join(f"{scale * v:.5f}" for v in TIPS.get(name, (0, 0, 0)))
            lines.extend([f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET {tip}", f"{pad}\t}}"])
        lines.append(f"{pad}}}")

    joint("Hips", 0)
    lines += ["MOTION", f"Frames: {len(frames)}", f"Frame Time: {interval:.6f}"]
    for root, angles in frames:
        values = [scale * v for v in root]
        for name in NAMES:
            if name not in leave:
                values += angles.get(name, (0.0, 0.0, 0.0))
        lines.append(" ".join(f"{v:.4f}" for v in values))
    path.write_text("\n".join(lines) + "\n")
    return path


def turn_and_raise() -> list:
    """Two seconds: goes 1.5 m forward, turns a quarter to the left while going, and raises the right arm from the side over the front."""
    frames = []
    for k in range(41):
        u = k / 40
        smooth = u * u * (3 - 2 * u)
        # a quarter circle: forward is +Z at first, then +X, the left
        r = 20.0 * (2 / math.pi)
        angle = math.pi / 2 * smooth
        root = (r * (1 - math.cos(angle)), UP, r * math.sin(angle))
        frames.append((root, HANGING | {"Hips": (0.0, 90.0 * smooth, 0.0), "RightArm": (80.0, 120.0 * smooth, 0.0)}))
    return frames


def play(path, time, **more):
    """Pose in the middle of a file that is played for long: 10 s of one frame."""
    timeline = Timeline(Person(**{"position": (2.5, 0.0), "heading": 0.0, "variation": Variation(sway=0.0)} | more), 0)
    return SKELETON.pose(timeline.posture(np.atleast_1d(time)))


def held(tmp_path, angles, **how) -> Path:
    """A file that holds one attitude for two seconds."""
    return write(tmp_path / "held.bvh", [((0.0, UP, 0.0), angles)] * 41, **how)


def direction(pose, start: str, end: str):
    step = pose.joint[0, BONES.index(end)] - pose.joint[0, BONES.index(start)]
    return step / np.linalg.norm(step)


def test_the_example_is_what_this_file_writes(tmp_path):
    """The file beside the tests is made by the writer here; it documents what we read."""
    assert FILE.read_text() == write(tmp_path / "x.bvh", turn_and_raise()).read_text()


def test_a_t_pose_is_a_t_pose(tmp_path):
    """Zero rotations: arms level to the sides, legs straight down, feet on the floor, facing the person's heading."""
    pose = play(None, 1.0, script=(Action(play=Play(file=str(held(tmp_path, {})))),))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for a, b in (("upperarm", "lowerarm"), ("lowerarm", "hand")):
            np.testing.assert_allclose(direction(pose, f"{a}_{side}", f"{b}_{side}"), (0.0, sign, 0.0), atol=1e-6)
        for a, b in (("thigh", "calf"), ("calf", "foot")):
            np.testing.assert_allclose(direction(pose, f"{a}_{side}", f"{b}_{side}"), (0.0, 0.0, -1.0), atol=1e-6)
        ankle, ball = f"foot_{side}", f"ball_{side}"
        assert pose.joint[0, BONES.index(ankle), 2] == pytest.approx(SKELETON.subject.joint[BONES.index(ankle), 2], abs=1e-6)
        assert direction(pose, ankle, ball)[0] > 0.8
    np.testing.assert_allclose(pose.joint[0, 0, :2], (2.5, 0.0), atol=1e-9)
    assert pose.joint[0, BONES.index("head"), 2] > 1.5


def forward(bvh, frame: int):
    """Joints of a file by the textbook's recursion: place = parent's place + parent's rotation @ offset."""
    place, turn = {}, {}
    for i, joint in enumerate(bvh.joints):
        above = np.eye(3) if joint.parent < 0 else turn[joint.parent]
        base = bvh.root[frame] if joint.parent < 0 else place[joint.parent] + above @ joint.offset
        place[i], turn[i] = base, above @ bvh.rotation[frame, i]
    return {joint.name: place[i] for i, joint in enumerate(bvh.joints)}


def test_bones_point_where_the_capture_says(tmp_path):
    """Random attitudes: every limb of ours is parallel to the file's, our x being its Z, our y its X, our z its Y."""
    rng = np.random.default_rng(5)
    for _ in range(5):
        angles = {name: tuple(rng.uniform(-50, 50, 3)) for name in NAMES if name != "Hips"}
        path = held(tmp_path, angles)
        theirs, pose = forward(load_bvh(path), 0), play(None, 1.0, script=(Action(play=Play(file=str(path))),))
        pairs = [(f"{a}_{s}", f"{b}_{s}") for s in "lr" for a, b in itertools.pairwise(("upperarm", "lowerarm", "hand"))]
        pairs += [(f"{a}_{s}", f"{b}_{s}") for s in "lr" for a, b in itertools.pairwise(("thigh", "calf", "foot", "ball"))]
        pairs += [("spine_02", "spine_03"), ("spine_03", "neck_01")]
        for a, b in pairs:
            step = theirs[JOINTS[b]] - theirs[JOINTS[a]]
            wanted = np.array([step[2], step[0], step[1]]) / np.linalg.norm(step)
            np.testing.assert_allclose(direction(pose, a, b), wanted, atol=1e-5)


def test_order_of_channels_and_units_do_not_matter(tmp_path):
    """One axis at a time any order says the same; centimetres or inches, the legs are the person's."""
    frames = turn_and_raise()
    one = load_bvh(write(tmp_path / "a.bvh", frames))
    turned = [(root, {n: tuple(reversed(a)) for n, a in angles.items() if n != "RightArm"}) for root, angles in frames]
    for (_, angles), (_, before) in zip(turned, frames, strict=True):
        angles["RightArm"] = (0.0, 0.0, before["RightArm"][0])
    plain = [(root, angles | {"RightArm": (angles["RightArm"][0], 0.0, 0.0)}) for root, angles in frames]
    straight = load_bvh(write(tmp_path / "b.bvh", plain))
    other = load_bvh(write(tmp_path / "c.bvh", turned, order="Xrotation Yrotation Zrotation"))
    np.testing.assert_allclose(straight.rotation, other.rotation, atol=1e-12)
    small, large = (Capture(b, SKELETON.subject) for b in (one, load_bvh(write(tmp_path / "d.bvh", frames, scale=5.6444))))
    np.testing.assert_allclose(small.travel, large.travel, atol=1e-4)  # the files have four digits
    np.testing.assert_allclose(small.height, large.height, atol=1e-4)


def test_euler_angles_are_applied_in_the_files_order(tmp_path):
    """Z Y X in the file means R = Rz Ry Rx: the last channel turns first."""
    bvh = load_bvh(held(tmp_path, {"Hips": (90.0, 90.0, 0.0)}))
    np.testing.assert_allclose(
        bvh.rotation[0, 0], np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12
    )


def test_the_person_travels(tmp_path):
    """A quarter circle to the left in the person's size; on the spot without travel; a place and heading of one's own to start from."""
    duration = 2.0
    bvh = load_bvh(FILE)
    leg = sum(
        math.dist(SKELETON.subject.joint[BONES.index(a)], SKELETON.subject.joint[BONES.index(b)])
        for a, b in (("thigh_l", "calf_l"), ("calf_l", "foot_l"))
    )
    radius = 20.0 * (2 / math.pi) * leg / 14.6
    capture = Capture(bvh, SKELETON.subject)
    np.testing.assert_allclose(capture.travel[-1], (radius, radius), atol=1e-3)
    assert capture.yaw[-1] - capture.yaw[0] == pytest.approx(math.pi / 2, abs=1e-6)
    assert np.abs(capture.height).max() < 0.05  # legs stay straight; our hips are not as wide as theirs
    for travel in (True, False):
        timeline = Timeline(Person(position=(2.5, 0.0), heading=1.0, script=(Action(play=Play(file=str(FILE), travel=travel)),)), 0)
        posture = timeline.posture(np.array([0.0, duration - 1e-6]))
        # coming in and going out softly, the person goes a little less far than the capture
        gone = float(np.hypot(*(posture.place[1] - posture.place[0])))
        assert gone == pytest.approx(radius * math.sqrt(2), rel=0.25) if travel else gone == 0.0
        assert posture.heading[0] == pytest.approx(1.0)
        assert posture.heading[1] - posture.heading[0] == pytest.approx(math.pi / 2, rel=0.25)
        if travel:  # forward and to the left of where the person faced
            along = np.arctan2(*(posture.place[1] - posture.place[0])[::-1])
            assert 1.2 < along < 2.2


def test_between_frames_bones_turn_evenly(tmp_path):
    """Half-way between two frames a bone has made half of the turn, by the shorter way."""
    frames = [((0.0, UP, 0.0), {"LeftArm": (angle, 0.0, 0.0)}) for angle in (0.0, -60.0, 170.0)]
    capture = Capture(load_bvh(write(tmp_path / "x.bvh", frames, interval=0.1)), SKELETON.subject)
    bone = BONES.index("upperarm_l")
    start, quarter, end = (capture.rotation(np.array([t]))[0, bone] for t in (0.0, 0.025, 0.1))
    assert _angle(start, quarter) == pytest.approx(15.0, abs=1e-6)
    assert _angle(start, end) == pytest.approx(60.0, abs=1e-3)
    middle = capture.rotation(np.array([0.15]))[0, bone]
    assert _angle(end, middle) == pytest.approx(65.0, abs=1e-3)  # from -60 to 170 by -130
    np.testing.assert_allclose(capture.rotation(np.array([-1.0, 9.0])), capture.rotation(np.array([0.0, 0.2])), atol=1e-12)


def _angle(a, b) -> float:
    return math.degrees(math.acos(min(1.0, (np.trace(a.T @ b) - 1) / 2)))


def test_a_capture_comes_in_and_goes_out_softly():
    """Joints do not jump where a capture begins and ends, and afterwards the person faces as before and walks."""
    script = (Action(stand=0.5), Action(play=Play(file=str(FILE))), Action(stand=1.0), Action(walk=Walk(to=(3.0, 0.0))))
    timeline = Timeline(Person(position=(1.5, 0.0), heading=0.5, script=script), 2)
    kinds = [s.kind for s in timeline.segments]
    assert kinds[:4] == ["stand", "play", "turn", "stand"]
    times = np.arange(0.0, timeline.end, 0.005)
    # three at a time as in a radar's frames, across every border too
    joint = np.concatenate([SKELETON.pose(timeline.posture(times[k : k + 3])).joint for k in range(0, len(times) - 3, 3)])
    assert np.linalg.norm(np.diff(joint, axis=0), axis=-1).max() / 0.005 < 5.0
    assert math.cos(timeline.posture(np.array([timeline.segments[3].start])).heading[0] - 0.5) == pytest.approx(1.0)
    inside = timeline.posture(np.array([0.5 + BLEND + 0.2]))
    assert inside.rotation is not None
    assert timeline.posture(np.array([0.2])).rotation is None


def test_a_part_of_a_capture():
    """Start and duration choose a part; one that is not there is refused."""
    timeline = Timeline(Person(heading=0.0, script=(Action(play=Play(file=str(FILE), start=0.5, duration=1.0)),)), 0)
    assert timeline.segments[0].end == pytest.approx(1.0)
    for part in ({"start": 2.5}, {"start": 1.0, "duration": 1.5}):
        with pytest.raises(ConfigError, match=r"step 1 of the script.*2 s long; choose a part"):
            Timeline(Person(script=(Action(play=Play(file=str(FILE), **part)),)), 0)
    with pytest.raises(ConfigError, match="while sitting; rise first"):
        Timeline(Person(script=(Action(sit=1.0), Action(play=Play(file=str(FILE))))), 0)


def test_joints_that_may_be_missing(tmp_path):
    """Without hands, toes, neck and shoulders the bones go with the ones before."""
    leave = ("LeftFingerBase", "RightFingerBase", "LeftHand", "RightHand", "LeftToeBase", "RightToeBase", "Neck1", "Head", "Neck")
    path = held(tmp_path, HANGING, leave=leave)
    pose = play(None, 1.0, script=(Action(play=Play(file=str(path))),))
    assert direction(pose, "lowerarm_l", "hand_l")[2] < -0.9
    assert pose.hand[0, 0, 2] < 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.replace("HIERARCHY", "Hierarchy"), "line 1: the first word"),
        (lambda s: "", "line 0: the file ends here"),
        (lambda s: s[: len(s) // 8], "the file ends here|is not what a skeleton|should be"),
        (lambda s: s.replace("\tOFFSET 0.00000 -7.20000 0.00000", "\tOFFSET 0.0 x 0.0", 1), "line 16: OFFSET.*'x'"),
        (lambda s: s.replace("\tOFFSET 0.00000 -7.20000 0.00000", "\tOFFSET 0.0 nan 0.0", 1), "line 16: OFFSET: nan is no finite number"),
        (lambda s: s.replace("CHANNELS 3", "CHANNELS 2", 1), "line 9: CHANNELS says 2, but 3 follow"),
        (lambda s: s.replace("Zrotation Yrotation Xrotation", "Zrotation Yrotation Wrotation", 1), "line 5: Wrotation is no channel"),
        (lambda s: s.replace("Zrotation Yrotation Xrotation", "Zrotation Yrotation Zrotation", 1), "line 5: a channel is named twice"),
        (lambda s: s.replace("JOINT RHipJoint", "JOINT LHipJoint"), "there is a joint LHipJoint already, in line 6"),
        (lambda s: s.replace("JOINT LeftLeg", "JOINT LeftKnee"), "line 2: the skeleton has no LeftLeg; joints need CMU's names"),
        (lambda s: s.replace("MOTION", "MOVEMENT"), "MOVEMENT.* is not what a skeleton goes on with"),
        (lambda s: s.replace("Frames: 41", "Frames: many"), "here should be 'Frames:'"),
        (lambda s: s.replace("Frames: 41", "Frames: 0"), "at least 1"),
        (lambda s: s.replace("Frame Time: 0.050000", "Frame Time: 0"), "it must be positive"),
        (lambda s: s.replace("Frame Time: 0.050000", "Frame Rate: 20"), "here should be 'Frame Time:'"),
        (lambda s: s.replace("Frames: 41", "Frames: 45"), "the file ends after 41 of 45 frames"),
        (lambda s: s.replace("Frames: 41", "Frames: 40"), "more frames than the 40"),
        (lambda s: s.rstrip()[:-7], "frame 41 has 83 values; the skeleton has 84 channels"),
        (lambda s: s.rstrip().rpartition(" ")[0] + " inf", "frame 41: inf is no finite number"),
        (lambda s: s.rstrip().rpartition(" ")[0] + " 1,5", "frame 41: .*'1,5'; there must be numbers"),
        (lambda s: s.replace("-7.20000", "0.00000").replace("-7.40000", "0.00000"), "nothing tells how large the skeleton is"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, change, message):
    """File and line of what is cut off, too long, misspelt or no number."""
    path = tmp_path / "bad.bvh"
    path.write_text(change(FILE.read_text()))
    with pytest.raises(DataError, match=r"bad\.bvh, line \d+: ") as caught:
        Timeline(Person(script=(Action(play=Play(file=str(path))),)), 0)
    assert re.search(message, str(caught.value))


def test_files_that_cannot_be_read(tmp_path):
    """No file, a folder, something binary: the path is named."""
    (tmp_path / "binary.bvh").write_bytes(bytes(range(128, 256)))
    for name in ("nowhere.bvh", ".", "binary.bvh"):
        with pytest.raises(DataError, match="cannot be read as a motion capture"):
            load_bvh(tmp_path / name)
