"""What a run of the whole chain gives, as digests of its bits; `test_reproducible.py` runs it in processes with other settings."""

import hashlib
import json
import sys

import numpy as np

from radar_core import RadarInfo
from radar_dsp import SpectrumConfig
from radar_dsp.context import CalibratedBasebandConfig
from radar_lab.pipeline import Pipeline, PipelineConfig
from radar_sim import Action, Effects, Fidelity, NoiseConfig, Person, Scene, SceneRadar, Simulator

MODELS = ("separable", "nufft", "blocks", "exact")


def digest(*arrays: object) -> str:
    """Of all bytes, in order."""
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()[:16]


def scene_of(model: str, duration: float = 4.0) -> Scene:
    """One person who pushes, in noise."""
    person = Person(position=(2.5, 0.3), script=(Action(gesture="push", at=1.3),))
    radars = (SceneRadar.of(RadarInfo()),)
    return Scene(duration=duration, radars=radars, people=(person,), effects=Effects(noise=NoiseConfig()), fidelity=Fidelity(model=model))


def run(fft: str, n_frames: int) -> dict[str, str]:
    """Digests by stage."""
    found = {f"simulator {model}": digest(Simulator(scene_of(model)).process(30).frame.cube) for model in MODELS}
    simulator, parts = Simulator(scene_of("separable")), {"clouds": [], "tracks": [], "gestures": [], "hand": []}
    pipeline = Pipeline(RadarInfo(), PipelineConfig(baseband=CalibratedBasebandConfig(spectrum=SpectrumConfig(fft=fft))))
    pipeline.hand.start(None, 600_000_000)
    for k in range(n_frames):
        result = pipeline.process(simulator.process(k).frame)
        parts["clouds"] += [result.cloud.position, result.cloud.snr, result.cloud.radial_speed]
        for track in result.tracks.tracks:
            parts["tracks"] += [track.position, track.covariance]
        parts["gestures"] += [g.probabilities for g in result.gestures]
        parts["hand"] += [] if result.hand is None else [result.hand.position, result.hand.covariance, result.hand.value]
    return found | {name: digest(*arrays) for name, arrays in parts.items()} | {"sizes": str({name: len(p) for name, p in parts.items()})}


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1], int(sys.argv[2]))))
