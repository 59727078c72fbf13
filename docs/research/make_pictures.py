"""Pictures of docs/research/recordings.md, from the recordings; make_recording_pictures.py makes those of tracking.

    python docs/research/make_pictures.py --data ../shared/data  # pictures into docs/img

The same recordings and versions of the libraries give the same files. Without --data, HANDWAVE_DATA names the folder with the recordings.
The figures: ``python -m benchmarks recorded_echoes --json`` and ``python -m benchmarks gestures_shipped --json``.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.recorded_echoes import raw_cloud
from radar_lab.importers import open_original
from radar_lab.plots import PEOPLE

mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=PEOPLE)  # told apart by everybody


def draw_openradar(data: Path, out: Path) -> None:
    """Range-Doppler map of OpenRadar's frame, with the baseband's detections."""
    info, frame, cloud = raw_cloud("openradar", "openradar/doppler_example_1.npy")
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
        info, frame, cloud = raw_cloud("dca1000", source, tx=(1,), n_rx=1, order=order)
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


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of docs/research/recordings.md.")
    here = Path(__file__).resolve().parents[1]
    default = os.environ.get("HANDWAVE_DATA", here.parents[1] / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default), help="folder with the recordings")
    parser.add_argument("--out", type=Path, default=here / "img", help="folder for the pictures")
    arguments = parser.parse_args()
    if not arguments.data.is_dir():
        raise SystemExit(f"{arguments.data}: no recordings there; name their folder with --data or HANDWAVE_DATA")
    os.environ["HANDWAVE_DATA"] = str(arguments.data.resolve())
    arguments.out.mkdir(parents=True, exist_ok=True)
    for draw in (draw_dca1000, draw_openradar, draw_gestures):
        draw(arguments.data, arguments.out)
    print("\n".join(f"{p.name}: {p.stat().st_size // 1000} kB" for p in sorted(arguments.out.glob("*.png"))))


if __name__ == "__main__":
    main()
