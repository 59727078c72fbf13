"""Robust least squares for a few parameters and many vector residuals: QR instead of normal equations, and it says what it cannot know."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np
from scipy.stats import chi2

from radar_core.checks import require_finite
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_core.linalg import SingularError, canonical_svd, first_max, symmetrise
from radar_core.types import Float64Array, IndexArray

S = TypeVar("S")

Loss = Literal["none", "huber", "tukey"]
Scale = Literal["given", "measured"]
Freedom = Literal["yaw", "full"]
_CUTOFF = {"none": math.inf, "huber": 2.0, "tukey": 5.0}  # standard deviations
_CONVERGED, _NEARLY = 1e-4, 0.05  # steps in standard deviations of the result; weights of few samples near a cutoff may dance
_EXACT = 1e-6  # of the given errors: smaller residuals are rounding errors
_PRIOR = 20  # see `correlated_covariance`
_MEDIAN = {d: float(chi2.median(d)) for d in (1, 2, 3)}  # of the squared length of a vector of unit variance
_LENGTHS = {d: np.sqrt(chi2.ppf((np.arange(1000) + 0.5) / 1000, d)) for d in (2, 3)}  # of such vectors, one in a thousand of each
_SHARE = 0.1  # a parameter with this much of a direction that is not observable is named


class NotObservableError(SingularError):
    """The measurements leave a parameter open: ``parameters`` names those that cannot be told, or not apart from each other."""

    def __init__(self, message: str, parameters: Sequence[str]) -> None:
        super().__init__(f"not observable: {message}")
        self.parameters = tuple(parameters)


@dataclass(frozen=True, eq=False)
class Linear:
    """Residuals about a state, and how they change with the parameters: residual(state + step) = residual - jacobian step."""

    residual: Float64Array  # measured minus predicted, shape (n, d)
    jacobian: Float64Array  # of what is predicted, shape (n, d, p)
    covariance: Float64Array  # of the residuals, up to a common factor, shape (n, d, d)
    # Part of jacobian' covariance^-1 jacobian, summed over residuals, that comes from errors within the jacobian alone, shape (p, p)
    noise: Float64Array


@config
class SolverConfig:
    """How robust least squares are solved."""

    loss: Loss = knob("huber", doc="none: least squares; huber: outliers count less; tukey: gross ones count nothing")
    cutoff: float = knob(0.0, low=0.0, high=100.0, doc="residual in standard deviations where that begins (tukey: ends); 0: 2, tukey 5")
    scale: Scale = knob("measured", doc="covariances are believed as given, or up to a factor that the median residual tells")
    max_condition: float = knob(1e6, low=1.0, high=1e14, doc="worse conditioned geometry is refused")
    max_noise: float = knob(0.25, low=0.0, high=1.0, doc="a turn is refused when this share of what seems to tell it is noise")
    max_iterations: int = knob(100, low=1, high=10_000, doc="more are refused")


@dataclass(frozen=True, eq=False)
class Solution(Generic[S]):
    """What `solve` found about n samples of d components, with p parameters."""

    # state, linear: the best state, and what is linear about it
    state: S
    linear: Linear
    # whitened, jacobian: of unit variance where the covariances are right, shapes (n, d), (n, d, p)
    whitened: Float64Array
    jacobian: Float64Array
    weight: Float64Array  # of the samples, 0..1, shape (n,)
    scale: float  # standard deviations are this many times those given
    # covariance, bread: of the parameters, for errors that are independent from sample to sample; outer parts of `correlated_covariance`,
    # shape (p, p)
    covariance: Float64Array
    bread: Float64Array
    prior: Float64Array  # standard deviations of what was known beforehand, shape (p,)
    # condition, rank: of the equilibrated problem; the rank is p, because everything else is refused
    condition: float
    rank: int
    iterations: int  # until it converged


def solve(
    state: S,
    names: Sequence[str],
    linearise: Callable[[S], Linear],
    move: Callable[[S, Float64Array], S],
    prior_std: Float64Array,
    prior_residual: Callable[[S], Float64Array],
    config: SolverConfig,
    advice: Callable[[Sequence[str]], str],
) -> Solution[S]:
    """Find the state with the least robust sum of squares, by iterated reweighted least squares.

    Parameters
    ----------
    state : object
        Where to begin; near enough that most samples are not outliers.
    names : sequence of str
        Of the p parameters.
    linearise, move : callable
        Residuals about a state; state and step, shape (p,), to the next state.
    prior_std, prior_residual : ndarray of float64, shape (p,), and callable
        Standard deviations of what is known beforehand, infinite where nothing is; known minus state, shape (p,).
    config : SolverConfig
        How.
    advice : callable
        Says what to do about parameters that cannot be told; for the error.

    Raises
    ------
    NotObservableError
        Naming the parameters that the samples leave open.
    DataError
        When a residual is not finite, a covariance is not positive definite, or nothing converges.
    """
    p, moved, iteration = len(names), math.inf, 0
    while moved >= _CONVERGED and iteration < config.max_iterations:
        iteration += 1
        linear = linearise(state)
        require_finite("residuals of the alignment", linear.residual)
        y, J = _whiten(linear)
        distance = np.sqrt((y * y).sum(-1))
        scale = _scale(distance, y.shape[1], p) if config.scale == "measured" else 1.0
        weight = loss_weight(distance / scale, config)
        rows, values = _stack(y, J, weight, prior_std / scale, prior_residual(state))
        U, singular, V, size = _decompose(rows, names, config, advice)
        step = (V / singular) @ (U.T @ values) / size
        moved = float(np.linalg.norm(U.T @ values)) / scale  # in units of what the parameters are known to
        state = move(state, step)
    spread, slack = _robustness(distance / scale, config, y.shape[1], p)
    bread = symmetrise(((V / singular**2) @ V.T) / size[:, None] / size)
    _refuse_noise(bread, linear.noise * (scale**2 * float(weight.mean())), names, config.max_noise, advice)
    if moved > _NEARLY:
        raise DataError(
            f"the alignment did not converge in {config.max_iterations} iterations (last step: {moved:.2g} standard deviations); "
            "the samples contradict each other: check that both sensors saw the same movement"
        )
    covariance, bread = bread * (scale**2 * spread * slack**2 / float(weight.mean())), bread * slack
    return Solution(state, linear, y, J, weight, scale, covariance, bread, prior_std, float(singular[0] / singular[-1]), p, iteration)


def loss_weight(distance: Float64Array, config: SolverConfig) -> Float64Array:
    """Weights of samples, shape (n,), by their residuals in standard deviations, shape (n,)."""
    cutoff = config.cutoff or _CUTOFF[config.loss]
    if config.loss == "none":
        return np.ones(len(distance))
    if config.loss == "huber":
        return np.asarray(cutoff / np.maximum(distance, cutoff))
    return np.asarray(np.maximum(1.0 - (distance / cutoff) ** 2, 0.0) ** 2)


def correlated_covariance(solution: Solution[S], group: IndexArray, longest: float, times: float) -> Float64Array:
    """Covariance of the parameters when errors are correlated in time: a sandwich (White, Liang-Zeger) about sums over stretches of time.

    A few stretches tell little. So their sums are joined, as `_PRIOR` stretches more, with what follows from every error being repeated
    ``times`` times, which is right when all errors are correlated equally long.

    Parameters
    ----------
    solution : Solution
        With n samples.
    group : ndarray of int64, shape (n,)
        Which stretch each sample belongs to.
    longest : float
        Half the correlation time over the length of a stretch: sums that are cut there are too small by this share.
    times : float
        Correlation time over the time between two samples.
    """
    n, p = len(solution.weight), len(solution.bread)
    score = (solution.jacobian * (solution.weight[:, None] * solution.whitened)[..., None]).sum(axis=1)
    _, row = np.unique(group, return_inverse=True)
    stretches = int(row.max(initial=-1)) + 1
    total = np.zeros((stretches, p))
    np.add.at(total, row, score)
    repeated = score.T @ score * max(times, 1.0) * n / max(n - p * max(times, 1.0), 1.0)
    summed = total.T @ total * stretches / max(stretches - p, 1) / max(1.0 - longest, 0.5)
    share = stretches / (stretches + _PRIOR)
    meat = share * summed + (1.0 - share) * repeated + np.diag(solution.scale**4 / solution.prior**2)
    return symmetrise(solution.bread @ meat @ solution.bread)


def _whiten(linear: Linear) -> tuple[Float64Array, Float64Array]:
    try:
        root = np.linalg.cholesky(linear.covariance)
    except np.linalg.LinAlgError:
        raise DataError("a covariance of the samples is not positive definite; give every sample an error") from None
    both = np.linalg.solve(root, np.concatenate([linear.residual[..., None], linear.jacobian], axis=-1))
    return both[..., 0], both[..., 1:]


def _scale(distance: Float64Array, d: int, p: int) -> float:
    """Estimate the standard deviation of whitened residuals from the median of their lengths, which outliers do not move."""
    n = len(distance)
    found = float(np.median(distance)) / math.sqrt(_MEDIAN[d])
    # few samples: the fit has taken up p of their n d degrees of freedom
    return max(found * math.sqrt(n * d / max(n * d - p, 1)), _EXACT)


def _stack(
    y: Float64Array, J: Float64Array, weight: Float64Array, prior_std: Float64Array, prior: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Stack the weighted equations of samples and prior: shapes (m, p), (m,)."""
    p, root = J.shape[-1], np.sqrt(weight)
    known = np.flatnonzero(np.isfinite(prior_std))
    extra = np.zeros((len(known), p))
    extra[np.arange(len(known)), known] = 1.0 / prior_std[known]
    rows = np.concatenate([(J * root[:, None, None]).reshape(-1, p), extra])
    return rows, np.concatenate([(y * root[:, None]).ravel(), prior[known] / prior_std[known]])


