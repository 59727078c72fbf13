"""What recordings say of their own units: ways by range and by range rate of people who walk, and where the echoes of raw frames lie."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.recordings import folder
from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_lab.importers import open_original
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording
from radar_tracking import PeopleTracker, TrackerConfig, TrackStatus

_STRONGEST = 8


def walkers(name: str) -> tuple[list[PointCloud], dict[int, NDArray[np.float64]]]:
    """Clouds in the room, through a bag, and confirmed tracks: rows of cloud number, seconds, forward, left, range, range rate."""
    tracker = PeopleTracker(load_file(TrackerConfig, find_config("dense", "tracking", ".yaml")))
    clouds: list[PointCloud] = []
    lives: dict[int, list[tuple[float, ...]]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        import_recording("crossing", folder() / "crossing" / f"{name}.npz", Path(temporary) / "bag")
        recording = open_recording(Path(temporary) / "bag")
        for _, item in recording.messages():
            assert isinstance(item, PointCloud)
            cloud = item.to_room(recording.info.mount)
            clouds.append(cloud)
            tracks = tracker.process(cloud)
            for track in tracks.tracks:
                if track.status != TrackStatus.TENTATIVE:
                    own = tracks.point_track_id == track.id
                    radial = (np.median(cloud.range[own]), np.median(cloud.radial_speed[own])) if own.any() else (np.nan, np.nan)
                    seconds = (cloud.stamp_ns - clouds[0].stamp_ns) * 1e-9
                    lives.setdefault(track.id, []).append((cloud.sequence, seconds, *track.position[:2], *radial))
    return clouds, {key: np.array(life) for key, life in sorted(lives.items(), key=lambda item: -len(item[1]))}


def raw_cloud(kind: str, source: str, **options: Any) -> tuple[RadarInfo, RadarFrame, PointCloud]:
    """Info, frame and cloud of a recording with one raw frame."""
    recording = open_original(kind, folder() / source, **options)
    frame = next(recording.items)
    assert isinstance(frame, RadarFrame)
    return recording.info, frame, Baseband(BasebandConfig(grouping="peak"), recording.info).process(frame)


def way(name: str) -> dict[str, Any]:
    """Whether time base and range rates agree: how far the first walker went, by ranges and by range rates."""
    clouds, lives = walkers(name)
    first = next(iter(lives.values()))
    seen = first[np.isfinite(first[:, 4])]
    return {
        "clouds": len(clouds),
        "frame_interval_ms": (clouds[-1].stamp_ns - clouds[0].stamp_ns) * 1e-6 / (len(clouds) - 1),
        "range_change_m": float(seen[-5:, 4].mean() - seen[:5, 4].mean()),
        "range_change_by_doppler_m": float(np.sum(seen[:-1, 5] * np.diff(seen[:, 1]))),
    }


def echoes(kind: str, source: str, **options: Any) -> dict[str, Any]:
    """Strongest detections of a raw frame: range and range rate in cells of the map, and SNR [dB]."""
    info, frame, cloud = raw_cloud(kind, source, **options)
    best = np.argsort(-cloud.snr, kind="stable")[:_STRONGEST]
    bins, doppler = cloud.range / info.waveform.range_resolution, cloud.radial_speed / info.waveform.speed_resolution
    strongest = [{"range_bin": float(bins[i]), "doppler_bin": float(doppler[i]), "snr_db": float(cloud.snr[i])} for i in best]
    return {"shape": list(frame.cube.shape), "detections": len(cloud), "strongest": strongest}


def run(quick: bool) -> dict[str, Any]:
    """Measure all four; quick: without the second walk."""
    return {
        **{name: way(name) for name in ("one_person", "two_people")[: 1 if quick else 2]},
        "openradar": echoes("openradar", "openradar/doppler_example_1.npy"),
        "dca1000": echoes("dca1000", "dca1000/test_one_frame.pcap", tx=(1,), n_rx=1),
        "choices": [],
    }
