"""The compiled loops over points and tracks; numpy oracles are in the tests."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.sums import summed

FASTEST: Final = 4.0  # m/s: range rates of clutter are spread evenly up to here
_FAR: Final = 3.0  # m: nobody has points beyond
_OCCLUDER, _BESIDE, _BEHIND = 0.3, 0.05, 0.2  # m, rad, m: half a body's width, error of direction, least distance
_SHARPER = 4.0
_SAME_DIRECTION, _APART = 0.35, 0.3  # rad, m: of a reflection and its cause
_FLOOR_STD, _FLOOR_TURN = 0.2, 0.1  # m, rad: spread of echoes by way of the floor, since bodies echo at all heights
_RATE_ERROR, _ACROSS_ERROR, _SHARE_ERROR = 0.1, 0.3, 0.2  # m/s and of a body's speed: by which velocities of reflections are off
_NEAREST: Final = 0.3  # m: strengths fall with the distance from here on
_jit = numba.njit(cache=True, nogil=True)


class Shares:
    """Whose points are, and what they say for each track.

    Attributes
    ----------
    torso, limb : ndarray of float64, shape (n_points, n_tracks)
        Probability that a point is of a track's torso, of its limbs; what is left of 1 is clutter.
    whole : ndarray of float64, shape (n_points, n_tracks)
        Both together.
    limb_density : ndarray of float64, shape (n_points,)
        Points of limbs that are expected there [1/m^2].
    count : ndarray of float64, shape (n_tracks,)
        Points of a track, if it exists.
    evidence : ndarray of float64, shape (n_tracks,)
        Logarithm of the likelihood ratio of the cloud with and without the track [nat].
    still : ndarray of float64, shape (n_points, n_tracks)
        How near still points are to the torso, furniture or not: 1 where it is.
    support : ndarray of float64, shape (n_tracks,)
        Their sum.
    sums : ndarray of `SUMS`, shape (n_tracks,)
        What the cloud says of each track.
    """

    def __init__(self, measured: Measured, clutter: Float64Array, state: TrackArrays, config: PoissonConfig) -> None:
        spreads = np.array(
            [config.torso_std, config.limb_std, config.limb_share, config.torso_speed, config.limb_speed, config.surface,
             measured.still_speed]
        )  # fmt: skip
        sight = (measured.x, measured.y, measured.ux, measured.uy, measured.speed, measured.still)
        errors = (measured.range_variance, measured.cross_variance)
        torso, limb, self.still = _densities(*sight, *errors, state.mean, state.covariance, spreads)
        self.support = self.still.sum(axis=0)
        self.torso, self.limb, self.limb_density, self.count, self.evidence = _share(
            torso, limb, clutter, state.rate, state.existence, state.confirmed
        )
        self.whole = self.torso + self.limb
        self.sums = summed(measured, self.whole, self.torso, self.still)


class TrackArrays:
    """Means, shape (n, 4) = (x, y, vx, vy), covariances, shape (n, 4, 4), rates [1/cloud], probabilities of existence, who is confirmed."""

    def __init__(
        self, mean: Float64Array, covariance: Float64Array, rate: Float64Array, existence: Float64Array, confirmed: BoolArray | None = None
    ) -> None:
        self.mean, self.covariance, self.rate, self.existence = mean, covariance, rate, existence
        self.confirmed = np.zeros(len(mean), np.bool_) if confirmed is None else confirmed


@_jit
def _share_within(speed: float, std: float, half: float) -> float:
    """Share of a normal distribution about ``speed`` within +-``half``."""
    scale = 1.0 / (std * math.sqrt(2.0))
    return 0.5 * (math.erf((half - speed) * scale) - math.erf((-half - speed) * scale))


@_jit
def _gauss(along: float, across: float, along_variance: float, across_variance: float) -> float:
    """Density of two independent normal variables [1/m^2]."""
    exponent = along * along / along_variance + across * across / across_variance
    return math.exp(-0.5 * exponent) / (2.0 * math.pi * math.sqrt(along_variance * across_variance))


@_jit
def _rate_factor(speed: float, still: bool, expected: float, variance: float, half: float) -> float:
    """How much more likely a range rate is than clutter's: a share for still points, a ratio of densities for moving ones."""
    if still:
        return _share_within(expected, math.sqrt(variance), half)
    if math.isnan(speed):
        return 1.0
    variance += half * half / 3.0
    step = speed - expected
    return 2.0 * FASTEST * math.exp(-0.5 * step * step / variance) / math.sqrt(2.0 * math.pi * variance)


