"""Recordings of point clouds in small synthetic files: what comes out of the bag is what went in, in our axes."""

import json

import numpy as np
import pytest
from originals import items, truths, write_crossing, write_mars, write_segments

from radar_core import NO_GESTURE, ConfigError, DataError
from radar_lab.importers import KINDS
from radar_lab.importers.segments import frames_elapsed
from radar_ros.bags import contents
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording


def test_crossing_keeps_every_point_in_our_axes(tmp_path):
    """TI's right is our -left; azimuth changes its sign with it; the built-in height of 0.7 m moves from z to the mount."""
    data = write_crossing(tmp_path / "walk.npz")
    report = import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag", min_speed=0)
    clouds = items(tmp_path / "bag")
    points = data["points"]
    assert report.messages == {"/radar/info": 1, "/radar/points": 12} == contents(tmp_path / "bag")
    assert report.points == len(points)
    for name, column in {"x": 1, "range": 3, "elevation": 5, "radial_speed": 6}.items():
        np.testing.assert_array_equal(np.concatenate([getattr(c, name) for c in clouds]), points[:, column])
    for name, column in {"y": 0, "azimuth": 4}.items():
        np.testing.assert_array_equal(np.concatenate([getattr(c, name) for c in clouds]), -points[:, column])
    power = np.concatenate([c.snr + c.noise for c in clouds])
    np.testing.assert_allclose(power, points[:, 7], atol=1e-4)  # float32 of about 150
    mount = open_recording(tmp_path / "bag").info.mount
    height = np.concatenate([c.to_room(mount).z for c in clouds])
    np.testing.assert_allclose(height, points[:, 2], atol=1e-5)


def test_crossing_times_are_regular_although_the_logger_polled(tmp_path):
    """Frames 33 ms apart, logged in pairs: stamps rise by 33 ms, in the logger's clock, and sequence counts the radar's frames."""
    write_crossing(tmp_path / "walk.npz")
    import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag")
    clouds = items(tmp_path / "bag")
    steps = np.diff([c.stamp_ns for c in clouds]) * 1e-6
    # A line through a staircase of n values in pairs is flatter than the stairs by 3 / (n^2 - 1), 2.1 % of 12.
    np.testing.assert_allclose(steps, 33, rtol=0.0215)
    assert np.ptp(steps) < 1e-5
    assert clouds[0].stamp_ns == pytest.approx(9000e6, abs=40e6)
    assert [c.sequence for c in clouds] == list(range(12))


def test_crossing_drops_what_stands_still_and_says_so(tmp_path):
    data = write_crossing(tmp_path / "walk.npz")
    report = import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag", min_speed=0.1)
    moving = np.abs(data["points"][:, 6]) > 0.1
    assert report.points == moving.sum()
    assert report.dropped == {"points slower than min_speed": (~moving).sum()}
    assert "points slower than min_speed" in str(report)


def test_the_same_source_gives_the_same_messages(tmp_path):
    write_crossing(tmp_path / "walk.npz")
    for name in ("a", "b"):
        import_recording("crossing", tmp_path / "walk.npz", tmp_path / name)
    first, second = ([f for p in items(tmp_path / name) for f in (p.stamp_ns, p.x.tobytes(), p.snr.tobytes())] for name in ("a", "b"))
    assert first == second


@pytest.mark.parametrize("kind", ["mhomeges", "mtranssee"])
def test_segments_follow_each_other_with_pauses(tmp_path, kind):
    """Two segments of four frames (one without a point) and 0.5 s between: points in their frames, truth says which gesture."""
    labels = {"mhomeges": ("pull", "clap"), "mtranssee": ("PL", "KO")}[kind]
    data = write_segments(tmp_path / "segments.npz", labels)
    report = import_recording(kind, tmp_path / "segments.npz", tmp_path / "bag", idle=0.5)
    clouds, truth = items(tmp_path / "bag"), truths(tmp_path / "bag")
    assert [len(c) for c in clouds] == [5, 5, 0, 5, *[0] * 5] * 2
    assert set(np.diff([c.stamp_ns for c in clouds])) == {100_000_000}
    np.testing.assert_allclose(np.concatenate([c.x for c in clouds]), data["xyz_mm"][:, 1] / 1e3, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.y for c in clouds]), -data["xyz_mm"][:, 0] / 1e3, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.z for c in clouds]), data["xyz_mm"][:, 2] / 1e3, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.radial_speed for c in clouds]), data["doppler_mm_s"] / 1e3, atol=1e-6)
    np.testing.assert_allclose(np.concatenate([10 ** (c.snr / 20) for c in clouds]), data["intensity"], rtol=1e-5)
    none = [NO_GESTURE] * 5
    assert [int(t.gesture[0]) for t in truth] == [1, 1, 1, 1, *none, 0, 0, 0, 0, *none]
    assert [t.stamp_ns for t in truth] == [c.stamp_ns for c in clouds]
    assert {float(t.position[0, 0]) for t in truth} == {1.5}
    assert report.labels == dict.fromkeys(labels, 1)
    listed = json.loads((tmp_path / "bag" / "import.json").read_text())["segments"]
    assert [s["label"] for s in listed] == list(labels)
    assert [s["subject"] for s in listed] == [800, 801]
    assert listed[1]["start_ns"] == clouds[9].stamp_ns


