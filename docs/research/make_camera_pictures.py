"""Pictures for docs/how-to/camera.md: what a camera sees of a simulated person, and a hand track against it.

    python docs/research/make_camera_pictures.py

The same versions of the libraries give the same files.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from radar_lab.camera.depth import DepthConfig
from radar_lab.camera.markers import MarkerConfig
from radar_lab.camera.pinhole import CameraModel, CameraMount
from radar_lab.camera.report import budget, collect, draw
from radar_lab.camera.residual import HandResiduals, ReferenceSample, ResidualConfig, TrackSample
from radar_lab.camera.synthetic import SyntheticCamera, SyntheticCameraConfig
from radar_lab.camera.truth import CameraTruth, CameraTruthConfig, PoseConfig, reference_of
from radar_lab.pipeline import Pipeline
from radar_sim import Simulator, load_scene
from radar_sim.scene import Scene

RADIUS, JOINT = 0.06, "right_hand"
RATE = 30.0  # Hz
LATENCY, LATE = 0.04, 0.004  # s: what is corrected, and by how much that is wrong
CAMERA, MOUNT = CameraModel(), CameraMount(y=-0.1, z=1.25)


def make(scene: Scene) -> tuple[SyntheticCamera, CameraTruth]:
    """Make a camera with the errors of a usual stereo one, and what is known of it."""
    noise = {"noise_floor": 0.001, "noise_growth": 0.0025}
    faults = {"jitter": 0.7, "holes": 0.05, "correlation": 2.0, "colour_noise": 4.0, "latency": LATENCY + LATE}
    settings = SyntheticCameraConfig(camera=CAMERA, mount=MOUNT, radius=(RADIUS,), seed=1, **noise, **faults)
    pose = PoseConfig(markers=MarkerConfig(pixel_std=0.8))
    config = CameraTruthConfig(mount=MOUNT, pose=pose, below_skin=(RADIUS,), latency=LATENCY, depth=DepthConfig(**noise))
    return SyntheticCamera(scene, settings), CameraTruth(CAMERA, config)


def draw_frame(scene: Scene, out: Path, time: float = 4.2) -> None:
    """Colour, depth, and the joint that was found (thesis, Fig. 7.9)."""
    made, truth = make(scene)
    frame = made.process(time)
    found = truth.process(frame)
    fig, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    left.imshow(frame.colour)
    left.plot(*found.pixel[0], "x", color="black", ms=10, mew=2)
    true = made.joints(time)[JOINT]
    away, said = np.sqrt(((found.position[0] - true) ** 2).sum()), np.sqrt((found.part_std[0] ** 2).sum())
    left.set_title(f"{JOINT}: {away * 1e3:.0f} mm from the truth, {said * 1e3:.0f} mm rms expected", fontsize=10)
    shown = right.imshow(np.where(frame.depth > 0, frame.depth * 1e-3, np.nan), cmap="cividis", vmin=1.0, vmax=4.6)
    right.set_title("depth, with noise and holes", fontsize=10)
    fig.colorbar(shown, ax=right, label="depth [m]")
    for axes in (left, right):
        axes.set_axis_off()
    save(fig, out / "camera_frame.png")


def draw_residual(scene: Scene, out: Path, seconds: float) -> None:
    """Follow the hand of a scene with radar and camera; places and residuals over time (thesis, Figs. 7.10 and 7.11)."""
    simulator = Simulator(scene)
    pipeline = Pipeline(simulator.info)
    made, truth = make(scene)
    samples: list[ReferenceSample | TrackSample] = []
    for k in range(int(seconds / simulator.interval)):
        hand = pipeline.process(simulator.process(k).frame).hand
        if k == int(1.5 / simulator.interval):
            pipeline.hand.start(None, round(1.5e9))
        if hand is not None and hand.active:
            samples.append(TrackSample("hand", hand.stamp_ns, hand.position, hand.covariance[:3, :3]))
    for k in range(int(seconds * RATE)):
        reference = reference_of(truth.process(made.process(k / RATE, k)), JOINT)
        if reference is not None:
            samples.append(reference)
    residuals = HandResiduals()
    found = collect(item for sample in sorted(samples, key=lambda s: s.stamp_ns) for item in residuals.process(sample))
    draw(found, "camera", out / "camera_residual.png")
    for name, value in budget(found["hand"], ResidualConfig()).items():
        print(f"{name}: {value}")


def save(fig: Any, path: Path) -> None:
    """Write without date or version, so that the same picture is the same file."""
    fig.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(fig)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of a camera as the reference of the hand.")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[1] / "img", help="folder for the pictures")
    parser.add_argument("--seconds", type=float, default=16.0, help="length of the session")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    scene = load_scene("drawing")
    draw_frame(scene, arguments.out)
    draw_residual(scene, arguments.out, arguments.seconds)


if __name__ == "__main__":
    main()
