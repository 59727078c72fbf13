"""Health of a radar from a few seconds of its data: each check has a measured value, a verdict and what to do."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from radar_core import DeviceError, PointCloud, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_driver.sources import Source
from radar_driver.spectra import Levels, Spectra
from radar_driver.targets import Targets

Float64Array = NDArray[np.float64]

_ROUNDING: Final = 1e-6  # of the largest sample; less is no noise but the rounding of single precision
_WAIT: Final = 0.2  # s: how long one read may take
_LINE: Final = 300  # frames that the line is made of; it takes the square of them
_ENOUGH: Final = 3  # frames; with fewer there is no rate and no jitter
_LOST_FRAMES: Final = "the machine or the link is too slow: close other programs, use a port of its own, or a lower frame rate"
_LOST_CHIRPS: Final = "the link loses data: use a shorter cable, a port of its own, larger network buffers (net.core.rmem_max)"
_SATURATED: Final = "the converter is at its limit and makes false points: lower the receiver's gain, or move strong reflectors away"


class Verdict(Enum):
    """What a check found, the worst last."""

    UNKNOWN = "-"
    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes
    ----------
    name, unit, text : str
        Of the check; of the value; the value for people.
    value : float or None
        What was measured, in ``unit``; None: nothing could be.
    verdict : Verdict
        Whether it is all right.
    advice : str
        What to do; empty where nothing is to be done.
    """

    name: str
    value: float | None
    unit: str
    text: str
    verdict: Verdict
    advice: str = ""


@config
class HealthConfig:
    """From where on something is worth a warning, or a failure."""

    temperature_warn: float = knob(75.0, unit="degC", low=-50.0, high=200.0, doc="warm")
    temperature_fail: float = knob(95.0, unit="degC", low=-50.0, high=200.0, doc="too hot for most radar chips")
    channel_spread: float = knob(6.0, unit="dB", low=0.1, high=100.0, doc="between the noise floors of two receivers")
    coupling_warn: float = knob(-12.0, unit="dBFS", low=-200.0, high=0.0, doc="leakage at zero range: a quarter of the converter's range")
    coupling_fail: float = knob(-3.0, unit="dBFS", low=-200.0, high=0.0, doc="leakage that leaves no range for echoes")
    saturated_fail: float = knob(1e-3, low=0.0, high=1.0, doc="share of samples at the converter's limit; any at all is warned of")
    rate_warn: float = knob(0.02, low=0.0, high=1.0, doc="deviation of the frame rate from what the radar says")
    rate_fail: float = knob(0.1, low=0.0, high=1.0, doc="the same")
    jitter_warn: float = knob(0.5, low=0.0, high=10.0, doc="99th percentile of how late data comes, in frame intervals")
    jitter_fail: float = knob(2.0, low=0.0, high=100.0, doc="the same")
    lost_fail: float = knob(0.01, low=0.0, high=1.0, doc="share of frames (or chirps) lost; any at all is warned of")


