"""Sample type, and who transforms: error of the spectrum against float64, beside the time of a frame."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, measure_together
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.echoes import INFO, busy
from radar_dsp import SpectrumConfig
from radar_dsp.spectrum import make_spectrum

_REFERENCE = "bare scipy.fft of the cube, complex64"
SAMPLES = Panel("sample type", "relative rms error of the spectrum", "", "lower", "complex64", _REFERENCE)
BACK_ENDS = Panel("FFT back end and word length", "relative rms error of the spectrum", "", "lower", "fft=scipy", _REFERENCE)
_WORDS = (8, 10, 12, 14, 16)


def _windowed(cube: NDArray[Any], window: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(scipy.fft.fft2(cube * window, axes=(1, 3)))


def measure(study: StudyConfig) -> Found:
    """Compare float32 with float64 samples, and the back ends with each other, on a frame of forty echoes."""
    cube = busy(np.random.default_rng(study.seed))[1].cube
    made = make_spectrum(SpectrumConfig(), INFO)
    window = made.speed_window[:, None, None] * made.range_window
    truth = _windowed(cube.astype(np.complex128), window)
    norm = np.linalg.norm(truth)
    kinds: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
        "complex64": (cube, window.astype(np.float32)),
        "complex128": (cube.astype(np.complex128), window),
    }
    configs = {f"fft={name}": SpectrumConfig(fft=name) for name in ("scipy", "numpy", "fftw")}
    configs |= {f"fft=fixed, {bits} bit": SpectrumConfig(fft="fixed", word_length=bits) for bits in _WORDS}
    found = Found()
    if importlib.util.find_spec("pyfftw") is None:
        del configs["fft=fftw"]
        found.leave_out(BACK_ENDS.name, "fft=fftw", "pyfftw is not installed; pip install 'handwave[fftw]'")
    spectra = {name: make_spectrum(config, INFO) for name, config in configs.items()}
    calls: dict[str, Callable[[], Any]] = {"": lambda: scipy.fft.fft2(cube, axes=(1, 3))}
    calls |= {name: partial(_windowed, *arguments) for name, arguments in kinds.items()}
    calls |= {name: partial(spectrum.process, cube) for name, spectrum in spectra.items()}
    times = measure_together(calls, repeat=study.pick(15, 200))
    for panel, names in ((SAMPLES, kinds), (BACK_ENDS, spectra)):
        off = {name: float(np.linalg.norm(calls[name]() - truth) / norm) for name in names}
        found.rows += panel.rows(off, times, lambda value: 0.5 * value)  # half of it is chance of rounding
    return found