def test_segments_can_be_chosen(tmp_path):
    labels = ("pull", "push", "pull", "up", "pull", "pull")
    write_segments(tmp_path / "segments.npz", labels)

    def count(name, **options):
        return import_recording("mhomeges", tmp_path / "segments.npz", tmp_path / name, **options).labels

    assert count("a", label="pull") == {"pull": 4}
    assert count("b", label="pull", limit=2) == {"pull": 2}
    assert count("c", subject=801) == {"push": 1}
    assert count("d", limit=3) == {"pull": 3}  # the first, the middle one (label pull), the last
    with pytest.raises(ConfigError, match="no label 'wave'"):
        count("e", label="wave")
    with pytest.raises(DataError, match="nothing in it to import"):
        count("f", subject=7)


def test_a_frame_counter_that_is_set_anew_does_not_stop_time():
    """Steps back and jumps of more than 5 s count as the next frame; small gaps stay gaps."""
    frame = np.array([7, 7, 8, 10, 2, 2, 3, 900, 901])
    np.testing.assert_array_equal(frames_elapsed(frame), [0, 0, 1, 3, 4, 4, 5, 6, 7])
    assert frames_elapsed(np.empty(0, np.int64)).size == 0


def test_streams_of_daily_life_are_segments_of_no_gesture(tmp_path):
    """Fields per person; rows of nothing but zeros are placeholders."""
    np.savez(
        tmp_path / "daily_random.npz",
        frame_804=np.array([1, 2, 2, 4], np.uint32),
        xyz_mm_804=np.array([[0, 0, 0], [100, 1500, 0], [0, 1400, 50], [0, 1300, 50]], np.int16),
        doppler_mm_s_804=np.array([0, 356, 0, -356], np.int16),
        intensity_804=np.array([0, 20, 30, 40], np.uint16),
    )
    report = import_recording("mhomeges", tmp_path / "daily_random.npz", tmp_path / "bag", idle=0)
    assert report.labels == {"daily": 1}
    assert report.dropped["rows at the radar itself: placeholders"] == 1
    assert [len(c) for c in items(tmp_path / "bag")] == [2, 0, 1]
    assert {int(t.gesture[0]) for t in truths(tmp_path / "bag")} == {0}


ROWS = """frame,points,x,y,z,Doppler,intensity
1,2,0.1,1.5,0.2,0.356,12
1,2,-0.1,1.4,0.2,-0.356,15
2,1,0.0,1.3
3,1,0.0,1.3,0.1,99.5,10
3,1,0.0,1.x,0.1,0.5,10
3,1,0.2,nan,0.1,0.5,10

4,1,0.2,1.25,0.1,0.0,0
"""


def test_the_originals_rows_are_read_and_garbled_ones_counted(tmp_path):
    """One file a segment, its label in its path; of 8 rows 3 are good."""
    folder = tmp_path / "p804" / "push"
    folder.mkdir(parents=True)
    (folder / "01.csv").write_text(ROWS)
    report = import_recording("mhomeges", tmp_path / "p804", tmp_path / "bag", idle=0)
    clouds = items(tmp_path / "bag")
    assert report.labels == {"push": 1}
    assert report.points == 3
    assert report.dropped["garbled rows: not 7 columns"] == 1
    assert report.dropped["garbled rows: beyond 20 m or 20 m/s"] == 1
    assert report.dropped["garbled rows: not numbers"] == 1
    assert report.dropped["garbled rows: impossible numbers"] == 1
    assert [len(c) for c in clouds] == [2, 0, 0, 1]
    np.testing.assert_allclose(clouds[0].y, [-0.1, 0.1], atol=1e-7)
    np.testing.assert_allclose(clouds[3].x, [1.25])


