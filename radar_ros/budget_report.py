"""What a node with a time budget says of the level that it works at: in its log, on stage_budget and in diagnostics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import handwave.msg

from radar_core.config import flat
from radar_core.ladder import Ladder


@dataclass(frozen=True, eq=False)
class Working:
    """The level that a node works at.

    Attributes
    ----------
    ladder : Ladder
        All levels of the stage.
    configs : tuple of configurations
        Of all levels.
    number, first : int
        Of the level, and of that which it began with; 0: the most accurate one.
    budget_ms, expected_ms : float
        Time for each frame, and what a frame should take [ms].
    interval_ms : float
        From frame to frame of the radar [ms]; 0: not known.
    """

    ladder: Ladder
    configs: tuple[Any, ...]
    number: int
    first: int
    budget_ms: float
    expected_ms: float
    interval_ms: float

    @property
    def gave_up(self) -> list[str]:
        """What the level sets apart from the most accurate one."""
        now, best = flat(self.configs[self.number]), flat(self.configs[0])
        found = [f"{name}: {now[name]} instead of {best[name]}" for name in now if now[name] != best[name]]
        every, most = self.ladder.levels[self.number].every, self.ladder.levels[0].every
        return found + ([f"one frame in {every} is processed instead of one in {most}"] if every != most else [])

    def text(self, why: str) -> str:
        """Write a line for the log."""
        level, best = self.ladder.levels[self.number], self.ladder.levels[0]
        figures = f"{self.ladder.figure} {level.accuracy:.3g} {self.ladder.unit}, not {best.accuracy:.3g}"
        lost = f"; gave up {', '.join(self.gave_up)} ({figures})" if self.gave_up else ""
        place = f"level {self.number + 1} of {len(self.ladder.levels)}"
        return f"{place}, {level.name}: {why}; a frame should take {self.expected_ms:.3g} ms{lost}"

    def message(self, head: Any, stage: str, measured_ms: float, why: str) -> Any:
        """Make the message for ``stage_budget``; ``head`` is its header."""
        level, best, ladder = self.ladder.levels[self.number], self.ladder.levels[0], self.ladder
        msg = handwave.msg.StageBudget(header=head, stage=stage, gave_up=self.gave_up, reason=why)
        msg.budget_ms, msg.measured_ms, msg.expected_ms = self.budget_ms, measured_ms, self.expected_ms
        msg.level, msg.number, msg.levels, msg.every = level.name, self.number, len(ladder.levels), level.every
        msg.figure, msg.unit, msg.better = ladder.figure, ladder.unit, ladder.better
        msg.accuracy, msg.best_accuracy = level.accuracy, best.accuracy
        return msg

    def report(self) -> tuple[dict[str, Any], list[str]]:
        """Values for the diagnostics, and what to warn of."""
        level, budget, last = self.ladder.levels[self.number], self.budget_ms, len(self.ladder.levels) - 1
        values = {"frame_budget_ms": f"{budget:g}", "level": f"{self.number + 1} of {last + 1}: {level.name}"}
        values |= {"level_expected_ms": f"{self.expected_ms:.3g}", "gave_up": ", ".join(self.gave_up) or "nothing"}
        warnings = [f"stepped down to {level.name} to keep within {budget:g} ms"] if self.number > self.first else []
        if 0 < self.interval_ms < budget:
            text = f"a budget of {budget:g} ms is more than the {self.interval_ms:g} ms from frame to frame: frames will be lost"
            warnings.append(text)
        if self.expected_ms > budget and self.number == last:
            warnings.append(f"even the quickest level takes {self.expected_ms:.3g} ms of {budget:g} ms")
        return values, warnings
