"""The loops of the maximum-likelihood refinement in plain numpy: what `radar_dsp.refine_kernels` has to equal."""

import numpy as np

from radar_dsp import refine_kernels
from radar_dsp.refine_kernels import ComplexArray, FloatArray, FloatCube, Model

take_step = refine_kernels.take_step.py_func
"""The same step, not compiled."""


def correlate(re: FloatCube, im: FloatCube, model: Model, distance: float, speed: float) -> ComplexArray:
    """Do as `correlate`, in double precision."""
    n_tx, n_chirp, _ = re.shape
    start, echo = _echo(n_tx, n_chirp, model, distance, speed)
    x = (re + 1j * im.astype(np.float64)).reshape(n_tx, n_chirp, -1, len(model.wave))
    gradient = np.empty((3, *echo.shape))
    gradient[0], gradient[1] = 1.0, model.wave - model.mean[0]
    gradient[2] = model.wave * (start[:, :, None] + model.fast) - model.mean[1]
    sums = np.einsum("tlrk,gtlk->trg", x, echo.conj() * gradient, optimize=True)
    return np.asarray(sums.reshape(-1, 3))


def replace(re: FloatCube, im: FloatCube, model: Model, old: FloatArray, was: ComplexArray, new: FloatArray, now: ComplexArray) -> None:
    """Do as `replace`."""
    n_tx, n_chirp, _ = re.shape
    for theta, amplitude in ((old, was), (new, -now)):
        _, echo = _echo(n_tx, n_chirp, model, theta[0], theta[1])
        wave = (amplitude.reshape(n_tx, 1, -1, 1) * echo[:, :, None, :]).reshape(re.shape)
        re += wave.real.astype(np.float32)
        im += wave.imag.astype(np.float32)


def _echo(n_tx: int, n_chirp: int, model: Model, distance: float, speed: float) -> tuple[FloatArray, ComplexArray]:
    """Start times, shape (n_tx, n_chirp), and the model of unit amplitude, shape (n_tx, n_chirp, n_sample)."""
    start = np.asarray((np.arange(n_chirp) * n_tx + np.arange(n_tx)[:, None]) * model.interval - model.middle, np.float64)
    phase: FloatArray = model.wave * (distance + speed * (start[:, :, None] + model.fast)) - (
        model.mean[0] * distance + model.mean[1] * speed
    )
    echo: ComplexArray = np.exp(1j * phase)
    return start, echo