@_jit
def _densities(x: Any, y: Any, ux: Any, uy: Any, speed: Any, still: Any, along: Any, across: Any, mean: Any, P: Any, spreads: Any) -> Any:
    """Densities of each track's torso and limb points at each point, and how near its torso still ones are, shape (n_points, n_tracks)."""
    n, m = len(x), len(mean)
    torso, limb, near_still = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, m))
    torso_std, limb_std, share, torso_speed, limb_speed, surface, half = spreads
    for j in range(n):
        a, b = ux[j], uy[j]
        for i in range(m):
            dx, dy = x[j] - mean[i, 0], y[j] - mean[i, 1]
            if dx * dx + dy * dy > _FAR * _FAR:
                continue
            p = P[i]
            dr, dc = dx * a + dy * b + surface, -dx * b + dy * a
            rr = a * a * p[0, 0] + 2.0 * a * b * p[0, 1] + b * b * p[1, 1]
            cc = b * b * p[0, 0] - 2.0 * a * b * p[0, 1] + a * a * p[1, 1]
            vv = a * a * p[2, 2] + 2.0 * a * b * p[2, 3] + b * b * p[3, 3]
            expected = a * mean[i, 2] + b * mean[i, 3]
            body = torso_std * torso_std
            near = _gauss(dr, dc, body + along[j] + rr, body + across[j] + cc)
            torso[j, i] = (1.0 - share) * near * _rate_factor(speed[j], still[j], expected, torso_speed * torso_speed + vv, half)
            body = limb_std * limb_std
            wide = _gauss(dr, dc, body + along[j] + rr, body + across[j] + cc)
            limb[j, i] = share * wide * _rate_factor(speed[j], still[j], expected, limb_speed * limb_speed + vv, half)
            if still[j]:
                body = torso_std * torso_std
                near_still[j, i] = math.exp(-0.5 * (dr * dr / (body + along[j]) + dc * dc / (body + across[j])))
    return torso, limb, near_still


@_jit
def _share(torso: Any, limb: Any, clutter: Any, rate: Any, existence: Any, confirmed: Any) -> Any:
    """Divide points between tracks and clutter; count points and evidence of each track, given the others."""
    n, m = torso.shape
    total, limbs = clutter.copy(), np.zeros(n)
    for j in range(n):
        for i in range(m):
            total[j] += existence[i] * rate[i] * (torso[j, i] + limb[j, i])
            limbs[j] += existence[i] * rate[i] * limb[j, i]
    count, evidence = np.zeros(m), np.zeros(m)
    torso_share, limb_share = np.empty((n, m)), np.empty((n, m))
    for i in range(m):
        weight = existence[i] * rate[i]
        for j in range(n):
            own = torso[j, i] + limb[j, i]
            count[i] += rate[i] * own / (rate[i] * own + total[j] - weight * own)
            torso_share[j, i], limb_share[j, i] = weight * torso[j, i] / total[j], weight * limb[j, i] / total[j]
        # the rate of this cloud, by an exponential prior about the usual one; rates vary tenfold within seconds
        now = (1.0 + count[i]) * rate[i] / (1.0 + rate[i])
        for j in range(n):
            own = torso[j, i] + limb[j, i]
            if own > 0.0:
                evidence[i] += math.log(1.0 + now * own / (total[j] - weight * own))
        evidence[i] -= now + 0.5 * math.log(1.0 + rate[i])
    if confirmed.sum() > 1:
        _sharpen(torso_share, limb_share, confirmed)
    return torso_share, limb_share, limbs, count, evidence


