"""What a stage did between two diagnostics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

_BUDGET = 0.8  # of the frame interval; above that, a little more load loses frames


@dataclass
class Period:
    """What happened since the last diagnostics."""

    started: float  # on CLOCK_MONOTONIC [s]
    processed: int  # the stage's counts at that time
    dropped: int
    compute: float = 0.0  # spent on all messages since then [s]
    compute_max: float = 0.0  # and on the slowest of them [s]

    def figures(self, now: float, processed: int, dropped: int, frame_interval: float) -> tuple[dict[str, Any], list[str]]:
        """Values and warnings at its end; ``frame_interval`` [s] is 0 where the stage does not know its radar (yet)."""
        count, drops = processed - self.processed, dropped - self.dropped
        mean = self.compute / count if count else 0.0
        values: dict[str, Any] = {
            "rate_hz": f"{count / max(now - self.started, 1e-3):.1f}",
            "dropped": drops,
            "dropped_total": dropped,
            "processed_total": processed,
            "compute_ms": f"{mean * 1e3:.3f}",
            "compute_max_ms": f"{self.compute_max * 1e3:.3f}",
        }
        warnings = [f"{drops} dropped"] if drops else []
        if frame_interval > 0:
            share = mean / frame_interval
            values["budget_percent"] = f"{share * 100:.1f}"
            if share > _BUDGET:
                warnings.append(f"a frame takes {mean * 1e3:.3g} ms of the {frame_interval * 1e3:.3g} ms until the next one")
        return values, warnings
