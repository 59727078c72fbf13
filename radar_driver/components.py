"""What a radar is made of: parts that are powered and suspended, and a radar composed of them (3.4).

The thesis has one class for each integrated circuit, one for each board, and a radar that delegates to its boards in a fixed sequence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import Enum
from typing import Any

from radar_core import DeviceError, HandwaveError

Report = Mapping[str, Any]


class PowerState(Enum):
    """How far up something is, the lowest first."""

    FAILED = "failed"
    OFF = "off"
    SUSPENDED = "suspended"
    RUNNING = "running"


class Component:
    """A board, or a part of one. A step that it does not define needs nothing of it."""

    name: str

    def power_up(self) -> None:
        """Make it ready, suspended; a `DeviceError` leaves it powered down."""

    def power_down(self) -> None:
        """Undo `power_up`; may be called twice."""

    def resume(self) -> None:
        """Begin to work."""

    def suspend(self) -> None:
        """Stop working, ready to resume; may be called twice."""

    def report(self) -> Report:
        """Say what is known of it."""
        return {}


class Radar:
    """Powers its components in sequence, and backwards; a failure at any step takes back all steps before it.

    ``components`` are powered up and resumed in the order given, suspended and powered down in the reverse order.
    """

    def __init__(self, components: Sequence[Component]) -> None:
        self._components = tuple(components)
        self._states = dict.fromkeys((component.name for component in components), PowerState.OFF)
        if len(self._states) != len(self._components):
            raise ValueError(f"components need names of their own: {[component.name for component in components]}")

    @property
    def state(self) -> PowerState:
        """The state that all components share; failed when one has, else the lowest."""
        return min(self._states.values(), key=list(PowerState).index, default=PowerState.OFF)

    def power_up(self) -> None:
        """Power up every component that is off, in order; a `DeviceError` names the one that failed, and all are powered down then."""
        for component in self._components:
            if self._states[component.name] in (PowerState.OFF, PowerState.FAILED):
                self._step(component, "power up", PowerState.SUSPENDED)

    def resume(self) -> None:
        """Let every component work, in order; a failure powers all down, as in `power_up`."""
        for component in self._components:
            if self._states[component.name] is PowerState.SUSPENDED:
                self._step(component, "resume", PowerState.RUNNING)

    def suspend(self) -> None:
        """Let every component rest, in reverse order."""
        for component in reversed(self._components):
            if self._states[component.name] is PowerState.RUNNING:
                self._step(component, "suspend", PowerState.SUSPENDED)

    def power_down(self) -> None:
        """Power down every component in reverse order; never fails."""
        for component in reversed(self._components):
            with suppress(HandwaveError):  # there is nothing left to do about a part that cannot even be switched off
                if self._states[component.name] is PowerState.RUNNING:
                    component.suspend()
            with suppress(HandwaveError):
                component.power_down()
            if self._states[component.name] is not PowerState.FAILED:
                self._states[component.name] = PowerState.OFF

    def report(self) -> dict[str, Any]:
        """Say what is known of every component: its state, and values of its own as ``component.value``."""
        found: dict[str, Any] = {}
        for component in self._components:
            found[f"{component.name}.state"] = self._states[component.name].value
            found |= {f"{component.name}.{key}": value for key, value in component.report().items()}
        return found

    def _step(self, component: Component, step: str, state: PowerState) -> None:
        try:
            getattr(component, step.replace(" ", "_"))()
        except HandwaveError as error:
            self._states[component.name] = PowerState.FAILED
            Radar.power_down(self)
            raise DeviceError(f"{component.name} did not {step}: {error}", gone=getattr(error, "gone", False)) from error
        self._states[component.name] = state
