"""What lost chirps cost: the noise floor beside a strong echo, and gestures.

Two kinds of losses at the same share of chirps: ``random``, each chirp by itself; ``bursts``, `BURST` chirps in a row over all
transmitters, as when a UDP stream loses six packets of 1456 bytes (a chirp of four receivers and 64 samples has 1024 bytes). A burst may
begin before the frame or end after it. Only frames that lost something count for the floor. Gestures come from people and scripts of
seeds that nothing was tuned on; the frames of a scene are simulated once and go through one pipeline for each choice.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_scenes import NAMED, gesture_stream, stroke
from benchmarks.report import Panel, share_interval, timed
from benchmarks.stores import digest, once, sources
from benchmarks.tradeoff.echoes import AMPLITUDE, INFO, LIMITS, SNR_DB, WAVE, echo, noise
from radar_core import RadarFrame
from radar_core.config import plain
from radar_dsp import Baseband, BasebandConfig, SpectrumConfig
from radar_dsp.config import Missing
from radar_dsp.context import CalibratedBasebandConfig
from radar_dsp.gaps import Gaps
from radar_dsp.spectrum import make_spectrum
from radar_lab.evaluation.run import Evaluator
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment
from radar_lab.pipeline import Pipeline, PipelineConfig
from radar_sim import Action, Scene, Simulator

Random = np.random.Generator
RATES: Final = (0.01, 0.05, 0.1)
KINDS: Final = ("random", "bursts")
METHODS: Final[tuple[Missing, ...]] = get_args(Missing)
BURST: Final = 8
ECHO_DB: Final = 50.0
SLOW: Final = 0.5  # range rate up to which an echo is slow [m/s]
_ZERO: Final = "missing=zero"
PANELS: Final = {
    rate: Panel(
        f"{rate:.0%} of the chirps lost", "rise of the floor beside 50 dB", "dB", "lower", f"missing={SpectrumConfig().missing}", _ZERO
    )
    for rate in (0.01, 0.1)
}
SEEDS: Final = range(7300, 7309)
DURATION: Final = 95.0  # of a scene [s]: about 26 gestures
PACKAGES: Final = ("radar_core", "radar_sim", "radar_dsp", "radar_tracking", "radar_gestures")


def draw_losses(rng: Random, rate: float, kind: str) -> NDArray[np.uint32]:
    """Numbers of the chirps that a frame loses, ascending, shape (n_missing,)."""
    n = WAVE.n_chirp * WAVE.n_tx
    if kind == "random":
        return np.flatnonzero(rng.random(n) < rate).astype(np.uint32)
    starts = np.flatnonzero(rng.random(n + BURST - 1) < rate / BURST) - (BURST - 1)
    lost = np.unique(starts[:, None] + np.arange(BURST))
    return lost[(lost >= 0) & (lost < n)].astype(np.uint32)


def struck_frames(rng: Random, rate: float, kind: str) -> Iterator[NDArray[np.uint32]]:
    """Losses of frames that lost something, for ever."""
    while True:
        missing = draw_losses(rng, rate, kind)
        if len(missing):
            yield missing


def floor_db(method: Missing, rate: float, kind: str, fastest: float, n: int) -> float:
    """Rise of the noise floor beside an echo of 50 dB in frames that lost chirps [dB].

    The floor is the mean power of all Doppler cells of the echo's range cell and its two neighbours, but for those that the echo itself
    fills without noise or loss (above a tenth of the noise). The echo has any direction and any range rate up to ``fastest`` [m/s].
    """
    rng = np.random.default_rng([17, round(1e4 * rate), KINDS.index(kind), round(100 * fastest)])
    spectrum, gaps, losses = make_spectrum(SpectrumConfig(), INFO), Gaps(method, INFO), struck_frames(rng, rate, kind)
    least, most = LIMITS.copy()
    least[1], most[1] = -fastest, fastest
    whole = struck = 0.0
    for _ in range(n):
        truth = rng.uniform(least, most)
        clean = (AMPLITUDE * 10 ** ((ECHO_DB - SNR_DB) / 20) * echo(truth)).astype(np.complex64)
        # 2.14: motion during a chirp shifts the beat frequency
        cell = round((truth[0] + truth[1] * (WAVE.carrier / WAVE.slope - WAVE.chirp_pause / 2)) / WAVE.range_resolution)
        near = np.arange(cell - 1, cell + 2)
        beside = np.abs(spectrum.process(clean)[..., near]).max(axis=(0, 2)) ** 2 < 0.1
        cube = clean + noise(rng)
        whole += float((np.abs(spectrum.process(cube)[..., near]) ** 2).mean(axis=(0, 2))[beside].mean())
        gaps.process(cube, next(losses))
        struck += float((np.abs(spectrum.process(cube)[..., near]) ** 2).mean(axis=(0, 2))[beside].mean())
    return 10 * math.log10(struck / whole)


def worst_floor_db(method: Missing, rate: float, n: int) -> dict[str, float]:
    """Rise of the floor by kind of loss, for slow and for all echoes, and the largest of them."""
    speeds = {"slow": SLOW, "any": WAVE.max_speed}
    found = {f"{kind} {name}": floor_db(method, rate, kind, speed, n) for kind in KINDS for name, speed in speeds.items()}
    return {**found, "worst": max(found.values())}


def baseband_ms(method: Missing, rate: float, n: int) -> list[float]:
    """Time the default chain with a frame that lost chirps at random [ms]."""
    rng = np.random.default_rng([18, round(1e4 * rate)])
    baseband = Baseband(BasebandConfig(spectrum=SpectrumConfig(missing=method)), INFO)
    cube = (noise(rng) + 30 * AMPLITUDE * echo(np.array([2.5, 0.5, 0.1, 0.0]))).astype(np.complex64)
    times = []
    for missing in itertools.islice(struck_frames(rng, rate, "random"), n):
        times.append(timed(baseband.process, RadarFrame(cube, 0, 0, "radar", missing))[1])
    return times


def brief(rng: Random) -> list[Action]:
    """Every gesture once, in random order, with short pauses."""
    return [step for name in rng.permutation(NAMED) for step in (Action(stand=float(rng.uniform(0.7, 1.2))), stroke(rng, str(name)))]


def cases() -> dict[str, tuple[Missing, float, str]]:
    """List what is compared: the default choice at every rate and kind, the others at 1 % of random losses; and no loss at all."""
    default = SpectrumConfig().missing
    table: dict[str, tuple[Missing, float, str]] = {"none": (default, 0.0, "random")}
    for rate, kind in itertools.product(RATES, KINDS):
        table[f"{default} {rate:g} {kind}"] = (default, rate, kind)
    return table | {f"{method} 0.01 random": (method, 0.01, "random") for method in METHODS}


def perform(scene: Scene) -> dict[str, Any]:
    """Run a scene through one pipeline for each case; ``hits``: whether each gesture was recognised, ``false``: how many nobody did."""
    table, info = cases(), scene.radars[0].info
    pipelines = {
        name: Pipeline(info, PipelineConfig(baseband=CalibratedBasebandConfig(spectrum=SpectrumConfig(missing=method))))
        for name, (method, _, _) in table.items()
    }
    evaluators = {name: Evaluator(info) for name in table}
    dice = {name: np.random.default_rng([scene.seed, k]) for k, name in enumerate(table)}
    simulator = Simulator(scene)
    for number in range(simulator.n_frames):
        sample = simulator.process(number)
        for name, (_, rate, kind) in table.items():
            missing = draw_losses(dice[name], rate, kind)
            result = pipelines[name].process(dataclasses.replace(sample.frame, missing=missing) if len(missing) else sample.frame)
            evaluators[name].add(result.tracks, sample.truth)
            for gesture in result.gestures:
                evaluators[name].add_gesture(gesture)
    scores = {name: evaluator.score() for name, evaluator in evaluators.items()}
    return {name: {"hits": [_hit(*pair) for pair in score.outcomes], "false": score.false_alarms} for name, score in scores.items()}


def _hit(segment: TruthSegment, found: RecognisedGesture | None) -> bool:
    return found is not None and found.label == segment.label


def performed(seed: int, duration: float, keep: Path | None) -> dict[str, Any]:
    """Run the scene of a seed, or read what it gave before with the same configuration and sources."""
    scene = gesture_stream(seed, duration, brief)
    if keep is None:
        return perform(scene)
    told = digest([plain(scene), cases(), BURST, sources(PACKAGES)])
    return dict(once(keep / f"lost_chirps_{told}.json", lambda: perform(scene)))


def gestures(quick: bool, keep: Path | None) -> dict[str, Any]:
    """Gestures that are recognised without loss and are lost with it, for each case."""
    seeds, duration = ((SEEDS[0],), 1.0) if quick else (SEEDS, DURATION)
    parts = [performed(seed, duration, keep) for seed in seeds]
    known = {name: np.concatenate([np.array(part[name]["hits"], np.bool_) for part in parts]) for name in cases()}
    table = {}
    for name, hits in known.items():
        lost, n = int(np.sum(known["none"] & ~hits)), int(known["none"].sum())
        table[name] = {
            "recognised": float(hits.mean()) if len(hits) else 0.0,
            "lost": lost / n if n else 0.0,
            "lost_interval": share_interval(lost, n),
            "gained": int(np.sum(~known["none"] & hits)),
            "false": sum(part[name]["false"] for part in parts),
        }
    return {"performed": len(known["none"]), "recognised_without_loss": int(known["none"].sum()), "cases": table}


def rows(n: int, repeat: int) -> list[dict[str, Any]]:
    """Floors over ``n`` frames of each kind beside the times of ``repeat`` frames, for every choice at every rate of `PANELS`."""
    made = []
    for rate, panel in PANELS.items():
        times = {f"missing={method}": baseband_ms(method, rate, repeat) for method in METHODS}
        floors = {f"missing={method}": worst_floor_db(method, rate, n)["worst"] for method in METHODS}
        made += panel.rows(floors, times | {"": times[_ZERO]})
    return made


def figures(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Measure what lost chirps cost."""
    default, n = SpectrumConfig().missing, 2 if quick else 400
    floors = {f"{rate:g}": worst_floor_db(default, rate, n) for rate in RATES}
    found = gestures(quick, keep)
    result: dict[str, Any] = {"lost_chirps_floor_db": floors, "lost_chirps_gestures": found}
    for rate in RATES:
        both = [found["cases"][f"{default} {rate:g} {kind}"] for kind in KINDS]
        worse = max(both, key=lambda case: case["lost"])
        key = f"lost_chirps_{100 * rate:g}pct"
        result |= {f"{key}_floor_db": floors[f"{rate:g}"]["worst"], f"{key}_gestures_lost": worse["lost"]}
        result[f"{key}_gestures_lost_interval"] = worse["lost_interval"]
    return result | {"choices": rows(*((2, 5) if quick else (60, 200)))}
