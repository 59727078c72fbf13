"""Operations of each stage of the default chain: closed forms of the configuration, and of what a frame holds.

One addition, multiplication, comparison, division, root or transcendental function of real numbers counts as one operation, as in
`radar_lab.training.operations`. A transform of length n counts 5 n log2 n (radix 2; other lengths are counted as if they were one).
Transform, CFAR and directions are counted loop by loop. Of tracking, gestures and hand only what grows with points and tracks is, and the
matrices of the filters; of the classifier everything. What Python itself does for each call is no operation here, and is most of the time
of the last four.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from radar_core import RadarInfo
from radar_dsp import CfarConfig

STAGES: Final = ("transform", "cfar", "directions", "tracking", "gestures", "classifier", "hand")
"""Transform: both Fourier transforms and the integration over channels. CFAR: detection, noise level, interpolation. Directions: those of
the detections, and the cloud. Tracking: the cloud levelled, and people. Gestures: events, maps and features of all tracks. Classifier:
of one event. Hand: nothing until a gesture starts it."""
_ROUNDS: Final = 31  # most rounds of the search for an order statistic: it bisects the bits of a positive number
_INTERPOLATION: Final = 2 * 22 + 12  # per detection: on both axes two logarithms, a parabola and two tables; signal-to-noise ratio, scales
_CLOUD: Final = 30  # per detection: angles and bounds of direction cosines, Cartesian place, two logarithms
_NEWTON_CHANNEL: Final = 39  # per channel and step: phase 3, sine and cosine 2, turn 6, beam 2, first derivatives 8, second ones 18
_NEWTON_STEP: Final = 50  # per step: gradient and curvature 25, logarithm's 10, solution 8, limits 7
_DENSITY: Final = 108  # per point and track: ways 13, three variances 27, speed 3, two normal densities 32, two of range rates 24, shares 9
_SHARE: Final = 28 + 12  # per point and track: sums 7, counts 8, shares 4, evidence 9; and sharper ones 12
_HEAP: Final = 15  # per pair of points: distance 2, alike 3, along 5, across 5
_STATES: Final = (7, 3)  # of a person: states, and numbers measured
_MOTION: Final = 45  # per point of a track: its gate 3, whether it is arm 5, beside the body 8, amplitude 4, three medians 21, its map 4
_NEAR_BODY: Final = 4  # per pair of points of a track: whether a body's side lobes reach
_FEATURE: Final = 12  # per pair of samples of an event: windows of two averages; its medians are apart
_CANDIDATE: Final = 60  # per point that may be hand: line of sight 20, errors 10, amplitude 4, gate 26
_NUISANCES: Final = 4  # of a hand's velocity: three turns and one sensor
_TURNS: Final = 4  # most rounds of its weights


@dataclass(frozen=True)
class Load:
    """What the frames of a scene hold, on average over those frames that a stage works on."""

    located: float = 0.0  # detections whose direction is found
    pairs: float = 0.0  # points times tracks
    squares: float = 0.0  # points times points
    tracks: float = 0.0
    owned: float = 0.0  # points of all tracks
    owned_squares: float = 0.0  # sum over the tracks of their points squared
    samples: float = 0.0  # clouds of one event
    candidates: float = 0.0  # points that may be a hand, of frames with one
    hand_points: float = 0.0  # those that are
    hand_models: int = 0
    hand_states: int = 0


def transforms(info: RadarInfo) -> int:
    """Count the one-dimensional transforms of a frame: one over the samples of each chirp and channel, one over the chirps of each cell."""
    w, n_rx = info.waveform, info.array.n_rx
    return w.n_tx * n_rx * (w.n_chirp + w.n_sample)


def transform_flop(info: RadarInfo) -> float:
    """Window (2 a complex sample), transforms over range and speed, and mean power of the channels (4 a sample, 1 a cell)."""
    w = info.waveform
    n = w.n_tx * info.array.n_rx * w.n_chirp * w.n_sample
    return n * (2 + 5 * math.log2(w.n_sample) + 5 * math.log2(w.n_chirp) + 4) + w.n_chirp * w.n_sample


def training_cells(config: CfarConfig) -> int:
    """Count the cells of the two-dimensional window that are beyond its guard."""
    whole = (2 * (config.guard_speed + config.training_speed) + 1) * (2 * (config.guard_range + config.training_range) + 1)
    return whole - (2 * config.guard_speed + 1) * (2 * config.guard_range + 1)


def cfar_flop(info: RadarInfo, config: CfarConfig, located: float) -> float:
    """Rank test of every cell: a comparison and an addition for each training cell, its threshold, its rank; and what detections take.

    A detection's noise level is the order statistic of its training cells, by bisection: at most `_ROUNDS` times a comparison and an
    addition for each.
    """
    cells, training = info.waveform.n_chirp * info.waveform.n_sample, training_cells(config)
    return cells * (2 * training + 2) + located * (2 * training * _ROUNDS + _INTERPOLATION)


def directions_flop(n_channel: int, n_grid: int, steps: int, located: float) -> float:
    """Snapshot turned back (6 a channel) and scaled (10), beams on the grid (8 a channel and point, power and maximum 4), Newton steps."""
    grid = n_grid * (8 * n_channel - 2 + 4)
    return located * (16 * n_channel + grid + steps * (_NEWTON_CHANNEL * n_channel + _NEWTON_STEP) + _CLOUD)


def predict_flop(n: int) -> float:
    """Predict n states: F P F^T + Q."""
    return 4 * n**3 + n**2


def correct_flop(n: int, m: int) -> float:
    """Correct n states by m numbers in Joseph's form: gain, mean, and the two products of the covariance, one of them of half a matrix."""
    return 3 * n**3 + 5 * n**2 * m + 6 * n * m**2 + m**3 / 3


def tracking_flop(load: Load) -> float:
    """Likelihoods and shares of all points and tracks, one search for a heap among all points, and each track's filter."""
    n, m = _STATES
    return load.pairs * (_DENSITY + _SHARE) + load.squares * _HEAP + load.tracks * (predict_flop(n) + correct_flop(n, m))


def gestures_flop(load: Load) -> float:
    """Motion and maps of every track's points, as if half of them moved."""
    mean = load.owned / load.tracks if load.tracks else 0.0
    return load.owned * (_MOTION + 2 * math.log2(max(mean, 1.0))) + _NEAR_BODY * load.owned_squares / 4


def features_flop(load: Load) -> float:
    """Averages and running medians of one event, for each pair of its clouds: three signals are sorted over a window about each cloud."""
    return load.samples**2 * (2 * _FEATURE + 3 * (1 + math.log2(max(load.samples, 1.0))))


def hand_flop(load: Load) -> float:
    """Candidates, filters of all models, and at most `_TURNS` solutions for the velocity.

    One is a QR factorisation of the nuisances with its orthogonal factor, its projection, and a singular value decomposition with both
    sides (Golub and Van Loan, tables 5.2 and 8.6.1).
    """
    if not load.hand_models:
        return 0.0
    rows, m, d = load.hand_points + _NUISANCES, _NUISANCES, 3
    solution = 4 * rows * m**2 + 4 * rows * m * (d + 1) + 14 * rows * d**2 + 8 * d**3
    filters = load.hand_models * (predict_flop(load.hand_states) + correct_flop(load.hand_states, 2 * d + 1))
    return load.candidates * _CANDIDATE + _TURNS * solution + filters
