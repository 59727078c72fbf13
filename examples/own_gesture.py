"""Teaches the shipped model a gesture of your own, here a circle that a simulated person draws.

python examples/own_gesture.py my_circle    # writes my_circle/samples and my_circle/model.npz; half a minute
handwave up --param gestures.model=my_circle/model.npz

With a radar, `handwave gesture record circle` takes the samples from you (docs/how-to/own-gestures.md).
"""

import sys
from pathlib import Path

from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.stage import GestureConfig, config_for
from radar_lab.datasets.own_simulated import own_scene, simulate_takes
from radar_lab.training.own import judge, learn, read_for
from radar_lab.training.tuning import usual_tuning


def record(folder, samples, seed):
    """Let a simulated person draw circles until the folder holds so many good samples."""
    shipped = load_model("gestures")
    scene = own_scene("circle", "circle", samples, seed=seed)
    return simulate_takes(scene, folder, "circle", 0, samples, lambda info: config_for(shipped.settings, GestureConfig()))


def main(out, samples=4, new=4):
    """Record, learn, save, and try the model on samples that it has not seen."""
    record(out / "samples", samples, seed=1)
    shipped = load_model("gestures")
    model = learn([out / "samples"], shipped, usual_tuning(shipped))
    save_model(model, out / "model.npz")
    print(f"names {', '.join(model.labels)}")
    record(out / "more", new, seed=2)
    outcome = judge(model, read_for([out / "more"], model))
    print(f"{outcome.right} of {outcome.total} new samples right")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "my_circle"))
