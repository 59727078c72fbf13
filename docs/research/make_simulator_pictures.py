"""Pictures of docs/explanation/simulator.md: feature maps of simulated strokes (thesis, figures 4.4 to 4.8), previews of two scenes.

    python docs/research/make_simulator_pictures.py            # into docs/img
    python docs/research/make_simulator_pictures.py --out DIR  # elsewhere

The same versions of the libraries give the same files. It takes about a minute.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from radar_app.preview import draw
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.features import FeatureConfig
from radar_gestures.maps import FeatureMaps, feature_maps
from radar_sim import Action, CouplingConfig, Effects, LossesConfig, NoiseConfig, OcclusionConfig, Person, Scene, Simulator, load_scene
from radar_tracking import make_tracker

GROUPS = {"push_pull": ("push", "pull"), "swipes": ("swipe_left", "swipe_right")}
PLACES = (0, 20, -20)  # azimuth of the person [deg]
PREVIEWS = ("demo",)
DISTANCE = 2.3  # m
START, AROUND = 2.0, 0.25  # s: of the stroke, and what is shown before and after it
TOP_SPEED = 3.6  # m/s
ANGLES = {"azimuth": 45.0, "elevation": 30.0}  # limits of the colours [deg]


def stroke(gesture: str, place: float) -> tuple[FeatureMaps, float]:
    """Take one stroke through baseband and tracking: its maps, and how long it takes [s].

    The person looks along the room, past the radar where it is not straight ahead; turned to it, strokes look as at boresight.
    """
    where = (DISTANCE * math.cos(math.radians(place)), DISTANCE * math.sin(math.radians(place)))
    person = Person(position=where, heading=math.pi, body="mesh", script=(Action(gesture=gesture, at=START),))
    effects = Effects(
        noise=NoiseConfig(noise_figure=15.0),
        losses=LossesConfig(level=25.0),
        coupling=CouplingConfig(level=-60.0),
        occlusion=OcclusionConfig(),
    )
    simulator = Simulator(Scene(duration=START + 2.0, people=(person,), effects=effects))
    segment = next(s for s in simulator.world.timelines[0].segments if s.gesture is not None)
    baseband, tracker = Baseband(BasebandConfig(), simulator.info), make_tracker(info=simulator.info)
    clouds = []
    for k in range(math.ceil((segment.end + AROUND) / simulator.interval)):
        cloud = baseband.process(simulator.process(k).frame)
        levelled = cloud.to_room(simulator.info.mount)
        tracks = tracker.process(levelled)
        if k * simulator.interval >= segment.start - AROUND:
            clouds.append(cloud.select(np.flatnonzero(tracks.point_track_id >= 0)))
    return feature_maps(clouds, FeatureConfig().gate, simulator.info.waveform.max_speed), segment.end - segment.start


def feature_pictures(out: Path) -> None:
    """Draw the maps of each group of gestures: a column per stroke, a row per map."""
    for group, gestures in GROUPS.items():
        cases = [(gesture, place) for gesture in gestures for place in PLACES]
        figure, axes = plt.subplots(3, len(cases), figsize=(15.0, 8.2), layout="constrained", sharex="col", sharey=True)
        figure.get_layout_engine().set(w_pad=0.03, wspace=0.0)
        for column, (gesture, place) in enumerate(cases):
            maps, length = stroke(gesture, place)
            images = [draw_map(axes[row, column], maps, name, length) for row, name in enumerate(("micro_doppler", *ANGLES))]
            axes[0, column].set_title(f"{gesture.replace('_', ' ')}, {f'{place:+d}°' if place else '0°'}", fontsize=15)
            axes[2, column].set_xlabel("time [s]", fontsize=13)
        for row, (image, label) in enumerate(zip(images, ("SNR [dB]", "azimuth [°]", "elevation [°]"), strict=True)):
            bar = figure.colorbar(image, ax=axes[row, :], pad=0.01, aspect=14)
            bar.set_label(label, fontsize=13)
            bar.ax.tick_params(labelsize=12)
            axes[row, 0].set_ylabel("range rate [m/s]", fontsize=13)
        figure.savefig(out / f"micro_doppler_{group}.png", dpi=90)
        plt.close(figure)


def draw_map(ax: plt.Axes, maps: FeatureMaps, name: str, length: float) -> mpl.image.AxesImage:
    """Draw one map; dotted lines are where the stroke truly starts and ends."""
    values = getattr(maps, name).astype(np.float64).T
    if name == "micro_doppler":
        values, limits, colours = np.where(values > 0, values, np.nan), (5.0, 45.0), "viridis"
    else:
        values, limits, colours = np.degrees(values), (-ANGLES[name], ANGLES[name]), "coolwarm"
    end = -AROUND + len(maps.stamp_ns) * 0.02
    half = float(maps.speed[-1] + (maps.speed[1] - maps.speed[0]) / 2)
    ax.set_facecolor("#20222a")
    image = ax.imshow(
        values, origin="lower", aspect="auto", extent=(-AROUND, end, -half, half), interpolation="nearest", cmap=colours, clim=limits
    )
    for time in (0.0, length):
        ax.axvline(time, color="white", linestyle=":", linewidth=1.2)
    ax.set_ylim(-TOP_SPEED, TOP_SPEED)
    ax.tick_params(labelsize=12)
    return image


def main() -> None:
    """Draw everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[1] / "img")
    out = parser.parse_args().out
    feature_pictures(out)
    for name in PREVIEWS:
        draw(Simulator(load_scene(name)), out / f"preview_{name}.png")


if __name__ == "__main__":
    main()
