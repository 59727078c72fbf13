"""Pictures and figures of docs/reference/recordings.md, from the recordings; make_recording_pictures.py makes those of tracking.

    python docs/research/make_pictures.py --data ../shared/data            # pictures into docs/img
    python docs/research/make_pictures.py --data ../shared/data --figures  # the numbers, as JSON

The same recordings and versions of the libraries give the same files. Without --data, HANDWAVE_DATA names the folder with the recordings.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from radar_core import GESTURES, PointCloud, RadarFrame
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures
from radar_lab.importers import open_original
from radar_lab.plots import PEOPLE
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording
from radar_sim.truth import Truth
from radar_tracking import PeopleTracker, TrackedCloud, TrackerConfig, TrackStatus

mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=PEOPLE)  # told apart by everybody

COMMON = {"rotate", "pull", "push", "swipe_up", "swipe_down"}  # what the data sets and we both know


def walkers(data: Path, name: str) -> tuple[list[PointCloud], dict[int, np.ndarray]]:
    """Clouds in the room, through a bag, and confirmed tracks: rows of cloud number, seconds, forward, left, range, range rate."""
    tracker = PeopleTracker(load_file(TrackerConfig, find_config("dense", "tracking", ".yaml")))
    clouds, lives = [], {}
    with tempfile.TemporaryDirectory() as folder:
        import_recording("crossing", data / "crossing" / f"{name}.npz", Path(folder) / "bag")
        recording = open_recording(Path(folder) / "bag")
        for _, item in recording.messages():
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


def raw_cloud(data: Path, kind: str, source: str, **options: Any) -> tuple[Any, RadarFrame, PointCloud]:
    """Info, frame and cloud of a recording with one raw frame."""
    recording = open_original(kind, data / source, **options)
    frame = next(recording.items)
    assert isinstance(frame, RadarFrame)
    cloud = Baseband(BasebandConfig(grouping="peak"), recording.info).process(frame)
    return recording.info, frame, cloud


def draw_openradar(data: Path, out: Path) -> None:
    """Range-Doppler map of OpenRadar's frame, with the baseband's detections."""
    info, frame, cloud = raw_cloud(data, "openradar", "openradar/doppler_example_1.npy")
    window = np.hanning(128)[:, None, None] * np.hanning(128)
    power = (np.abs(np.fft.fft2(frame.cube * window, axes=(1, 3))) ** 2).sum((0, 2))
    level = 10 * np.log10(np.fft.fftshift(power, axes=0))
    fig, axes = plt.subplots(figsize=(7, 4))
    image = axes.imshow(level, aspect="auto", origin="lower", extent=(-0.5, 127.5, -64.5, 63.5), vmin=level.max() - 50, cmap="Greys")
    bins, doppler = cloud.range / info.waveform.range_resolution, cloud.radial_speed / info.waveform.speed_resolution
    axes.scatter(bins, doppler, s=20, facecolors="none", edgecolors="#D55E00", label="detections")
    axes.set(xlabel="range bin", ylabel="Doppler bin", ylim=(-25, 25), title="OpenRadar: doppler_example_1.npy")
    axes.legend(loc="upper right")
    fig.colorbar(image, label="power [dB]")
    save(fig, out / "openradar.png")


def draw_dca1000(data: Path, out: Path) -> None:
    """Range profile of the frame in the DCA1000's packets, in both orders of I and Q, with the baseband's detections."""
    source = "dca1000/test_one_frame.pcap"
    fig, axes = plt.subplots(figsize=(7, 3.2))
    for order, colour in (("q_first", "#0072B2"), ("i_first", "0.6")):
        info, frame, cloud = raw_cloud(data, "dca1000", source, tx=(1,), n_rx=1, order=order)
        n = info.waveform.n_sample
        power = (np.abs(np.fft.fft(frame.cube * np.hanning(n), axis=3)) ** 2).sum((0, 1, 2))
        level = 10 * np.log10(np.fft.fftshift(power))
        axes.plot(np.arange(-n // 2, n // 2), level, color=colour, lw=1, label=f"order={order}")
        if order == "q_first":
            bins = (cloud.range / info.waveform.range_resolution + n / 2) % n - n / 2
            at = np.interp(bins, np.arange(-n // 2, n // 2), level)
            axes.scatter(bins, at, s=20, facecolors="none", edgecolors="#D55E00", label="detections")
    axes.set(xlabel="range bin (negative: no echo can be there)", ylabel="power [dB]", title="DCA1000: test_one_frame.pcap")
    axes.legend(fontsize=8)
    save(fig, out / "dca1000.png")


def draw_gestures(data: Path, out: Path) -> None:
    """Range rates of the points of one push and one pull of mHomeGes, over time."""
    fig, panels = plt.subplots(1, 2, figsize=(9, 3.2), sharey=True)
    for axes, label in zip(panels, ("push", "pull"), strict=True):
        clouds = [
            c for c in open_original("mhomeges", data / "mhomeges" / "segments.npz", label=label, limit=1, idle=0).items if hasattr(c, "x")
        ]
        t = np.concatenate([np.full(len(c), (c.stamp_ns - clouds[0].stamp_ns) * 1e-9) for c in clouds])
        seen = Counter(zip(t.round(3), np.concatenate([c.radial_speed for c in clouds]).round(3), strict=True))
        places = np.array(list(seen))
        axes.scatter(*places.T, s=8.0 * np.array(list(seen.values())), alpha=0.6)
        axes.set(xlabel="time [s]", title=f"{label} (area: number of points)")
        for limit in (-0.8, 0.8):
            axes.axhline(limit, color="0.6", lw=0.8, ls="--")
    panels[0].set_ylabel("range rate [m/s]")
    save(fig, out / "push_pull.png")


def save(fig: Any, path: Path) -> None:
    """Write without date or version, so that the same picture is the same file."""
    fig.tight_layout()
    fig.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(fig)


def walker_figures(data: Path, name: str) -> dict[str, Any]:
    """Whether time base and range rates agree."""
    clouds, lives = walkers(data, name)
    first = next(iter(lives.values()))
    seen = first[np.isfinite(first[:, 4])]
    return {
        "clouds": len(clouds),
        "frame_interval_ms": (clouds[-1].stamp_ns - clouds[0].stamp_ns) * 1e-6 / (len(clouds) - 1),
        "range_change_m": float(seen[-5:, 4].mean() - seen[:5, 4].mean()),
        "range_change_by_doppler_m": float(np.sum(seen[:-1, 5] * np.diff(seen[:, 1]))),
    }


def raw_figures(data: Path, kind: str, source: str, **options: Any) -> dict[str, Any]:
    """Strongest detections in bins."""
    info, frame, cloud = raw_cloud(data, kind, source, **options)
    best = np.argsort(-cloud.snr)[:8]
    bins, doppler = cloud.range / info.waveform.range_resolution, cloud.radial_speed / info.waveform.speed_resolution
    return {
        "shape": frame.cube.shape,
        "detections": len(cloud),
        "strongest_range_bin_doppler_bin_snr": [[round(float(v[i]), 1) for v in (bins, doppler, cloud.snr)] for i in best],
    }


def gesture_figures(data: Path, kind: str, limit: int) -> dict[str, Any]:
    """Share of segments with an event, and of known gestures that the shipped model names rightly; all through people tracking."""
    recording = open_original(kind, data / kind / "segments.npz", limit=limit)
    mount = recording.info.mount
    settings = {"default": GestureConfig(), "slow_radar": load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))}
    stages = {name: EventStage(s, mount) for name, s in settings.items()}
    recogniser, tracker = GestureRecognizer(settings["default"], load_model("gestures"), mount), PeopleTracker()
    spans: dict[str, list[tuple[int, int]]] = {name: [] for name in stages}
    gestures, labels = [], {}
    for item in recording.items:
        if isinstance(item, Truth):
            labels[item.stamp_ns] = int(item.gesture[0])
            continue
        cloud = item.to_room(mount)
        tracked = TrackedCloud(cloud, tracker.process(cloud))
        for name, stage in stages.items():
            spans[name] += [(e.event.start_ns, e.event.end_ns) for e in stage.process(tracked)]
        gestures += [RecognisedGesture(0, g.label, g.start_ns, g.end_ns) for g in recogniser.process(tracked)]
    segments = recording.tally.segments
    truth = [TruthSegment(0, labels[s.start_ns], s.start_ns, s.end_ns) for s in segments]
    known = [t for t in truth if GESTURES[t.label] in COMMON]
    score = score_gestures(known, gestures)
    result: dict[str, Any] = {"segments": len(segments)}
    for name, found in spans.items():
        share: dict[str, list[bool]] = {}
        for s in segments:
            share.setdefault(s.label, []).append(any(start <= s.end_ns and end >= s.start_ns for start, end in found))
        result[f"with_event_{name}"] = float(np.mean([hit for hits in share.values() for hit in hits]))
        result[f"with_event_{name}_by_label"] = {label: round(float(np.mean(hit)), 2) for label, hit in sorted(share.items())}
    result |= {"known_gestures": len(known), "named_rightly": score.hits, "named_wrongly": score.wrong, "missed": score.misses}
    return result


def daily_figures(data: Path) -> dict[str, Any]:
    """Events a minute when nobody gestures."""
    recording = open_original("mhomeges", data / "mhomeges" / "daily_random.npz")
    mount = recording.info.mount
    settings = {"default": GestureConfig(), "slow_radar": load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))}
    stages, tracker = {name: EventStage(s, mount) for name, s in settings.items()}, PeopleTracker()
    recogniser = GestureRecognizer(settings["default"], load_model("gestures"), mount)
    events, named, clouds = Counter(), 0, 0
    for item in recording.items:
        if isinstance(item, PointCloud):
            cloud = item.to_room(mount)
            tracked = TrackedCloud(cloud, tracker.process(cloud))
            clouds += 1
            events.update({name: len(stage.process(tracked)) for name, stage in stages.items()})
            named += sum(g.label != 0 for g in recogniser.process(tracked))
    minutes = clouds * recording.info.waveform.frame_interval / 60
    rates = {f"events_per_minute_{name}": round(events[name] / minutes, 2) for name in stages}
    return {"minutes": minutes, **rates, "gestures_per_minute_default": round(named / minutes, 2)}


def figures(data: Path, limit: int) -> dict[str, Any]:
    """Everything that docs/reference/recordings.md states."""
    return {
        "one_person": walker_figures(data, "one_person"),
        "two_people": walker_figures(data, "two_people"),
        "openradar": raw_figures(data, "openradar", "openradar/doppler_example_1.npy"),
        "dca1000": raw_figures(data, "dca1000", "dca1000/test_one_frame.pcap", tx=(1,), n_rx=1),
        "mhomeges": gesture_figures(data, "mhomeges", limit),
        "mtranssee": gesture_figures(data, "mtranssee", limit),
        "daily_random": daily_figures(data),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures and figures of docs/reference/recordings.md.")
    here = Path(__file__).resolve().parents[1]
    default = os.environ.get("HANDWAVE_DATA", here.parents[1] / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default), help="folder with the recordings")
    parser.add_argument("--out", type=Path, default=here / "img", help="folder for the pictures")
    parser.add_argument("--figures", action="store_true", help="print the figures instead")
    parser.add_argument("--segments", type=int, default=400, help="gestures per data set for the figures")
    arguments = parser.parse_args()
    if not arguments.data.is_dir():
        raise SystemExit(f"{arguments.data}: no recordings there; name their folder with --data or HANDWAVE_DATA")
    if arguments.figures:
        print(json.dumps(figures(arguments.data, arguments.segments), indent=1))
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    for draw in (draw_dca1000, draw_openradar, draw_gestures):
        draw(arguments.data, arguments.out)
    print("\n".join(f"{p.name}: {p.stat().st_size // 1000} kB" for p in sorted(arguments.out.glob("*.png"))))


if __name__ == "__main__":
    main()