@_jit
def _sharpen(torso: Any, limb: Any, confirmed: Any) -> None:
    """Give points of people more to the one who has most of them: equal shares of the same points would draw two together.

    Tentative tracks keep their shares, and so an arm that was taken for somebody is drawn back to its body.
    """
    n, m = torso.shape
    for j in range(n):
        total, power = 0.0, 0.0
        for i in range(m):
            if confirmed[i]:
                own = torso[j, i] + limb[j, i]
                total += own
                power += own**_SHARPER
        if power <= 0.0:
            continue
        for i in range(m):
            own = torso[j, i] + limb[j, i]
            if confirmed[i] and own > 0.0:
                factor = own ** (_SHARPER - 1.0) * total / power
                torso[j, i] *= factor
                limb[j, i] *= factor


def densest(measured: Measured, free: Float64Array, expected: Float64Array) -> tuple[float, int, BoolArray]:
    """Find the heap of moving points that is the greatest surprise.

    Parameters
    ----------
    measured : Measured
        The cloud.
    free : ndarray of float64, shape (n_points,)
        Share of each point that is of no torso.
    expected : ndarray of float64, shape (n_points,)
        Density of clutter and limbs [1/m^2].

    Returns
    -------
    score : float
        Surprise of a Poisson process, o ln(o/e) - o + e for o points where e are expected [nat]; negative: there is no heap.
    middle : int
        The point about which it lies.
    members : ndarray of bool, shape (n_points,)
        Its points.
    """
    columns = (measured.x, measured.y, measured.ux, measured.uy, measured.speed, measured.still)
    found: tuple[float, int, BoolArray] = _densest(
        *columns, np.sqrt(measured.range_variance), np.sqrt(measured.cross_variance), free, expected
    )
    return found


_HALF: Final = 0.35  # m: half of a heap's size along and across the line of sight, plus the error of one point
_SAME_SPEED: Final = 1.0  # m/s: range rates of a heap differ by no more
_FREE: Final = 0.3  # least free share of a heap's middle


@_jit
def _densest(x: Any, y: Any, ux: Any, uy: Any, speed: Any, still: Any, along: Any, across: Any, free: Any, expected: Any) -> Any:
    n = len(x)
    best, middle, members, inside = -1.0, -1, np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for j in range(n):
        if still[j] or free[j] < _FREE:
            continue
        deep, wide, count = _HALF + along[j], _HALF + across[j], 0.0
        for k in range(n):
            dx, dy = x[k] - x[j], y[k] - y[j]
            alike = not still[k] and not abs(speed[k] - speed[j]) > _SAME_SPEED  # NaN compares False: not measured
            inside[k] = alike and abs(dx * ux[j] + dy * uy[j]) < deep and abs(dy * ux[j] - dx * uy[j]) < wide
            if inside[k]:
                count += free[k]
        usual = 4.0 * deep * wide * expected[j] * _SAME_SPEED / FASTEST
        if count > usual:
            score = count * math.log(count / usual) - count + usual
            if score > best:
                best, middle = score, j
                members[:] = inside
    return best, middle, members


@_jit
def hidden(distance: Any, azimuth: Any, confirmed: Any) -> Any:
    """Which tracks a nearer person hides, by distances [m] and azimuths [rad] from the sensor, shape (n_tracks,) each."""
    n = len(distance)
    result = np.zeros(n, np.bool_)
    for i in range(n):
        for k in range(n):
            if k != i and confirmed[k] and distance[k] < distance[i] - _BEHIND:
                step = abs((azimuth[i] - azimuth[k] + math.pi) % (2.0 * math.pi) - math.pi)
                if step < _OCCLUDER / max(distance[k], _OCCLUDER) + _BESIDE:
                    result[i] = True
    return result


@_jit
def behind(distance: Any, azimuth: Any, strength: Any, likely: Any, ways: Any, height: float, body: float) -> Any:
    """Which tracks lie behind a likely, stronger one, and which in its direction, shape (n_tracks,) each.

    Of those: how well they fit the echo of one of these by way of the floor, for a sensor and bodies so high [m]; how much weaker they are
    than the strongest of these would be at their distance [dB]; and the least of ``ways``, shape (n_tracks, n_tracks), to any of these.
    """
    n = len(distance)
    far, same, floor, law, least = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        for k in range(n):
            if k != i and likely[k] and distance[i] > distance[k] + _APART and strength[k] > strength[i]:
                weaker = strength[k] - strength[i] - 40.0 * math.log10(distance[i] / max(distance[k], _NEAREST))
                law[i] = max(law[i], weaker) if far[i] else weaker
                least[i] = min(least[i], ways[i, k]) if far[i] else ways[i, k]
                far[i] = True
                turn = (azimuth[i] - azimuth[k] + math.pi) % (2.0 * math.pi) - math.pi
                same[i] = same[i] or abs(turn) < _SAME_DIRECTION
                step = distance[i] - _by_the_floor(distance[k], height, body)
                floor[i] = max(floor[i], math.exp(-0.5 * ((step / _FLOOR_STD) ** 2 + (turn / _FLOOR_TURN) ** 2)))
    return far, same, floor, law, least