def test_a_text_that_is_no_recording_is_refused(tmp_path):
    (tmp_path / "notes.csv").write_text("to do\nbuy milk\n")
    with pytest.raises(DataError, match=r"notes\.csv: no row has the columns"):
        import_recording("mtranssee", tmp_path / "notes.csv", tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(("hand", "rise"), [("right", 0.0), ("left", 0.3)])
def test_mars_joints_become_truth_in_the_room(tmp_path, hand, rise):
    """The body goes right at 0.5 m/s, so our y falls; only the left hand rises, at 0.3 m/s."""
    data = write_mars(tmp_path / "subject3_test.npz")
    import_recording("mars", tmp_path / "subject3_test.npz", tmp_path / "bag", hand=hand)
    clouds, truth = items(tmp_path / "bag"), truths(tmp_path / "bag")
    np.testing.assert_array_equal(np.concatenate([c.y for c in clouds]), -data["xyz"][:, 0])
    np.testing.assert_array_equal(np.concatenate([c.radial_speed for c in clouds]), data["doppler"])
    assert [t.stamp_ns for t in truth] == [c.stamp_ns for c in clouds]
    for k, t in enumerate(truth):
        # The joints are float32 of about 1 m; differences over 0.2 s multiply that by 10.
        np.testing.assert_allclose(t.position, [[2.0, -0.05 * k, 1.0]], atol=1e-6)
        np.testing.assert_allclose(t.velocity, [[0.0, -0.5, 0.0]], atol=1e-5)
        np.testing.assert_allclose(t.hand_position, [[2.0, -0.05 * k, 1.0 + 0.1 * rise * k]], atol=1e-6)
        np.testing.assert_allclose(t.hand_velocity, [[0.0, -0.5, rise]], atol=1e-5)
        assert t.person_id == [3]


def write_mars_tables(folder, data, name="test"):
    """The two tables of an original: a row for each point, with its frame's number, and a row of joints for each frame."""
    frame = np.repeat(np.arange(len(data["offset"]) - 1), np.diff(data["offset"]).astype(int)) + 926
    rows = np.column_stack([frame, frame, data["xyz"], data["doppler"], data["intensity"], np.full(len(frame), 1.6171e9)])
    head = "Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time"
    np.savetxt(folder / f"radar_data_{name}.csv", rows, "%.9g", ",", header=head, comments="")
    head = ",".join(f"{joint}_{axis}" for axis in "XYZ" for joint in data["joints"])
    places = data["joint_xyz"].transpose(0, 2, 1).reshape(len(data["joint_xyz"]), -1)
    np.savetxt(folder / f"kinect_data_{name}.csv", places, "%.9g", ",", header=head, comments="")
    return folder / f"radar_data_{name}.csv"


def test_mars_originals_are_the_packed_ones(tmp_path):
    """The same clouds and the same truth."""
    folder = tmp_path / "subject3" / "timesplit"
    folder.mkdir(parents=True)
    data = write_mars(tmp_path / "subject3_test.npz")
    table = write_mars_tables(folder, data)
    for source, bag in ((tmp_path / "subject3_test.npz", "packed"), (table, "original")):
        import_recording("mars", source, tmp_path / bag, hand="left")
    for one, other in zip(items(tmp_path / "packed"), items(tmp_path / "original"), strict=True):
        for name in ("x", "y", "z", "radial_speed", "snr"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)
    for one, other in zip(truths(tmp_path / "packed"), truths(tmp_path / "original"), strict=True):
        np.testing.assert_allclose(one.hand_position, other.hand_position, rtol=1e-6, atol=1e-9)
        assert (one.stamp_ns, one.person_id) == (other.stamp_ns, other.person_id)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("kinect_data_test.csv", None, "have to lie beside it, in kinect_data_test.csv"),
        ("kinect_data_test.csv", "a,b\n1,2\n", "lacks the columns of joints"),
        ("kinect_data_test.csv", "SpineBase_X,SpineBase_Y\n1,2\n", "lacks the columns SpineBase_Z"),
        ("radar_data_test.csv", "a,b\n1,2\n", "has the columns a, b, expected Frame #"),
        ("radar_data_test.csv", "Frame #,# Obj,X,Y,Z,Doppler,Intensity\n1,2,x\n", "cannot be read as a table of numbers"),
        ("radar_data_test.csv", "Frame #,# Obj,X,Y,Z,Doppler,Intensity\n1,2,3\n", "7 names and rows of shape"),
        ("radar_data_test.csv", "Frame #,# Obj,X,Y,Z,Doppler,Intensity\n1,1,1,1,nan,0,1\n", "not finite"),
    ],
)
def test_mars_originals_that_are_spoilt(tmp_path, name, text, message):
    """File and reason are named."""
    table = write_mars_tables(tmp_path, write_mars(tmp_path / "x.npz"))
    (tmp_path / name).unlink()
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=message):
        import_recording("mars", table, tmp_path / "bag")