class Arrivals:
    """Counts what comes: rate, jitter, losses."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._numbers: list[int] = []

    def __len__(self) -> int:
        return len(self._times)

    def add(self, sequence: int, arrived_ns: int) -> None:
        """Note one frame or cloud: its number and when it came [ns]."""
        if self._numbers and sequence <= self._numbers[-1]:  # the device started again: what was before says nothing about gaps
            self._times.clear()
            self._numbers.clear()
        self._times.append(arrived_ns)
        self._numbers.append(sequence)

    @property
    def lost(self) -> int:
        """Numbers that never came."""
        return self._numbers[-1] - self._numbers[0] + 1 - len(self._numbers) if self._numbers else 0

    def pace(self) -> tuple[float, Float64Array]:
        """Fit a straight line through numbers and times.

        Gives the interval between two frames that the device made [s], and how late each came against the earliest that the line allows
        [s], shape (n,).
        """
        numbers = np.array(self._numbers, np.float64)
        times = (np.array(self._times) - self._times[0]) * 1e-9
        some = np.unique(np.linspace(0, len(numbers) - 1, min(len(numbers), _LINE)).astype(int))
        interval = theilslopes(times[some], numbers[some]).slope  # one stall must not bend the line
        late = times - interval * (numbers - numbers[0])
        return float(interval), late - late.min()


class Health:
    """Takes in what a source with the description ``info`` gives, and judges it by the limits of ``config`` (None: the defaults)."""

    def __init__(self, info: RadarInfo, config: HealthConfig | None = None) -> None:
        self._info, self._config = info, config if config is not None else HealthConfig()
        self._arrivals = Arrivals()
        self._spectra: Spectra | None = None
        self._chirps = self._chirps_lost = 0
        self._points: list[int] = []
        self._what = "frames"
        self._snr: list[float] = []
        self._problem = ""

    def process(self, data: RadarFrame | PointCloud | Targets, arrived_ns: int) -> None:
        """Take in a frame, a cloud or targets that came then [ns, any clock]; a `DataError` says that it contradicts its description."""
        if isinstance(data, RadarFrame):
            data.check(self._info)
            if self._spectra is None:
                self._spectra = Spectra(self._info)
            self._spectra.add(data)
            self._chirps += data.cube.shape[0] * data.cube.shape[1]
            self._chirps_lost += len(data.missing)
        else:
            self._points.append(len(data))
            self._what = "reports" if isinstance(data, Targets) else "clouds"
            self._snr += [] if isinstance(data, Targets) else data.snr[np.isfinite(data.snr)].tolist()
        self._arrivals.add(data.sequence, arrived_ns)

    @property
    def chirps(self) -> tuple[int, int]:
        """Chirps that there should be, and those of them that the device lost."""
        return self._chirps, self._chirps_lost

    @property
    def saturated(self) -> float | None:
        """Share of samples at the converter's limit; None: there are no samples, or the limit is not known."""
        return None if self._spectra is None else self._spectra.saturated

    def trouble(self, problem: str) -> None:
        """Take in that the device reported an error."""
        self._problem = self._problem or problem

    def checks(self, report: Mapping[str, Any], seconds: float) -> tuple[Check, ...]:
        """Judge what came in ``seconds`` of listening: the link first; what cannot be measured of this source is `Verdict.UNKNOWN`.

        ``report`` is what the source says of itself; values named ``temperature`` (of any part) are degrees Celsius.
        """
        found = [self._link(seconds), *self._temperature(report)]
        if not len(self._arrivals):
            return tuple(found)
        if self._spectra is not None:
            levels = self._spectra.measure()
            found += [*self._noise(self._spectra, levels), self._coupling(self._spectra, levels), self._saturation(self._spectra)]
        else:
            found += [self._cloud_sizes(), self._strength()]
        lost, n = self._arrivals.lost, len(self._arrivals)
        found += [*self._rate(), self._losses("lost frames", lost, lost + n, _LOST_FRAMES)]
        if self._spectra is not None:
            found.append(self._losses("lost chirps", self._chirps_lost, self._chirps, _LOST_CHIRPS))
        return tuple(found)

    def _link(self, seconds: float) -> Check:
        n = len(self._arrivals)
        what = self._what
        text = f"{n} {what} in {seconds:.1f} s"
        if n == 0:
            advice = self._problem or "check the cable and the power, and whether another program uses the board; then try again"
            return Check("link", 0.0, what, text, Verdict.FAIL, advice)
        return Check("link", float(n), what, text, Verdict.WARN if self._problem else Verdict.OK, self._problem)

    def _temperature(self, report: Mapping[str, Any]) -> list[Check]:
        limits = self._config
        found = []
        for key, value in report.items():
            if key.rpartition(".")[2] != "temperature" or not isinstance(value, (int, float)) or not np.isfinite(value):
                continue
            verdict = _above(value, limits.temperature_warn, limits.temperature_fail)
            advice = "let air reach the board, or make it transmit less of the time" if verdict is not Verdict.OK else ""
            found.append(Check(key, float(value), "degC", f"{value:.1f} °C", verdict, advice))
        return found or [Check("temperature", None, "degC", "not told by this source", Verdict.UNKNOWN)]

    def _noise(self, spectra: Spectra, levels: Levels | None) -> list[Check]:
        if levels is None:
            return [Check("noise floor", None, "dB", "no frame is whole", Verdict.UNKNOWN)]
        floor = np.where(levels.noise > (_ROUNDING * spectra.peak) ** 2, levels.noise, 0.0)
        if not np.any(floor > 0):
            zeros = "all samples are zero: is the radar configured, and does it transmit? Power it off and on, then try again"
            still = "there is no noise at all: a simulation without the effect noise, or a board in a test mode"
            verdict, advice = (Verdict.WARN, still) if spectra.peak else (Verdict.FAIL, zeros)
            return [Check("noise floor", None, "dB", "none", verdict, advice)]
        unit = "dBFS" if self._info.full_scale else "dB"
        level = 10 * np.log10(np.where(floor > 0, floor, np.nan)) - spectra.reference
        mean, spread = float(np.nanmean(level)), float(np.nanmax(level) - np.nanmin(level))
        dead = np.flatnonzero(~(floor > 0))
        verdict, advice = Verdict.OK, ""
        if len(dead):
            verdict, advice = Verdict.FAIL, f"receiver {', '.join(str(k + 1) for k in dead)} gives zeros: broken, or switched off"
        elif spread > self._config.channel_spread:
            low, high = int(np.nanargmin(level)) + 1, int(np.nanargmax(level)) + 1
            verdict, advice = Verdict.WARN, f"receiver {low} hears {spread:.1f} dB less noise than receiver {high}: one of them is bad"
        return [
            Check("noise floor", mean, unit, f"{mean:.1f} {unit} a sample", Verdict.OK),
            Check("noise spread", spread, "dB", f"{spread:.1f} dB between receivers", verdict, advice),
        ]

    def _coupling(self, spectra: Spectra, levels: Levels | None) -> Check:
        """Leakage at zero range: what stands there still, as an amplitude of the samples."""
        if self._info.waveform.modulation != "fmcw":
            return Check("coupling", None, "dB", "only measured of FMCW", Verdict.UNKNOWN)
        if levels is None or levels.near <= 0:
            return Check("coupling", None, "dB", "none to be seen", Verdict.UNKNOWN if levels is None else Verdict.OK)
        level = 10 * math.log10(levels.near) - spectra.reference
        floor = float(np.mean(levels.noise))
        over = f", {10 * math.log10(levels.near / floor):.0f} dB over the noise of a sample" if floor > 0 else ""
        if not self._info.full_scale:
            return Check("coupling", level, "dB", f"{level:.1f} dB{over}", Verdict.UNKNOWN)
        verdict = _above(level, self._config.coupling_warn, self._config.coupling_fail)
        advice = "something right before the antennas (a cover, a table) throws the signal back, or the gain is too high: change either"
        return Check("coupling", level, "dBFS", f"{level:.1f} dBFS{over}", verdict, advice if verdict is not Verdict.OK else "")

    def _saturation(self, spectra: Spectra) -> Check:
        share = spectra.saturated
        if share is None:
            return Check("saturation", None, "", "the converter's limit is not known", Verdict.UNKNOWN)
        verdict = _above(share, 0.0, self._config.saturated_fail)
        return Check("saturation", share, "", f"{share:.2%} of the samples at full scale", verdict, _SATURATED if share > 0 else "")

    def _rate(self) -> list[Check]:
        interval = self._info.waveform.frame_interval
        if len(self._arrivals) < _ENOUGH:
            return [Check("frame rate", None, "Hz", "too few to tell", Verdict.WARN, "listen longer (--duration)")]
        measured, late = self._arrivals.pace()
        rate = 1 / measured if measured > 0 else float("inf")
        off = abs(rate * interval - 1)
        verdict = _above(off, self._config.rate_warn, self._config.rate_fail)
        said = f"the radar's description says {1 / interval:.4g} Hz: correct that (.cfg, frame_interval), or the link is too slow"
        advice = said if verdict is not Verdict.OK else ""
        jitter = float(np.percentile(late, 99))
        shaky = _above(jitter / interval, self._config.jitter_warn, self._config.jitter_fail)
        hint = "data comes in bursts: another USB port without a hub, or less load on this machine" if shaky is not Verdict.OK else ""
        return [
            Check("frame rate", rate, "Hz", f"{rate:.2f} Hz (expected {1 / interval:.2f})", verdict, advice),
            Check("jitter", jitter * 1e3, "ms", f"{jitter * 1e3:.1f} ms late at most (99 %)", shaky, hint),
        ]

    def _losses(self, name: str, lost: int, total: int, advice: str) -> Check:
        share = lost / total if total else 0.0
        verdict = _above(share, 0.0, self._config.lost_fail)
        return Check(name, share, "", f"{lost} of {total}", verdict, advice if lost else "")

    def _cloud_sizes(self) -> Check:
        sizes = np.array(self._points)
        text = f"{np.median(sizes):.0f} (from {sizes.min()} to {sizes.max()})"
        empty = not sizes.any()
        demo = "" if self._what == "reports" else "; then look at the demo's thresholds (cfarCfg) and field of view"
        advice = f"nothing was seen: walk before the radar{demo}" if empty else ""
        name = "targets per report" if self._what == "reports" else "points per cloud"
        return Check(name, float(np.median(sizes)), "", text, Verdict.WARN if empty else Verdict.OK, advice)

    def _strength(self) -> Check:
        if not self._snr:
            return Check("snr", None, "dB", "not given by this source", Verdict.UNKNOWN)
        return Check("snr", float(np.median(self._snr)), "dB", f"{np.median(self._snr):.1f} dB median of all points", Verdict.OK)


