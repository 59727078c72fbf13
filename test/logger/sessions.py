"""Events small enough for tests, and the states of a folder that a crash can leave."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from radar_app.logger.event import LoggedEvent
from radar_core import GESTURES, PointCloud, RadarFrame, RadarInfo, Waveform
from radar_gestures.maps import FeatureMaps, feature_maps

INFO = RadarInfo(waveform=Waveform(n_sample=8, n_chirp=4))
S = 10**9


def make_event(seed=0, start=5.0, frames=2, info=INFO):
    """An event of a second with a few random clouds, and frames of which the first lost a chirp."""
    rng = np.random.default_rng(seed)

    def cloud(k):
        n = int(rng.integers(0, 4))
        columns = rng.standard_normal((9, n)).astype(np.float32)
        names = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std")
        return PointCloud(round((start + 0.1 * k) * S), k, info.frame_id, **dict(zip(names, columns, strict=True)))

    clouds = [cloud(k) for k in range(12)]
    maps = feature_maps(clouds, 0.13, 4.2)
    cubes = (rng.standard_normal((frames, *info.cube_shape)) + 0j).astype(np.complex64)
    lost = [np.array([1], np.uint32), *[np.empty(0, np.uint32)] * (frames - 1)]
    raw = tuple(RadarFrame(cube, clouds[k].stamp_ns - 1000, k, info.frame_id, lost[k]) for k, cube in enumerate(cubes))
    stamps = (round(start * S), round((start + 1) * S), round((start + 1.2) * S))
    return LoggedEvent(info, 7, *stamps, GESTURES[seed % 10], 0.5, maps, clouds, rng.standard_normal((12, 3)), raw)


def assert_same(one, other):
    """Two events hold the same, to the bit."""
    numbers = ("info", "track_id", "start_ns", "end_ns", "decided_ns", "guess", "confidence")
    assert [getattr(one, name) for name in numbers] == [getattr(other, name) for name in numbers]
    for name in FeatureMaps.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one.maps, name), getattr(other.maps, name))
    np.testing.assert_array_equal(one.position, other.position)
    assert len(one.clouds) == len(other.clouds)
    for mine, theirs in zip(one.clouds, other.clouds, strict=True):
        assert mine.stamp_ns == theirs.stamp_ns
        for name in ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


def torn_folders(before, after, place, cut, zeros):
    """The folder as it may stand after a crash within the last operation: ``cut`` (0..1) says how much of each new byte got through.

    A name appears only after its bytes are on the disk, so a new file is there under its temporary name, or whole. What a file system had
    made room for but not yet written reads as zeros.
    """
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for name, data in after.items():
        old = before.get(name, b"")
        new = data[len(old) :]
        if not new:
            (place / name).write_bytes(data)
            continue
        kept = round(cut * len(new))
        torn = old + new[:kept] + (b"\0" * (len(new) - kept) if zeros else b"")
        whole = kept == len(new)
        (place / (name if old or name.endswith("journal") or whole else f"{name}.99999.part")).write_bytes(torn)
    for name in before.keys() - after.keys():  # deleting is one step: before it or after it
        if cut < 0.5:
            (place / name).write_bytes(before[name])


def moved(event, start):
    """The same event at another time [s]."""
    shift = round(start * S) - event.start_ns
    clouds = [replace(cloud, stamp_ns=cloud.stamp_ns + shift) for cloud in event.clouds]
    return replace(event, start_ns=event.start_ns + shift, end_ns=event.end_ns + shift, clouds=clouds)
