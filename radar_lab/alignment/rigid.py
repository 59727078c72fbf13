"""The rigid motion that takes points of one sensor's frame to those of another, with errors in both (least squares, not Procrustes)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_core.linalg import canonical_svd
from radar_core.types import Float64Array
from radar_lab.alignment.solver import Freedom, Linear, NotObservableError, SolverConfig, solve

_TRIALS = 200  # smallest samples for the start: one without an outlier among them is certain when half of the pairs are good
_JUDGED = 2000  # pairs that judge them
_FEW = 100  # pairs up to which samples are drawn without repetition
_CENTRED = 1e-9  # of a spread: below it points coincide


@config
class RigidConfig(SolverConfig):
    """How two sets of points are aligned."""

    freedom: Freedom = knob("yaw", doc="yaw: turn about z only, for levelled sensors; full: any turn in space")


@dataclass(frozen=True, eq=False)
class Motion:
    """A rigid motion that was measured: target = rotation source + translation."""

    rotation: Float64Array  # vectors of the source's frame to the target's, shape (d, d)
    translation: Float64Array  # where the source's origin is in the target's frame, shape (d,) [m]
    # Of the p parameters: x, y, (z), then yaw, or roll, pitch, yaw: small turns about the target's axes; then others that were estimated
    names: tuple[str, ...]
    covariance: Float64Array  # of these, shape (p, p) [m, rad, s]
    weight: Float64Array  # how much each pair counts, 0..1, shape (n,)
    residual: Float64Array  # target minus moved source, shape (n, d) [m]
    scale: float  # standard deviations of the points are this many times those given
    rank: int  # of the problem: always p; less is refused
    condition: float  # condition number of the equilibrated problem

    @property
    def yaw(self) -> float:
        """Turn about z, from the source's x to the target's [rad]."""
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of every parameter, by name [m, rad, s]."""
        return dict(zip(self.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))

    @property
    def inlier_share(self) -> float:
        """Share of pairs that count at least half."""
        return float((self.weight >= 0.5).mean())

    @property
    def rms(self) -> float:
        """Root mean square length of the residuals of pairs that count at least half [m]; NaN: there are none."""
        good = self.weight >= 0.5
        return float(np.sqrt((self.residual[good] ** 2).sum(axis=-1).mean())) if good.any() else math.nan

    def part(self, names: Sequence[str]) -> Float64Array:
        """Covariance of some parameters, shape (len(names), len(names))."""
        index = [self.names.index(name) for name in names]
        return self.covariance[np.ix_(index, index)]

    def apply(self, points: Float64Array) -> Float64Array:
        """Move points of the source's frame, shape (..., d) [m], to the target's."""
        return np.asarray(points @ self.rotation.T + self.translation)


@dataclass(frozen=True, eq=False)
class Rigid(Motion):
    """What `align_points` found, in ``iterations``; its covariance is for errors that are independent from point to point."""

    iterations: int


def align_points(
    source: Float64Array,
    target: Float64Array,
    source_covariance: Float64Array,
    target_covariance: Float64Array,
    config: RigidConfig | None = None,
) -> Rigid:
    """Find the rigid motion between corresponding points.

    Iterated least squares on the residuals' covariances, those of the target plus those of the source turned into its frame. The start
    comes from small samples of pairs that fit most others best (least median of squares): up to half of the pairs may be wrong.

    Parameters
    ----------
    source, target : ndarray, shape (n, d)
        Corresponding points, d = 2 or 3 [m].
    source_covariance, target_covariance : ndarray, shape (n, d, d) or (d, d)
        Of their errors [m^2]; their sum has to be positive definite.
    config : RigidConfig or None
        Knobs.

    Raises
    ------
    NotObservableError
        When the points leave a degree of freedom open: a single point, points at one place, or, for a full turn, on one line.
    DataError
        When shapes differ, or an entry is not finite.
    """
    config = config or RigidConfig()
    source, source_covariance = check_points("source", source, source_covariance)
    target, target_covariance = check_points("target", target, target_covariance)
    if source.shape != target.shape:
        raise DataError(f"source has shape {source.shape} but target {target.shape}; give corresponding points")
    d = source.shape[1]
    names = parameter_names(d, config.freedom)
    refuse_few(source, target, len(names), d)
    total = source_covariance + target_covariance
    state = start(source, target, np.sqrt(np.trace(total, axis1=1, axis2=2) / d), config.freedom)

    def linearise(at: tuple[Float64Array, Float64Array]) -> Linear:
        rotation, translation = at
        turned = source @ rotation.T
        jacobian, turning = rigid_jacobian(turned, names)
        own = rotation @ source_covariance @ rotation.T
        covariance = own + target_covariance
        return Linear(target - turned - translation, jacobian, covariance, noise_information(turning, covariance, own))

    solution = solve(state, names, linearise, moved, np.full(len(names), math.inf), lambda _: np.zeros(len(names)), config, advice)
    rotation, translation = solution.state
    found = (solution.weight, solution.linear.residual, solution.scale, solution.rank, solution.condition, solution.iterations)
    return Rigid(rotation, translation, names, solution.covariance, *found)