def _decompose(
    rows: Float64Array, names: Sequence[str], config: SolverConfig, advice: Callable[[Sequence[str]], str]
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Decompose the equations with columns of unit length: U, singular values, V, lengths; `NotObservableError` when nearly singular."""
    size = np.sqrt((rows * rows).sum(axis=0))
    if not (size > 0).all():
        open_ones = [name for name, length in zip(names, size, strict=True) if not length > 0]
        raise NotObservableError(f"{', '.join(open_ones)}; {advice(open_ones)}", open_ones)
    U, singular, Vt = canonical_svd(rows / size)
    if len(singular) < len(names) or singular[0] > config.max_condition * singular[-1]:
        weak = Vt[len(singular) - 1] if len(singular) == len(names) else np.ones(len(names))
        found = _named(weak, names)
        condition = singular[0] / singular[-1] if singular[-1] > 0 else math.inf
        raise NotObservableError(f"{' and '.join(found)} (condition number {condition:.2g}); {advice(found)}", found)
    return U, singular, Vt.T, size


def _named(direction: Float64Array, names: Sequence[str]) -> list[str]:
    """Parameters that a direction in parameter space consists of, the largest first."""
    share = direction**2 / (direction**2).sum()
    return [names[k] for k in np.argsort(-share, kind="stable") if share[k] > _SHARE]


def _refuse_noise(
    bread: Float64Array, noise: Float64Array, names: Sequence[str], limit: float, advice: Callable[[Sequence[str]], str]
) -> None:
    """Raise `NotObservableError` when what seems to be information about a direction is noise: points that jitter about one place."""
    value, vector = np.linalg.eig(bread @ noise)  # only magnitudes are used: signs do not matter
    worst = int(first_max(value.real))
    share = float(value.real[worst])
    if share > limit:
        seen = np.sqrt(np.maximum(np.diagonal(noise), 0.0)) * np.abs(vector[:, worst].real)  # what the noise pretends to tell
        found = _named(seen, names)
        raise NotObservableError(
            f"{' and '.join(found)}: {share:.0%} of what seems to tell it is noise of the samples; {advice(found)}", found
        )


def _robustness(distance: Float64Array, config: SolverConfig, d: int, p: int) -> tuple[float, float]:
    """Work out what a robust loss does to the uncertainty (Huber 1981, 7.6, for vector residuals).

    Returns the mean square of weighted residuals per component, and how much farther the result moves than weights alone say: their mean
    over the mean derivative of weighted residuals.
    """
    n = len(distance)
    freedom = n * d / max(n * d - p, 1)
    if config.scale == "given":  # residuals are what the covariances say, not what a few samples happen to be
        distance, freedom = _LENGTHS[d], 1.0
    weight = loss_weight(distance, config)
    slope = (loss_weight(distance * (1.0 + 1e-6), config) - weight) / 1e-6
    mean = float(weight.mean())
    curvature = max(float((weight + slope / d).mean()), 1e-3)
    return float((weight**2 * distance**2).mean()) / d * freedom, mean / curvature
