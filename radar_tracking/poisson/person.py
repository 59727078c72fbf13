"""Person, or reflection, fan, pet or flicker: log odds from how a track has looked within the last seconds."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.poisson.inertia import inertia, note_series
from radar_tracking.poisson.kernels import Shares, behind, unexplained
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import Table

LOOK_TIME: Final = 3.0  # s: looks are averaged over this
_FAST: Final = 2.0  # m/s: a body has few points that are faster; blades of fans have many
_MIDDLE, _MIDDLE_WITHIN, _MOST_OFF = 0.95, 0.25, 1.0  # m: heights of bodies' centres; what is farther off says no more
_TALL, _MOST_TALL = 0.5, 0.8  # m: spread of a body's heights at most; what is wider says no more
_SNR: Final = (5.0, 20.0)  # dB: between which strength says anything
_MOST_FAST: Final = 0.2
_MOST_WENT: Final = 2.0  # m
_ON_THE_SPOT, _MOST_STUCK = 2.5, 3.0  # m: within `moved`'s time; what is more says no more

_FAITHFUL: Final = 0.8  # m: range rates lead people to where they are, within this
MOVED_TIME: Final = 6.0  # s: ways and mean places are of so long
_LONGEST: Final = 0.4  # s: range rates say no more about what came before
_WEAK: Final = (0.0, 6.0)  # dB: weaker than a body by less is no image, by more may be one
_CLOSE: Final = 0.8  # m: images by way of walls are farther from their cause
_LAW: Final = (-10.0, 20.0)  # dB: how much weaker than a body; what is beyond says no more
_FAINT: Final = -10.0  # dB at 2 m: echoes that would be weaker from there are no body's, but interference or an insect before the sensor
_ALONE: Final = (0.02, 5.0, 0.3)  # m: least and largest way alone that says anything, and the one that says nothing

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
CONSTANT: Final = -0.3
COEFFICIENTS: Final = (
    0.42, 0.13, -5.49, -5.52, -5.19, -0.97, -0.62, -2.74, -0.12, 0.6, 0.42, -0.08, -3.32, -2.0,
    -2.76, 1.52, 0.71, 1.74, -1.85, 5.14,
)  # fmt: skip
"""Of `FEATURES`, by logistic regression on random rooms and recordings for development: ``python -m benchmarks person_odds``. The
constant is 0.3 lower than fitted: fewer ghosts for people who are found a little later. ``creep`` was chosen by hand. The last six were
fitted while the others kept their values, on 36 rooms, in steps by hand; ``inertia_held`` of the same command fits them so on its own."""


def note_look(
    table: Table, measured: Measured, shares: Shares, dt: float, origin: Float64Array, least_odds: float, body_height: float
) -> None:
    """Average how tracks look: points, strengths, fast points, and heights, where they are measured; and who moves alone.

    ``origin``, shape (3,), is where the sensor is; tracks with ``least_odds`` may throw reflections, and echo at ``body_height`` [m].
    """
    rows, share = table.rows, 1.0 - math.exp(-dt / LOOK_TIME)
    own = shares.whole.T
    known, speed = np.isfinite(measured.height), np.abs(measured.rate)
    height = np.where(known, measured.height, 0.0)
    columns = (np.ones(len(measured)), measured.snr, speed > _FAST, known, height, height**2)
    rows["look"] += share * (own @ np.column_stack(columns) - rows["look"])
    note_series(table, measured, shares, dt, origin)
    torso = shares.torso.sum(axis=0)
    now = np.where(torso > 0.3, (speed @ shares.torso) / np.maximum(torso, 1e-9), 0.0)
    away, strength = table.mean[:, :2] - origin[:2], _strength(table)
    place = np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0])
    way = np.where(now > measured.still_speed, now * dt, 0.0)
    rows["total"] += way
    rate = np.where(torso > 0.3, (measured.rate @ shares.torso) / np.maximum(torso, 1e-9), 0.0)
    rows["drift"] = rows["drift"] * math.exp(-dt / MOVED_TIME) + rate * min(dt, _LONGEST)
    unsure = 0.5 * np.sqrt(np.maximum(table.covariance[:, 2, 2], table.covariance[:, 3, 3]))
    x, y, vx, vy = np.column_stack([away, table.mean[:, 2:4]]).T.copy()
    alone = unexplained(x, y, vx, vy, rate, unsure)
    table.ways += alone * (np.where(torso > 0.3, 1.0, 0.0) * min(dt, _LONGEST))[:, None]
    found = behind(*place, strength, rows["odds"] >= least_odds, table.ways, origin[2], body_height)
    rows["behind"], rows["same"], rows["floor"], rows["law"], rows["alone"] = found


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
    rows = table.rows
    points, snr, fast, known, height, square = rows["look"].T
    amount, told = np.maximum(points, 1e-9), np.maximum(known, 1e-9)
    middle = height / told
    tall = np.sqrt(np.maximum(square / told - middle**2, 0.0))
    measured = known > 0.2 * amount
    low, high, usual = _ALONE
    alone, suspect = np.log(np.clip(rows["alone"], low, high) / usual), _suspect(table, measured)
    return np.column_stack(
        [
            np.log(points + 0.1),
            np.clip(snr / amount, *_SNR),
            np.where(measured, np.clip(np.abs(middle - _MIDDLE) - _MIDDLE_WITHIN, 0.0, _MOST_OFF), 0.0),
            np.where(measured, np.clip(tall - _TALL, 0.0, _MOST_TALL), 0.0),
            np.minimum(fast / amount, _MOST_FAST),
            rows["behind"] * suspect,
            rows["same"] * suspect,
            rows["floor"] * suspect,
            np.where(rows["behind"], np.clip(rows["law"], *_LAW), 0.0),
            np.where(rows["behind"], np.where(alone < 0.0, alone * suspect, alone), 0.0),
            np.log((rows["hits"] + 0.05) / (1.05 - rows["hits"])),
            np.minimum(went(table), _MOST_WENT),
            _stuck(table),
            _creep(table),
            inertia(table),
        ]
    )


def _suspect(table: Table, measured: BoolArray) -> Float64Array:
    """How much a track behind another may be its image, 0 to 1, shape (n_tracks,); ``measured``: whose heights are.

    Mirrors take power, so that of two close together the one behind is no image if it is as strong as a body there. Farther images by way
    of walls may be strong for a while, and without heights echoes by the floor, which add up, pass for bodies.
    """
    weak = np.clip((table.rows["law"] - _WEAK[0]) / (_WEAK[1] - _WEAK[0]), 0.0, 1.0)
    return np.where(measured & (table.gaps().min(axis=1, initial=np.inf) < _CLOSE), weak, 1.0)


def person_odds(table: Table) -> Float64Array:
    """Log odds that a track is a person and nothing else that moves, shape (n_tracks,)."""
    return np.asarray(CONSTANT + features(table) @ np.array(COEFFICIENTS))


def _stuck(table: Table) -> Float64Array:
    """How far range rates say that tracks went, beyond what people do on the spot, who stay where they are, shape (n_tracks,) [m]."""
    on_the_spot = table.rows["moved"] / (1.0 + 2.0 * np.hypot(*(table.mean[:, :2] - table.rows["haunt"]).T))
    return np.asarray(np.clip(on_the_spot - _ON_THE_SPOT, 0.0, _MOST_STUCK))


def _creep(table: Table) -> Float64Array:
    """How far tracks are from where range rates say that they went along the line of sight, more than bodies are, shape (n_tracks,) [m].

    Blades of a fan that come and go on either side of its axis have range rates that lead nowhere.
    """
    moved = ((table.mean[:, :2] - table.rows["haunt"]) * table.rows["sight"]).sum(axis=1)
    return np.asarray(np.clip(np.abs(table.rows["drift"] - moved) - _FAITHFUL, 0.0, _MOST_STUCK))


def went(table: Table) -> Float64Array:
    """How far tracks are from where they began, shape (n_tracks,) [m]."""
    return np.asarray(np.hypot(*(table.mean[:, :2] - table.rows["birthplace"]).T))