def spoil(path, **changes):
    """Change or remove fields of an .npz file."""
    with np.load(path) as data:
        fields = {**{k: data[k] for k in data.files}, **changes}
    np.savez(path, **{k: v for k, v in fields.items() if v is not None})


SPOILT = [
    ("crossing", write_crossing, {"points": None}, "lacks the field points"),
    ("crossing", write_crossing, {"points": np.zeros((240, 7), np.float32)}, r"points has shape \(240, 7\)"),
    ("crossing", write_crossing, {"points": np.full((240, 8), np.nan, np.float32)}, "points has 1920 values that are not finite"),
    ("crossing", write_crossing, {"offset": np.array([0, 50, 20, 240])}, "offset decreases at entry 2"),
    ("crossing", write_crossing, {"offset": np.array([0, 240])}, "frame_number has 12 entries but offset describes 1 frames"),
    ("crossing", write_crossing, {"frame_number": np.zeros(12, int)}, "frame_number must"),
    ("crossing", write_crossing, {"time_ms": np.zeros(12, int)}, "time_ms does not rise"),
    ("mars", write_mars, {"joints": np.array(["SpineBase", "HandLeft", "Nose"])}, "joints lacks HandRight"),
    ("mars", write_mars, {"joint_xyz": np.zeros((3, 3, 3))}, "joint_xyz has shape"),
    ("mars", write_mars, {"doppler": np.zeros(3)}, "doppler has 3 entries but xyz has 36"),
    ("mhomeges", None, {"label": np.array(["pull"])}, "label has 1 entries but offset describes 2"),
    ("mhomeges", None, {"intensity": np.zeros(3)}, "intensity has 3 entries"),
]


@pytest.mark.parametrize(("kind", "write", "changes", "message"), SPOILT, ids=[f"{k}-{m[:24]}" for k, _, _, m in SPOILT])
def test_spoilt_files_are_refused_by_file_and_field(tmp_path, kind, write, changes, message):
    path = tmp_path / "file.npz"
    if write is None:
        write_segments(path, ("pull", "push"))
    else:
        write(path)
    spoil(path, **changes)
    with pytest.raises(DataError, match=f"file.npz: .*{message}"):
        import_recording(kind, path, tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_missing_and_cut_off_files_are_refused(tmp_path, kind):
    """Every kind: no file, an empty one, and one of random bytes."""
    rng = np.random.default_rng(0)
    (tmp_path / "radar.cfg").write_text("adcCfg 2 1\n")
    suffix = {"dca1000": ".pcap", "openradar": ".npy"}.get(kind, ".npz")
    with pytest.raises(DataError, match="there is no such file"):
        import_recording(kind, tmp_path / f"none{suffix}", tmp_path / "bag")
    for content in (b"", rng.bytes(500)):
        path = tmp_path / f"bad{suffix}"
        path.write_bytes(content)
        with pytest.raises(DataError, match=r"bad|radar"):
            import_recording(kind, path, tmp_path / "bag")
        assert not (tmp_path / "bag").exists()


def test_wrong_options_are_refused(tmp_path):
    write_crossing(tmp_path / "walk.npz")
    with pytest.raises(ConfigError, match="choose one of crossing, mhomeges"):
        import_recording("walking", tmp_path / "walk.npz", tmp_path / "bag")
    with pytest.raises(ConfigError, match=r"unknown key 'speed'.*; known here:.*min_speed"):
        import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag", speed=1)
    with pytest.raises(ConfigError, match=r"min_speed is -1; it must be between 0 and 20 m/s"):
        import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag", min_speed=-1)


def test_an_existing_bag_is_never_touched(tmp_path):
    write_crossing(tmp_path / "walk.npz")
    import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag")
    with pytest.raises(DataError, match="does not exist yet"):
        import_recording("crossing", tmp_path / "walk.npz", tmp_path / "bag")
    assert len(items(tmp_path / "bag")) == 12
