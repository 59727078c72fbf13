"""Person, or reflection, fan, pet or flicker: log odds from how a track has looked within the last seconds."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.poisson.inertia import note_inertia, note_series
from radar_tracking.poisson.kernels import Shares, behind, unexplained
from radar_tracking.poisson.table import Table

LOOK_TIME: Final = 3.0  # s: looks are averaged over this
_MIDDLE, _MIDDLE_WITHIN, _MOST_OFF = 0.95, 0.25, 1.0  # m: heights of bodies' centres; what is farther off says no more
_TALL, _MOST_TALL = 0.5, 0.8  # m: spread of a body's heights at most; what is wider says no more
_SNR: Final = (5.0, 20.0)  # dB: between which strength says anything
_MOST_FAST: Final = 0.2
_MOST_WENT: Final = 2.0  # m
_ON_THE_SPOT, _MOST_STUCK = 2.5, 3.0  # m: within `moved`'s time; what is more says no more

_FAITHFUL: Final = 0.8  # m: range rates lead people to where they are, within this
MOVED_TIME: Final = 6.0  # s: ways and mean places are of so long
_THERE: Final = 0.3  # of a torso point, that tells how a track moves
_LONGEST: Final = 0.4  # s: range rates say no more about what came before
_WEAK: Final = (0.0, 6.0)  # dB: weaker than a body by less is no image, by more may be one
_CLOSE: Final = 0.8  # m: images by way of walls are farther from their cause
_LAW: Final = (-10.0, 20.0)  # dB: how much weaker than a body; what is beyond says no more
_FAINT: Final = -10.0  # dB at 2 m: echoes that would be weaker from there are no body's, but interference or an insect before the sensor
_ALONE: Final = (0.02, 5.0, 0.3)  # m: least and largest way alone that says anything, and the one that says nothing

_jit = numba.njit(cache=True, nogil=True)

FEATURES: Final = (
    "points", "snr", "height", "tall", "fast", "behind", "same", "floor", "law", "alone", "hits", "went", "stuck", "creep",
    "rests", "range", "azimuth", "power", "stirs", "rate",
)  # fmt: skip
"""Logarithm of the points of a cloud; strength [dB]; how far the middle is from a body's, and how much taller the track is than one [m];
share of fast points; whether it lies behind a stronger track, and in that one's direction; how well it fits the echo of such a track by way
of the floor; how much weaker it is than a body at its distance [dB]; logarithm of its least way that is no reflection of such a track (of
these, what speaks for an image counts as far as `_suspect` says);
log odds of a cloud with points; way from where it began [m]; how much farther it should be from where it was, by its range rates, than on
the spot people ever are [m]; how far the place to which its range rates lead is from where it is [m]; and those of `inertia`."""
CONSTANT: Final = 0.97
COEFFICIENTS: Final = (
    0.70, 0.06, -6.41, -2.50, -7.15, -0.69, -0.61, -4.32, -0.12, 0.60, 0.41, -0.41, -1.43, -0.81,
    -2.76, 1.61, 0.28, 1.56, -1.69, 5.14,
)  # fmt: skip
"""Of `FEATURES`, by logistic regression on random rooms, simulated lives and recordings for development: ``python -m benchmarks
person_odds``, which begins with what stood here before. That came from rooms and recordings alone, in which people walk in: who stands from
the start was refused."""


def note_look(
    table: Table, shares: Shares, still_speed: float, dt: float, origin: Float64Array, least_odds: float, body_height: float
) -> None:
    """Average how tracks look: points, strengths, fast points, and heights, where they are measured; and who moves alone.

    Speeds up to ``still_speed`` [m/s] are none; ``origin``, shape (3,), is where the sensor is; tracks with ``least_odds`` may throw
    reflections, and echo at ``body_height`` [m].
    """
    rows = table.rows
    _look(rows, shares.sums, still_speed, dt)
    note_series(rows, shares.sums, dt, origin[0], origin[1])
    torso = shares.sums["torso"]
    there = torso > _THERE
    rate = shares.sums["torso_rate"] / np.where(there, torso, np.inf)
    away, strength = table.mean[:, :2] - origin[:2], _strength(table)
    place = np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0])
    unsure = 0.5 * np.sqrt(np.maximum(table.covariance[:, 2, 2], table.covariance[:, 3, 3]))
    x, y, vx, vy = np.column_stack([away, table.mean[:, 2:4]]).T.copy()
    alone = unexplained(x, y, vx, vy, rate, unsure)
    table.ways += alone * (there * min(dt, _LONGEST))[:, None]
    found = behind(*place, strength, rows["odds"] >= least_odds, table.ways, origin[2], body_height)
    rows["behind"], rows["same"], rows["floor"], rows["law"], rows["alone"] = found


@_jit
def _look(rows: Any, sums: Any, still_speed: float, dt: float) -> None:
    """Average how tracks look, and add up ways and range rates."""
    share, fading = 1.0 - math.exp(-dt / LOOK_TIME), math.exp(-dt / MOVED_TIME)
    for i in range(len(rows)):
        row, one = rows[i], sums[i]
        seen = (one.points, one.snr, one.fast, one.known, one.height, one.square)
        for k in range(6):
            row.look[k] += share * (seen[k] - row.look[k])
        row.drift *= fading
        if one.torso > _THERE:
            speed = one.torso_speed / one.torso
            row.total += speed * dt if speed > still_speed else 0.0
            row.drift += one.torso_rate / one.torso * min(dt, _LONGEST)


def _strength(table: Table) -> Float64Array:
    """Of all points of a cloud together, shape (n_tracks,) [dB]."""
    points, snr = table.rows["look"][:, 0], table.rows["look"][:, 1]
    return np.asarray(snr / np.maximum(points, 1e-9) + 10.0 * np.log10(np.maximum(points, 1e-3)))


def faint(table: Table, origin: Float64Array, body_height: float) -> BoolArray:
    """Which tracks echo too weakly for bodies so near to the sensor at ``origin``, shape (n_tracks,)."""
    flat = np.hypot(*(table.mean[:, :2] - origin[:2]).T)
    return np.asarray(_strength(table) < _FAINT + 40.0 * np.log10(2.0 / np.maximum(np.hypot(flat, origin[2] - body_height), 0.1)))


def features(table: Table) -> Float64Array:
    """`FEATURES` of all tracks, shape (n_tracks, 20)."""
    found = np.zeros((len(table), len(FEATURES)))
    _features(table.rows, table.mean, found)
    return found


@_jit
def _features(rows: Any, mean: Any, found: Any) -> None:
    for i in range(len(rows)):
        row, out = rows[i], found[i]
        points, amount, known = row.look[0], max(row.look[0], 1e-9), max(row.look[3], 1e-9)
        middle, measured = row.look[4] / known, row.look[3] > 0.2 * amount
        out[0] = math.log(points + 0.1)
        out[1] = _within(row.look[1] / amount, _SNR[0], _SNR[1])
        if measured:
            tall = math.sqrt(max(row.look[5] / known - middle * middle, 0.0))
            out[2] = _within(abs(middle - _MIDDLE) - _MIDDLE_WITHIN, 0.0, _MOST_OFF)
            out[3] = _within(tall - _TALL, 0.0, _MOST_TALL)
        out[4] = min(row.look[2] / amount, _MOST_FAST)
        suspect = _suspect(row.law, _near(mean, i)) if measured else 1.0
        out[5], out[6], out[7] = row.behind * suspect, row.same * suspect, row.floor * suspect
        if row.behind:
            alone = math.log(_within(row.alone, _ALONE[0], _ALONE[1]) / _ALONE[2])
            out[8], out[9] = _within(row.law, _LAW[0], _LAW[1]), alone * suspect if alone < 0.0 else alone
        out[10] = math.log((row.hits + 0.05) / (1.05 - row.hits))
        out[11] = min(math.hypot(mean[i, 0] - row.birthplace[0], mean[i, 1] - row.birthplace[1]), _MOST_WENT)
        dx, dy = mean[i, 0] - row.haunt[0], mean[i, 1] - row.haunt[1]
        out[12] = _within(row.moved / (1.0 + 2.0 * math.hypot(dx, dy)) - _ON_THE_SPOT, 0.0, _MOST_STUCK)
        out[13] = _within(abs(row.drift - dx * row.sight[0] - dy * row.sight[1]) - _FAITHFUL, 0.0, _MOST_STUCK)
        note_inertia(row, out[14:])


@_jit
def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@_jit
def _near(mean: Any, row: int) -> float:
    """Distance of the nearest other track [m]."""
    least = math.inf
    for k in range(len(mean)):
        if k != row:
            least = min(least, math.hypot(mean[k, 0] - mean[row, 0], mean[k, 1] - mean[row, 1]))
    return least


@_jit
def _suspect(law: float, near: float) -> float:
    """How much a track behind another, whose heights are measured, may be its image, 0 to 1.

    Mirrors take power, so that of two close together the one behind is no image if it is as strong as a body there. Farther images by way
    of walls may be strong for a while, and without heights echoes by the floor, which add up, pass for bodies.
    """
    return _within((law - _WEAK[0]) / (_WEAK[1] - _WEAK[0]), 0.0, 1.0) if near < _CLOSE else 1.0


def person_odds(table: Table) -> Float64Array:
    """Log odds that a track is a person and nothing else that moves, shape (n_tracks,)."""
    return np.asarray(CONSTANT + features(table) @ np.array(COEFFICIENTS))


def went(table: Table) -> Float64Array:
    """How far tracks are from where they began, shape (n_tracks,) [m]."""
    return np.asarray(np.hypot(*(table.mean[:, :2] - table.rows["birthplace"]).T))
