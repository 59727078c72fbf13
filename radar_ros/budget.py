"""A node's time budget: which level of accuracy it works at, what it gave up for that, and who is told."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import handwave.msg

from radar_core import ConfigError
from radar_core.config import config, knob, override
from radar_core.steps import StepConfig
from radar_ros import qos
from radar_ros.messages.convert import header
from radar_ros.params import declare_config, on_change

if TYPE_CHECKING:  # imported only where there is a budget
    from radar_core.governor import Governor
    from radar_core.ladder import Ladder, Level
    from radar_ros.budget_report import Working

T = TypeVar("T")


@config
class LevelsConfig(StepConfig):
    """Which levels there are, and when to change between them."""

    tuning: str = knob("", doc="file of handwave tradeoff --tune: what each level takes on this machine, and how accurate it is")


@config
class BudgetConfig:
    """How much time a node may take, and what it does about it."""

    frame_budget_ms: float = knob(
        0.0,
        unit="ms",
        low=0.0,
        high=1e4,
        doc="time for each frame of the radar, on average: the node works at the most accurate level that fits; 0: as configured",
    )
    frame_budget_share: float = knob(
        0.0,
        low=0.0,
        high=1.0,
        doc="without frame_budget_ms: time for each frame as a share of that from frame to frame; 0: as configured",
    )
    device_factor: float = knob(1.0, low=1.0, high=1000.0, doc="work so many times as long on each frame, as a slower device would")
    budget: LevelsConfig = LevelsConfig()

    def validate(self) -> None:
        """Raise `ConfigError` for a budget without anything to choose from."""
        if (self.frame_budget_ms or self.frame_budget_share) and not self.budget.tuning:
            raise ConfigError(
                "a time budget needs to know what this machine can do: run handwave tradeoff --tune -o FOLDER once, and set "
                "budget.tuning to FOLDER/levels.json"
            )

    def milliseconds(self, interval: float) -> float:
        """Time for each frame [ms], of a radar with a frame every ``interval`` [s]; 0: no budget, or a share of what is not known yet."""
        return self.frame_budget_ms or 1e3 * self.frame_budget_share * interval


class Budget(Generic[T]):
    """Choose a node's level, frame by frame.

    Parameters
    ----------
    node : StageNode
        Its parameters are declared, its log and its topic ``stage_budget`` are written.
    base : configuration
        Of the stage; levels set some of its knobs apart.
    prepare : callable
        Called with the configurations of other levels while the node runs. It makes what the node needs to work at them, changing nothing
        yet, and returns what puts that in place (see `radar_ros.params.on_change`).

    Attributes
    ----------
    configs : tuple of configurations
        Of all levels.
    """

    def __init__(self, node: Any, base: T, prepare: Callable[[tuple[T, ...]], Callable[[], None]]) -> None:
        self._node, self._base = node, base
        self._config = declare_config(node, BudgetConfig, changeable=True)
        self._publisher = node.create_publisher(handwave.msg.StageBudget, "stage_budget", qos.LATCHED)
        self._ladder = self._read(self._config)
        self.configs = self._over(base, self._ladder)
        self._governor: Governor | None = None
        self._first, self._budget_ms = 0, 0.0
        self._start()

        def slower(config: BudgetConfig) -> None:
            self._config = config

        def change(config: BudgetConfig) -> Callable[[], None]:
            if replace(config, device_factor=self._config.device_factor) == self._config:
                return partial(slower, config)  # levels, and the one that works, stay
            ladder = self._read(config)
            configs = self._over(self._base, ladder)
            place = prepare(configs)

            def apply() -> None:
                self._config, self._ladder, self.configs = config, ladder, configs
                self._start()
                place()

            return apply

        on_change(node, self._config, change)

    @property
    def number(self) -> int:
        """Number of the level to use now; 0: the most accurate, or the only one."""
        return self._governor.level if self._governor is not None else 0

    def begin(self) -> int:
        """Begin with a message, before anything else; returns that only every so many'th frame is to be processed.

        The radar is known by now: a budget that is a share of the time between frames starts here, and anew when that time changes.
        """
        if self._ladder is not None and self._config.milliseconds(self._node.frame_interval) != self._budget_ms:
            self._start()
        return self._levels[self.number].every if self._levels else 1

    def configs_of(self, base: T) -> tuple[T, ...]:
        """Make the configurations of all levels on top of another one."""
        return self._over(base, self._ladder)

    def rebase(self, base: T) -> None:
        """Work on top of another configuration from now on."""
        self._base, self.configs = base, self.configs_of(base)

    @property
    def _levels(self) -> tuple[Level, ...]:
        return self._ladder.levels if self._ladder is not None else ()

    def _read(self, config: BudgetConfig) -> Ladder | None:
        """Read the levels of this stage; None: there is no budget."""
        if not (config.frame_budget_ms or config.frame_budget_share):
            return None
        if self._node.reliable:
            raise ConfigError("a budget leaves out what takes too long, and 'reliable' lets nothing be lost: set one of the two")
        from radar_core.ladder import load_ladders, machine

        stage, path = self._node.stage, config.budget.tuning
        ladders = load_ladders(path)
        if stage not in ladders:
            raise ConfigError(f"{path}: has no levels of {stage!r}, only of {', '.join(ladders)}; make it anew: handwave tradeoff --tune")
        measured = ladders[stage].machine
        if measured != machine():
            self._node.caution(f"{path} was measured on another machine ({measured}; this is {machine()}): tune again on this one")
        return ladders[stage]

    @staticmethod
    def _over(base: T, ladder: Ladder | None) -> tuple[T, ...]:
        """Make the configurations of all levels on top of another one; without levels, that one."""
        if ladder is None:
            return (base,)
        return tuple(override(base, level.knobs, f"level {level.name!r} of the {ladder.stage}") for level in ladder.levels)

    def _start(self) -> None:
        self._governor, self._budget_ms = None, self._config.milliseconds(self._node.frame_interval)
        if self._ladder is None or not self._budget_ms:
            return
        from radar_core.governor import Governor

        self._governor = Governor(self._levels, self._budget_ms, self._config.budget)
        self._first = self._governor.level
        fits = self._governor.expected_ms <= self._budget_ms
        why = "the most accurate level that fits, as tuned" if fits else "no level fits, as tuned: this is the quickest"
        self._tell(0, math.nan, self._governor.expected_ms, why)

    def slow_down(self, worked_ns: int) -> None:
        """Wait as long as a slower device would still work on the message that was begun at a time of this thread's processor.

        Only work takes longer on such a device. Waiting for a core that another process has does not, so it is not multiplied.
        """
        if self._config.device_factor > 1:
            time.sleep((self._config.device_factor - 1) * (time.thread_time_ns() - worked_ns) * 1e-9)

    def spent(self, stamp_ns: int, started_ns: int, frames: int = 1) -> None:
        """Take note of a message of some stamp that was begun at a time of CLOCK_MONOTONIC and is done; the level may change with it.

        ``frames``: for how many frames of the radar it stands, of which nodes before this one left out the others.
        """
        if self._governor is None:
            return
        now = time.monotonic_ns()
        step = self._governor.process((now - started_ns) * 1e-6 / frames, now * 1e-9)
        if step is not None:
            budget = f"{self._budget_ms:g} ms"
            slow = f"a frame took {step.measured_ms:.3g} ms of {budget}"
            why = slow if step.after > step.before else f"a better level has fitted into {budget} for a while"
            self._tell(stamp_ns, step.measured_ms, step.expected_ms, why)

    def _now(self) -> Working:
        from radar_ros.budget_report import Working  # nodes without a budget start without it

        assert self._ladder is not None
        assert self._governor is not None
        interval_ms = 1e3 * self._node.frame_interval
        return Working(self._ladder, self.configs, self.number, self._first, self._budget_ms, self._governor.expected_ms, interval_ms)

    def _tell(self, stamp_ns: int, measured_ms: float, expected_ms: float, why: str) -> None:
        now = replace(self._now(), expected_ms=expected_ms)
        log = self._node.get_logger()
        if now.number > now.first:
            log.warning(now.text(why))
        else:
            log.info(now.text(why))
        self._publisher.publish(now.message(header(stamp_ns, ""), self._node.stage, measured_ms, why))

    def report(self) -> tuple[dict[str, Any], list[str]]:
        """Values for the diagnostics, and what to warn of; nothing without a budget."""
        return ({}, []) if self._governor is None else self._now().report()
