"""Real recordings (not part of the project; skipped where they are absent): two walkers who cross."""

from pathlib import Path

import numpy as np
import pytest

from radar_core import PointCloud
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_tracking import PeopleTracker, TrackerConfig, TrackStatus

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "crossing"
FRAME_NS = 51_000_000  # the recording's own times are a logger's: they repeat and jump


def clouds(name: str):
    """The recording in our axes: TI's y is our x, TI's x is our -y."""
    if not DATA.is_dir():
        pytest.skip(f"no real recordings at {DATA}")
    with np.load(DATA / f"{name}.npz", allow_pickle=False) as data:
        offset, points, number = data["offset"], data["points"], data["frame_number"]
    for k in range(len(offset) - 1):
        p = np.ascontiguousarray(points[offset[k] : offset[k + 1]].T, np.float32)
        stamp = int(number[k] - number[0]) * FRAME_NS
        yield PointCloud(stamp, k, "room", p[1], -p[0], p[2], range=p[3], radial_speed=p[6], snr=p[7])


def lives(name: str, config: TrackerConfig) -> dict[int, list[np.ndarray]]:
    """Positions of every confirmed track."""
    tracker, found = PeopleTracker(config), {}
    for cloud in clouds(name):
        for track in tracker.process(cloud).tracks:
            if track.status != TrackStatus.TENTATIVE:
                found.setdefault(track.id, []).append(track.position)
    return found


def dense() -> TrackerConfig:
    """The preset for such radars."""
    return load_file(TrackerConfig, find_config("dense", "tracking", ".yaml"))


def test_one_walker_is_one_track():
    """From confirmation (0.2 s) to the end of 231 clouds, and nobody else for 80 % of the run."""
    found = lives("one_person", dense())
    assert sum(len(life) >= 0.8 * 231 for life in found.values()) == 1


def test_two_walkers_keep_their_tracks_through_the_crossing():
    """Exactly two tracks live for 80 % of 319 clouds; one comes nearer all the time, the other goes away: the crossing swapped nobody.

    Ghosts by reflection walk beside them for 1 to 3 s each; they must stay short.
    """
    found = lives("two_people", dense())
    long = [np.array(life) for life in found.values() if len(life) >= 0.8 * 319]
    assert len(long) == 2
    assert all(len(life) < 0.2 * 319 for life in found.values() if len(life) < 0.8 * 319)
    nearer, farther = sorted(long, key=lambda p: -p[0, 0])
    for path, sign in ((nearer, -1), (farther, 1)):
        steps = np.diff(path[::20, 0]) * sign  # a step a second
        assert (steps > 0).mean() > 0.9
