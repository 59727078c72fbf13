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

    Returns
    -------
    Probe
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
        while (passed := time.monotonic() - started) < seconds and not lost:
            progress(passed / seconds)
            try:
                reading = source.read(_WAIT)
            except DeviceError as error:
                health.trouble(str(error))
                lost = error.gone
                continue
            if reading is not None:
                health.process(reading.data, time.monotonic_ns())
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
