"""One guard around everything that a node is called back for: what others send costs itself only, and never fills the log or the memory."""

from __future__ import annotations

import functools
import re
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import rclpy

from radar_core import HandwaveError

_REPEAT_AFTER: Final = 5.0  # s: a problem that goes on is logged again after this long
_KINDS: Final = 24  # different problems that are told of within that time; what comes beyond is told of together
_LONGEST: Final = 500  # characters of one line
_VARYING: Final = re.compile(r"'[^']*'|\"[^\"]*\"|\d+")  # numbers, and names that others choose
_GIVE_UP: Final = 10.0  # s: a node whose callbacks fail for so long, and that finishes nothing meanwhile, is better started again
_OTHERS: Final = "(other problems)"


class Problems:
    """What was logged lately, so that nothing is logged again and again; however many different texts come, it stays small.

    Texts that differ only in numbers and in what stands in quotes are one problem.
    """

    def __init__(self) -> None:
        self._said: dict[str, tuple[float, int]] = {}  # by kind: when, on CLOCK_MONOTONIC [s], and how often since then

    def __len__(self) -> int:
        return len(self._said)

    def told(self, text: str, now: float | None = None) -> str:
        """Make the text to log; empty when the same was logged a moment ago. ``now`` is on CLOCK_MONOTONIC [s]."""
        now = time.monotonic() if now is None else now
        text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
        kind = _VARYING.sub("#", text)
        if kind not in self._said and len(self._said) >= _KINDS:
            self._said = {kind: said for kind, said in self._said.items() if now - said[0] < _REPEAT_AFTER}
            kind = kind if len(self._said) < _KINDS else _OTHERS
        last, hidden = self._said.get(kind, (-1e9, 0))
        if now - last < _REPEAT_AFTER:
            self._said[kind] = (last, hidden + 1)
            return ""
        self._said[kind] = (now, 0)
        return f"{text} ({hidden} more like this since the last time)" if hidden else text


class GuardMixin:
    """Lets a callback that cannot use what it was given cost that only: it is counted and told of once, and the node goes on.

    For subscriptions, services and timers; mixed into `Node`. What is no `HandwaveError` may be a fault of this program:
    the line says where. When such faults go on for 10 s and nothing is finished meanwhile, the node ends, to be started again.
    """

    _failing: float | None = None  # since when callbacks fail and nothing is finished, on CLOCK_MONOTONIC [s]

    def create_subscription(self: Any, msg_type: Any, topic: str, callback: Any, qos_profile: Any, **others: Any) -> Any:
        """Subscribe, as rclpy does."""
        return super().create_subscription(msg_type, topic, guarded(self, callback, f"{topic}: "), qos_profile, **others)  # type: ignore[misc]

    def create_service(self: Any, srv_type: Any, srv_name: str, callback: Any, **others: Any) -> Any:
        """Offer a service, as rclpy does; a request that cannot be served gets an empty answer."""
        return super().create_service(srv_type, srv_name, guarded(self, callback, f"{srv_name}: "), **others)  # type: ignore[misc]

    def create_timer(self: Any, timer_period_sec: float, callback: Any, *others: Any, **named: Any) -> Any:
        """Make a timer, as rclpy does."""
        return super().create_timer(timer_period_sec, guarded(self, callback), *others, **named)  # type: ignore[misc]

    def went_on(self) -> None:
        """Take note that something was finished."""
        self._failing = None

    def _fault(self: Any, error: Exception, where: str) -> None:
        """Refuse what a callback failed over; raises it again where nothing else is left."""
        now = time.monotonic()
        self._failing = now if self._failing is None else self._failing
        if not rclpy.ok() or now - self._failing > _GIVE_UP:
            raise error
        place = traceback.extract_tb(error.__traceback__)[-1]
        self.refuse(f"{where}cannot be used ({type(error).__name__}: {error}; {Path(place.filename).name}, line {place.lineno})")


def guarded(node: Any, callback: Callable[..., Any], where: str = "") -> Callable[..., Any]:
    """Put the guard around a callback of a node; ``where`` begins the text of what goes wrong."""

    @functools.wraps(callback)
    def calling(*given: Any) -> Any:
        try:
            return callback(*given)
        except HandwaveError as error:
            node.refuse(error)
        except Exception as error:
            node._fault(error, where)
        return given[-1] if given else None  # of a service: its answer, as it was made

    return calling