def check_points(name: str, position: Float64Array, covariance: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Check points, shape (n, d), and their covariances, else raise `DataError`; float64, one covariance for each, shape (n, d, d)."""
    position, covariance = np.asarray(position, np.float64), np.asarray(covariance, np.float64)
    if position.ndim != 2 or position.shape[1] not in (2, 3):
        raise DataError(f"{name} positions have shape {position.shape}; expected (n, 2) or (n, 3)")
    n, d = position.shape
    if covariance.shape == (d, d):
        covariance = np.broadcast_to(covariance, (n, d, d))
    require_shape(f"{name} covariance", covariance, (n, d, d))
    require_finite(f"{name} positions", position)
    require_finite(f"{name} covariance", covariance)
    if len(position) and np.abs(position).max() > 1e9:
        raise DataError(f"{name} positions reach {np.abs(position).max():.3g} m; give metres, at most 1e9")
    return position, covariance


def parameter_names(d: int, freedom: str) -> tuple[str, ...]:
    """Names of the parameters of a motion in d dimensions."""
    turns = ("roll", "pitch", "yaw") if d == 3 and freedom == "full" else ("yaw",)
    return ("x", "y", "z")[:d] + turns


def refuse_few(source: Float64Array, target: Float64Array, p: int, d: int) -> None:
    """Raise `NotObservableError` for fewer points than parameters need, and for points at one place."""
    turns = ["roll", "pitch", "yaw"] if p == 6 else ["yaw"]
    needed = 3 if p == 6 else 2
    if len(source) < needed:
        raise NotObservableError(f"{' and '.join(turns)}: there are {len(source)} pairs of points; at least {needed} are needed", turns)
    for name, points in (("source", source), ("target", target)):
        size = np.ptp(points, axis=0).max()
        if size <= _CENTRED * max(1.0, float(np.abs(points).max())):
            raise NotObservableError(f"{' and '.join(turns)}: all points of the {name} coincide; {advice(turns)}", turns)


def advice(names: Sequence[str]) -> str:
    """Say what to do about parameters that cannot be told."""
    if "roll" in names or "pitch" in names:
        return "points on one line leave a turn about it open: move in all directions, up and down too, or choose freedom yaw"
    return "move through the room, at least ten times farther than a single position is wrong"


def rigid_jacobian(turned: Float64Array, names: Sequence[str]) -> tuple[Float64Array, Float64Array]:
    """How moved points change with the p parameters.

    Parameters
    ----------
    turned : ndarray of float64, shape (n, d)
        Points after the rotation, before the translation [m].
    names : sequence of str
        Of the parameters.

    Returns
    -------
    jacobian, turning : ndarray of float64, shapes (n, d, p), (p, d, d)
        Of the moved points; the same as a linear function of the turned point, zero for translations.
    """
    d = turned.shape[1]
    turning = np.zeros((len(names), d, d))
    for k, name in enumerate(names[d:], start=d):
        i, j = {"roll": (1, 2), "pitch": (2, 0), "yaw": (0, 1)}[name]
        turning[k, i, j], turning[k, j, i] = -1.0, 1.0
    jacobian = np.einsum("kij,nj->nik", turning, turned)
    jacobian[:, np.arange(d), np.arange(d)] += 1.0
    return jacobian, turning


def noise_information(turning: Float64Array, covariance: Float64Array, own: Float64Array) -> Float64Array:
    """Compute what errors of the points themselves pretend to tell of the parameters, shape (p, p), see `solver.Linear`.

    Parameters
    ----------
    turning : ndarray of float64, shape (p, d, d)
        See `rigid_jacobian`.
    covariance, own : ndarray of float64, shape (n, d, d)
        Of the residuals, and of the turned points alone [m^2].
    """
    try:
        weighted = np.linalg.solve(covariance[None], turning[:, None] @ own[None])
    except np.linalg.LinAlgError:
        raise DataError("a covariance of the samples is not positive definite; give every sample an error") from None
    return np.asarray(np.einsum("kij,lnij->kl", turning, weighted))


def moved(state: tuple[Float64Array, Float64Array], step: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Add a step, shape (p,), to a rotation and a translation."""
    rotation, translation = state
    d = len(translation)
    turn = np.concatenate([np.zeros(3 + d - len(step)), step[d:]])
    return Rotation.from_rotvec(turn).as_matrix()[:d, :d] @ rotation, translation + step[:d]


def closed_form(source: Float64Array, target: Float64Array, freedom: str) -> tuple[Float64Array, Float64Array]:
    """Rotation (..., d, d) and translation (..., d) with the least unweighted squares (Kabsch 1976), of one set of points or of many.

    Parameters
    ----------
    source, target : ndarray of float64, shape (..., n, d)
        Corresponding points [m].
    freedom : str
        ``yaw`` or ``full``.
    """
    d = source.shape[-1]
    a, b = source.mean(axis=-2), target.mean(axis=-2)
    H = np.swapaxes(source - a[..., None, :], -1, -2) @ (target - b[..., None, :])
    if d == 2 or freedom == "yaw":
        angle = np.arctan2(H[..., 0, 1] - H[..., 1, 0], H[..., 0, 0] + H[..., 1, 1])
        rotation = np.zeros((*H.shape[:-2], d, d))
        rotation[..., 0, 0] = rotation[..., 1, 1] = np.cos(angle)
        rotation[..., 1, 0], rotation[..., 0, 1] = np.sin(angle), -np.sin(angle)
        if d == 3:
            rotation[..., 2, 2] = 1.0
    else:
        U, _, Vt = canonical_svd(H)
        V = np.swapaxes(Vt, -1, -2).copy()
        V[..., :, 2] *= np.where(np.linalg.det(U) * np.linalg.det(V) < 0, -1.0, 1.0)[..., None]
        rotation = V @ np.swapaxes(U, -1, -2)
    return rotation, b - (rotation @ a[..., None])[..., 0]


def start(source: Float64Array, target: Float64Array, std: Float64Array, freedom: str, seed: int = 0) -> tuple[Float64Array, Float64Array]:
    """Find a motion that half of the pairs agree with (least median of squares over small samples, Rousseeuw 1984).

    ``source`` and ``target``, shape (n, d) [m], are corresponding points, ``std``, shape (n,), that of their differences [m]; ``freedom``
    is ``yaw`` or ``full``.
    """
    n, d = source.shape
    size = min(n, 4 if d == 3 and freedom == "full" else 3)
    rng = np.random.default_rng(seed)
    judged = np.arange(n) if n <= _JUDGED else np.sort(rng.choice(n, _JUDGED, replace=False))
    pick = np.argsort(rng.random((_TRIALS, n)), axis=1, kind="stable")[:, :size] if n <= _FEW else rng.integers(0, n, (_TRIALS, size))
    rotation, translation = closed_form(source[pick], target[pick], freedom)
    step = target[judged] - (source[judged] @ np.swapaxes(rotation, -1, -2) + translation[:, None])
    ratio = np.sqrt((step * step).sum(-1)) / np.maximum(std[judged], 1e-300)
    middle = np.median(ratio, axis=1)
    best = int(np.argmin(middle))
    good = judged[ratio[best] <= 2.5 * max(float(middle[best]), 1e-12)]
    return closed_form(source[good], target[good], freedom) if len(good) >= size else (rotation[best], translation[best])