@_jit
def _by_the_floor(distance: float, height: float, body: float) -> float:
    """Where an echo appears that takes the straight way and the one by the floor, on the floor plane [m]."""
    straight, mirrored = math.hypot(distance, height - body), math.hypot(distance, height + body)
    return math.sqrt(max((0.5 * (straight + mirrored)) ** 2 - (height - body) ** 2, 0.0))


@_jit
def unexplained(x: Any, y: Any, vx: Any, vy: Any, rate: Any, unsure: Any) -> Any:
    """How much faster tracks move than as reflections of each other, shape (n_tracks, n_tracks) [m/s]: the first as the second's.

    ``x``, ``y`` from the sensor [m], ``vx``, ``vy`` [m/s], measured range rates [m/s] and standard deviations of velocities [m/s], shape
    (n_tracks,) each. A flat wall between a body and its image, upright and halfway, mirrors the body's velocity; an echo that takes the
    wall one way only is the mean of body and image, and comes from the one's direction or the other's.
    """
    n = len(x)
    result = np.zeros((n, n))
    for i in range(n):
        far = max(math.hypot(x[i], y[i]), _NEAREST)
        ux, uy = x[i] / far, y[i] / far
        across = -vx[i] * uy + vy[i] * ux
        for k in range(n):
            if i == k:
                continue
            near = max(math.hypot(x[k], y[k]), _NEAREST)
            speed, own, turn = math.hypot(vx[k], vy[k]), (vx[k] * x[k] + vy[k] * y[k]) / near, (vy[k] * x[k] - vx[k] * y[k]) / near**2
            along_error = _RATE_ERROR + _SHARE_ERROR * speed + unsure[k]
            across_error = _ACROSS_ERROR + _SHARE_ERROR * speed + unsure[k] + unsure[i]
            least = _excess(rate[i], across, x[i] - x[k], y[i] - y[k], vx[k], vy[k], ux, uy, own, 1.0, 1.0, along_error, across_error)
            whole = max(2.0 * far - near, near)  # how far the image is, if the echo's way is half of it
            dx, dy = whole * ux - x[k], whole * uy - y[k]
            least = min(least, _excess(rate[i], across, dx, dy, vx[k], vy[k], ux, uy, own, 0.5, far / whole, along_error, across_error))
            if abs((math.atan2(y[i], x[i]) - math.atan2(y[k], x[k]) + math.pi) % (2.0 * math.pi) - math.pi) < _SAME_DIRECTION:
                along = max(abs(rate[i] - 0.5 * own) - 0.5 * speed, 0.0) - along_error
                least = min(least, max(along, abs(across - far * turn) - across_error))
            result[i, k] = max(least, 0.0)
    return result


@_jit
def _excess(
    rate: float, across: float, dx: float, dy: float, vx: float, vy: float, ux: float, uy: float, own: float, share: float, lever: float,
    along_error: float, across_error: float,
) -> float:  # fmt: skip
    """How far velocities along and across (ux, uy) are from those of what moves as (vx, vy) does in an upright mirror that halves (dx, dy).

    Of ``share`` of the way the wall is part, the rest has the body's range rate; ``lever`` shortens distances across [m/s].
    """
    square = max(dx * dx + dy * dy, 1e-12)
    part = 2.0 * (vx * dx + vy * dy) / square
    wx, wy = vx - part * dx, vy - part * dy
    along = abs(rate - share * (wx * ux + wy * uy) - (1.0 - share) * own) - along_error
    return max(along, abs(across - lever * (wy * ux - wx * uy)) - across_error)
