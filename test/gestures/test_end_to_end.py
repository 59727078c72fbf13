"""Streams of real people's segments with rests between: how they are joined, and how names are counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.gesture_studies import GATES, files
from benchmarks.gestures_end_to_end import NOTHING, REST, Found, Part, Stream, figures, joined, levelled, most, named, read_parts, rest_of
from benchmarks.recordings import folder
from radar_core import ConfigError, DataError, PointCloud, Pose, RadarInfo
from radar_gestures.maps import FeatureMaps
from radar_lab.alignment.tilt import HEIGHTS

GATE, STEP = 0.35, 100_000_000


def cloud(speeds: tuple[float, ...], snr: float) -> PointCloud:
    """Make a cloud of points at 2 m with these range rates."""
    values = {"x": 2.0, "y": 0.0, "z": 0.0, "range": 2.0, "azimuth": 0.0, "elevation": 0.0, "snr": snr}
    columns = {name: np.full(len(speeds), value, np.float32) for name, value in values.items()}
    return PointCloud(7, 3, "radar", radial_speed=np.array(speeds, np.float32), **columns)


def parts() -> list[Part]:
    """Three segments of five, six and seven clouds, each with a point that stands and one that moves; the SNR tells which is which."""
    return [Part(name, 1, 2.0, tuple(cloud((0.0, 1.0), 10.0 * k + j) for j in range(5 + k))) for k, name in enumerate(("a", "b", "c"))]


def test_joined_segments_are_whole_and_rest_between() -> None:
    """Every segment once, in its own order; stamps go on; a rest of a second or two in which nothing moves; the same seed repeats."""
    made = list(joined(parts(), GATE, STEP, (1, 2)))
    assert [one.stamp_ns for one, _ in made] == [STEP * (k + 1) for k in range(len(made))]
    assert [one.sequence for one, _ in made] == list(range(len(made)))
    owners = np.array([owner for _, owner in made])
    for number, part in enumerate(parts()):
        own = np.flatnonzero(owners == number)
        assert own.tolist() == list(range(own[0], own[0] + len(part.clouds)))
        assert [made[k][0].snr.tolist() for k in own] == [one.snr.tolist() for one in part.clouds]
    rests = np.split(owners, np.flatnonzero(np.diff(owners)) + 1)[1::2]
    assert len(rests) == 3
    assert all(REST[0] <= len(rest) * 0.1 <= REST[1] for rest in rests)
    assert all((np.abs(one.radial_speed) < GATE / 2).all() and len(one) for one, owner in made if owner < 0)
    assert owners.tolist() == [owner for _, owner in joined(parts(), GATE, STEP, (1, 2))]


def test_rest_goes_back_from_the_end() -> None:
    """And comes again where it lasts longer than the segment."""
    part = parts()[0]
    assert [one.snr.tolist() for one in rest_of(part, 7, GATE)] == [[4.0], [3.0], [2.0], [1.0], [0.0], [4.0], [3.0]]


def test_a_radar_is_levelled_by_what_moves() -> None:
    """Arms as high as the radar at an elevation of 0.2 rad: it is tilted down by as much. What stands still elsewhere does not count."""
    clouds = []
    for k in range(80):
        one = cloud((1.0, -1.0, 0.0), 20.0)
        clouds.append(replace(one, stamp_ns=k * STEP, elevation=np.array([0.2, 0.2, -0.6], np.float32)))
    info = RadarInfo(frame_id="radar", mount=Pose(z=HEIGHTS["arms"][0], tilt=0.3))
    found = levelled(info, [Part("a", 1, 2.0, tuple(clouds[:40])), Part("b", 1, 2.0, tuple(clouds[40:]))])
    assert found.mount.tilt == pytest.approx(-0.2, abs=1e-6)
    assert found == replace(info, mount=replace(info.mount, tilt=found.mount.tilt))


def test_data_sets_that_are_not_there_are_named() -> None:
    """Before anything is read."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    with pytest.raises(ConfigError, match="--parts mars: choose among mhomeges, mtranssee"):
        figures(quick=True, parts="mars")


def test_an_event_belongs_to_whom_it_overlaps_most() -> None:
    """Rest does not count."""
    assert most([-1, -1, 4, 4, 5, -1, -1, -1]) == (4, 2)
    assert most([-1, -1]) == (-1, 0)
    assert most([]) == (-1, 0)


def test_a_segment_has_the_name_of_its_longest_event() -> None:
    """Events that are nothing name nothing; one in a gap with a name is a false gesture."""
    maps = FeatureMaps(np.zeros(0, np.int64), *(np.zeros(0, np.float32) for _ in range(5)))
    events = tuple(
        Found(maps, segment, overlap, 1.0) for segment, overlap in ((0, 0.5), (0, 0.9), (1, 2.0), (2, 0.3), (-1, 0.0), (-1, 0.0))
    )
    stream = Stream(1, 2.0, ("push", "pull", "up", "knock"), events, 0.1)
    assert named(stream, ["pull", "push", NOTHING, "up", "up", NOTHING]) == (["push", "", "up", ""], 1)


@pytest.mark.parametrize("kind", sorted(GATES))
def test_recordings_are_read_segment_by_segment(kind: str) -> None:
    """Where they are: each person's own, with clouds and a distance, named as in the other data set."""
    try:
        folder()
    except DataError as error:
        pytest.skip(str(error))
    path = files(kind)[0]
    with np.load(path) as held:
        person = int(held["subject"][0])
    info, found = read_parts(kind, path, person, 20)
    assert info.waveform.frame_interval == 0.1
    assert len(found) == 20
    assert {one.person for one in found} == {person}
    assert all(one.clouds and 1.0 < one.distance < 5.0 for one in found)
