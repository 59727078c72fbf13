"""Frames of a BGT60TR13C, through Infineon's ifxradarsdk, which is not on the package index and is looked for when it is needed."""

from __future__ import annotations

import importlib
import math
import time
from collections import Counter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DeviceError, RadarFrame, RadarInfo
from radar_driver.bgt60.config import Bgt60Config
from radar_driver.components import Component, Radar, Report
from radar_driver.sources import Reading
from radar_driver.tinyrad.convert import analytic

MISSING: Final = (
    "a BGT60TR13C needs Infineon's library ifxradarsdk, which is not on the package index: get the Radar Development Kit from Infineon "
    "(free, with registration), and install the wheel in it: pip install ifxradarsdk-*.whl"
)
_LOST: Final = ("ErrorFrameAcquisitionFailed", "ErrorFifoOverflow")  # the library's, by name: a frame was not fetched in time
_N_RX: Final = 3


def load_sdk() -> tuple[Any, Any]:
    """Import the maker's library: its module of devices, and that of types; a `DeviceError` says where to get it."""
    try:
        return importlib.import_module("ifxradarsdk.fmcw"), importlib.import_module("ifxradarsdk.fmcw.types")
    except (ImportError, OSError) as error:
        raise DeviceError(f"{MISSING} ({type(error).__name__}: {str(error)[:80]})", gone=True) from None


def to_cube(frame: NDArray[Any]) -> NDArray[np.complex64]:
    """Make complex samples, shape (1, n_chirp, n_rx, (n_sample + 1) // 2), of real ones, shape (n_rx, n_chirp, n_sample)."""
    real = np.asarray(frame, np.float32)
    real = real - real.mean(axis=-1, keepdims=True)  # the converter's middle
    return np.ascontiguousarray(analytic(real).transpose(1, 0, 2)[None])


class _Board(Component):
    """The board behind the library."""

    name = "board"

    def __init__(self, config: Bgt60Config) -> None:
        self._config = config
        self.device: Any = None
        self.measured = (0.0, 0.0)  # bandwidth and carrier while samples are taken [Hz]
        self._told: dict[str, Any] = {}

    def power_up(self) -> None:
        self.power_down()
        fmcw, types = load_sdk()
        c = self._config
        try:
            self.device = fmcw.DeviceFmcw(uuid=c.uuid) if c.uuid else fmcw.DeviceFmcw()
            chirp = types.FmcwSequenceChirp(
                start_frequency_Hz=c.start_frequency,
                end_frequency_Hz=c.end_frequency,
                sample_rate_Hz=c.sample_rate,
                num_samples=c.samples,
                rx_mask=(1 << _N_RX) - 1,
                tx_mask=1,
                tx_power_level=c.tx_power,
                lp_cutoff_Hz=c.low_pass,
                hp_cutoff_Hz=c.high_pass,
                if_gain_dB=c.gain,
            )
            times = {"frame_repetition_time_s": c.frame_interval, "chirp_repetition_time_s": c.chirp_interval}
            shape = types.FmcwSimpleSequenceConfig(**times, num_chirps=c.chirps, tdm_mimo=False, chirp=chirp)
            self.device.set_acquisition_sequence(self.device.create_simple_sequence(shape))
            measure = self.device.get_chirp_sampling_bandwidth, self.device.get_chirp_sampling_center_frequency
            swept = [float(one(chirp)) for one in measure]
            self._told = {"uuid": str(self.device.get_board_uuid()), "sensor": str(self.device.get_sensor_type())}
        except Exception as error:  # the library has a class of its own for every reason
            self.power_down()
            raise DeviceError(
                f"the BGT60TR13C cannot be set up ({type(error).__name__}: {str(error)[:100]}): plug it in, close other "
                "programs that use it, or change the knob that is named",
                gone=True,
            ) from None
        self.measured = swept[0], swept[1]

    def power_down(self) -> None:
        held, self.device = self.device, None
        if held is not None:
            held._close()  # the library has no other way than the end of a with statement, which calls this

    def resume(self) -> None:
        self._call("start_acquisition")

    def suspend(self) -> None:
        self._call("stop_acquisition")

    def _call(self, name: str) -> None:
        try:
            getattr(self.device, name)()
        except Exception as error:
            raise DeviceError(
                f"the BGT60TR13C does not {name.replace('_', ' ')} ({type(error).__name__}): plug it in again", gone=True
            ) from None

    def restart(self) -> None:
        """Stop and start, after which the library gives frames again."""
        self.suspend()
        self.resume()

    def report(self) -> Report:
        return self._told


class Bgt60(Radar):
    """Reads frames; a `radar_driver.sources.Source`. What is swept while samples are taken is known once it was powered up."""

    def __init__(self, settings: Bgt60Config) -> None:
        self._config, self._board = settings, _Board(settings)
        super().__init__((self._board,))
        self.info: RadarInfo = settings.info()
        self._counts: Counter[str] = Counter()
        self._number = self._stamp = 0
        self._heard = 0.0

    def power_up(self) -> None:
        """Open the board and set it up."""
        super().power_up()
        self.info = self._config.info(*self._board.measured)

    def resume(self) -> None:
        """Start the chirps."""
        super().resume()
        self._heard = time.monotonic()

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next frame; a `DeviceError` says that frames were lost, or that the board has gone."""
        try:
            found = self._board.device.get_next_frame(timeout_ms=max(math.ceil(timeout * 1e3), 1))
        except Exception as error:  # the library has a class of its own for every reason
            self._failed(error)
            return None
        arrived = time.monotonic_ns()
        self._heard = time.monotonic()
        self._number += 1
        expected = (_N_RX, self._config.chirps, self._config.samples)
        frame = np.asarray(found[0]) if len(found) else np.empty(0)
        if frame.shape != expected or not np.isfinite(frame).all():
            self._counts["broken"] += 1
            raise DeviceError(f"a frame of the BGT60TR13C has shape {frame.shape}, expected {expected}, or is no number; it is left out")
        self._stamp = max(arrived - self.info.waveform.acquisition_ns, self._stamp + 1)
        return Reading(RadarFrame(to_cube(frame), self._stamp, self._number - 1, self.info.frame_id))

    def _failed(self, error: Exception) -> None:
        """Pass over a time-out; a `DeviceError` says what else it was."""
        name = type(error).__name__
        if name == "ErrorTimeout":
            if time.monotonic() - self._heard > self._config.timeout:
                raise DeviceError(f"the BGT60TR13C gave no frame for {self._config.timeout:g} s; it is opened anew", gone=True) from None
            return
        if name in _LOST:
            self._counts["lost"] += 1
            self._number += 1
            self._board.restart()
            raise DeviceError("frames of the BGT60TR13C were lost: this computer is too slow, or frame_interval too short") from None
        raise DeviceError(f"the BGT60TR13C has gone ({name}: {str(error)[:100]}): plug it in again", gone=True) from None

    def report(self) -> dict[str, Any]:
        """Say which board it is, and what was lost."""
        return {**super().report(), **{name: self._counts[name] for name in ("lost", "broken")}}