def _above(value: float, warn: float, fail: float) -> Verdict:
    return Verdict.FAIL if value > fail else Verdict.WARN if value > warn else Verdict.OK


def worst(checks: tuple[Check, ...]) -> Verdict:
    """Give the worst verdict of all."""
    return max((check.verdict for check in checks), key=list(Verdict).index, default=Verdict.UNKNOWN)


@dataclass(frozen=True)
class Probe:
    """What a probe found: its checks, each with value, verdict and advice, and what the source said of itself at the end."""

    checks: tuple[Check, ...]
    report: dict[str, Any]

    @property
    def verdict(self) -> Verdict:
        """The worst of all."""
        return worst(self.checks)


def probe(
    source: Source, seconds: float, *, config: HealthConfig | None = None, progress: Callable[[float], None] = lambda _: None
) -> Probe:
    """Power a source up, listen to it for ``seconds``, and power it down again, whatever happens.

    ``config`` has the limits (None: the defaults); ``progress`` is called with the share of the time that has passed. A device that cannot
    be opened, or is lost meanwhile, is a failed link whose advice says why. A `DataError` says that frames contradict the source's
    description.
    """
    health = Health(source.info, config)
    started = time.monotonic()
    report: dict[str, Any] = {}
    lost = False
    try:
        source.power_up()
        source.resume()
        started = time.monotonic()
        lost = _listen(source, seconds, health, progress)
        report = dict(source.report())
        source.suspend()
    except DeviceError as error:
        health.trouble(str(error))
        lost = True
    finally:
        source.power_down()
    progress(1.0)
    checks = health.checks(report, time.monotonic() - started)
    if lost:
        checks = (replace(checks[0], verdict=Verdict.FAIL), *checks[1:])
    return Probe(checks, report)


def _listen(source: Source, seconds: float, health: Health, progress: Callable[[float], None]) -> bool:
    """Take in what comes until the time is up; whether the device was lost."""
    started = time.monotonic()
    while (passed := time.monotonic() - started) < seconds:
        progress(passed / seconds)
        try:
            reading = source.read(_WAIT)
        except DeviceError as error:
            health.trouble(str(error))
            if error.gone:
                return True
            continue
        if reading is not None:
            health.process(reading.data, time.monotonic_ns())
    return False
