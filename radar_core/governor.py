"""Which level of accuracy fits a time budget: down at once under overload, up again only when it has fitted for a while."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median_low
from typing import Final

from radar_core.errors import ConfigError, DataError
from radar_core.ladder import Level
from radar_core.steps import StepConfig

_ENOUGH: Final = 5  # frames: a median of fewer follows single outliers
_EASILY: Final = 0.4  # of the budget: what was too slow before and is expected to take so little now is tried without patience
_MOST_FAILURES: Final = 6  # waiting grows 64-fold at most


@dataclass(frozen=True)
class Step:
    """A change of level."""

    before: int  # numbers of levels, 0: the most accurate one
    after: int
    measured_ms: float  # what a frame of the radar took on average at the level before [ms]; NaN: not measured yet
    expected_ms: float  # what it should take from now on [ms]


class Governor:
    """Choose the most accurate level that fits a budget.

    What a level was measured to take, times how much slower the machine is now than it was then, is what it is expected to take now. How
    much slower is the median over the last frames, so that one late frame changes nothing.

    Parameters
    ----------
    levels : sequence of Level
        The most accurate first, each quicker than the one before.
    budget_ms : float
        Time for each frame of the radar, on average [ms].
    config : StepConfig or None
        When to step; None: the defaults.

    Attributes
    ----------
    level : int
        The level to use, 0: the most accurate one.

    Raises
    ------
    ConfigError
        When the budget is not positive and finite, or there is no level.
    """

    def __init__(self, levels: Sequence[Level], budget_ms: float, config: StepConfig | None = None) -> None:
        if not (budget_ms > 0 and math.isfinite(budget_ms)):
            raise ConfigError(f"a budget of {budget_ms} ms makes no sense; give a positive number of milliseconds")
        if not levels:
            raise ConfigError("a budget needs at least one level to choose")
        self._config = config if config is not None else StepConfig()
        self._levels, self._budget = tuple(levels), budget_ms
        self._ratios: deque[tuple[float, float]] = deque()
        self._slower = 1.0
        self._failures = 0
        self._fits_since = self._stepped_up = math.nan
        self.level = self._best(budget_ms)

    @property
    def expected_ms(self) -> float:
        """What a frame of the radar takes at this level, as slow as the machine is now [ms]."""
        return self._expected(self.level)

    def process(self, spent_ms: float, now: float) -> Step | None:
        """Take in one processed frame.

        Parameters
        ----------
        spent_ms : float
            Time that it took [ms].
        now : float
            Any clock that never goes back [s].

        Returns
        -------
        Step or None
            The change, when the level changes with this frame; its first frame at the new level is the next one.

        Raises
        ------
        DataError
            When the time spent is negative, the clock went back, or one of the two is not finite.
        """
        if not (math.isfinite(spent_ms) and spent_ms >= 0 and math.isfinite(now)):
            raise DataError(f"Governor.process: spent_ms is {spent_ms} and now {now}; both must be finite, and no time is negative")
        if self._ratios and now < self._ratios[-1][0]:
            before = self._ratios[-1][0]
            raise DataError(f"Governor.process: now is {now}, after {before} of the frame before; use a clock that never goes back")
        self._ratios.append((now, spent_ms / self._levels[self.level].time_ms))
        while self._ratios and now - self._ratios[0][0] > self._config.window and len(self._ratios) > _ENOUGH:
            self._ratios.popleft()
        if len(self._ratios) < _ENOUGH:
            return None
        trying = now - self._stepped_up < self._config.window  # a try that fails has to end before it costs frames
        if not trying and now - self._ratios[0][0] < 0.5 * self._config.window:
            return None
        self._slower = median_low(ratio for _, ratio in self._ratios)
        return self._down(now) if self.expected_ms > self._budget else self._up(now)

    def _down(self, now: float) -> Step | None:
        self._fits_since = math.nan
        target = max(self._best(self._config.reserve * self._budget), min(self.level + 1, len(self._levels) - 1))
        if target == self.level:
            return None
        if now - self._stepped_up <= 2 * self._wait():
            self._failures = min(self._failures + 1, _MOST_FAILURES)
        return self._step(target, now)

    def _up(self, now: float) -> Step | None:
        if now - self._stepped_up > 4 * self._wait():
            self._failures, self._stepped_up = 0, math.nan
        target = self._best(self._config.reserve * self._budget)
        if target >= self.level:
            self._fits_since = math.nan
            return None
        if math.isnan(self._fits_since):
            self._fits_since = now
        easily = self._expected(target) <= _EASILY * self._budget
        if now - self._fits_since < (self._config.recover if easily else self._wait()):
            return None
        self._stepped_up = now
        return self._step(target, now)

    def _step(self, target: int, now: float) -> Step:
        before, measured = self.level, self.expected_ms
        self.level, self._fits_since = target, math.nan
        self._ratios.clear()
        return Step(before, target, measured, self.expected_ms)

    def _wait(self) -> float:
        return self._config.recover * 2.0**self._failures

    def _expected(self, level: int) -> float:
        return self._slower * self._levels[level].cost_ms

    def _best(self, most_ms: float) -> int:
        """Find the most accurate level that is expected to take so much at most; the quickest where none does."""
        fits = [k for k in range(len(self._levels)) if self._expected(k) <= most_ms]
        return fits[0] if fits else len(self._levels) - 1
