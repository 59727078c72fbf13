"""Listens to a source for a while and judges its health."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from radar_core import DeviceError
from radar_driver.health import Check, Health, HealthConfig, Verdict, worst
from radar_driver.sources import Source

_WAIT: Final = 0.2  # s


@dataclass(frozen=True)
class Probe:
    """What a probe found.

    Attributes
    ----------
    checks : tuple of Check
        Each with value, verdict and advice.
    report : dict
        What the source said of itself at the end.
    """

    checks: tuple[Check, ...]
    report: dict[str, Any]

    @property
    def verdict(self) -> Verdict:
        """The worst of all."""
        return worst(self.checks)


def probe(
    source: Source, seconds: float, *, config: HealthConfig | None = None, progress: Callable[[float], None] = lambda _: None
) -> Probe:
    """Power a source up, listen to it, and power it down again, whatever happens.

    Parameters
    ----------
    source : Source
        Powered down.
    seconds : float
        How long to listen [s].
    config : HealthConfig or None
        The limits; None: the defaults.
    progress : callable
        Called with the share of the time that has passed.

    A device that cannot be opened, or is lost meanwhile, is a failed link whose advice says why. A `DataError` says that frames
    contradict the source's description.
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
