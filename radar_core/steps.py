"""When a stage with a time budget changes between its levels."""

from __future__ import annotations

from radar_core.config import config, knob


@config
class StepConfig:
    """When a stage steps down and up between its levels."""

    window: float = knob(0.5, unit="s", low=0.01, high=60.0, doc="the median time of the frames of so long is compared with the budget")
    recover: float = knob(
        5.0,
        unit="s",
        low=0.0,
        high=3600.0,
        doc="a better level is tried once it would have fitted for so long; twice as long after each failed try",
    )
    reserve: float = knob(
        0.8,
        low=0.05,
        high=1.0,
        doc="share of the budget that the next level may be expected to take: levels then do not change to and fro",
    )
