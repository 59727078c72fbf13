"""What every source of radar data looks like: a board, a simulated radar, a recording."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_driver.targets import Targets

if TYPE_CHECKING:
    from radar_sim import Truth


@dataclass(frozen=True, eq=False)
class Reading:
    """One frame or cloud of a source, or the targets of a board that follows people itself.

    Attributes
    ----------
    data : RadarFrame, PointCloud or Targets
        The stamp of a frame is the start of its acquisition, that of a cloud or of targets the middle [ns]. The sequence counts what the
        source made, lost ones too: a gap is a loss.
    truth : Truth or None
        What is true in the middle of the frame's acquisition, on the same clock; None: not known.
    turn : int
        How often a recording or scene has begun again before this frame; 0: the first time.
    own : Targets or None
        What the board itself made of this cloud: its tracks and gestures.
    """

    data: RadarFrame | PointCloud | Targets
    truth: Truth | None = None
    turn: int = 0
    own: Targets | None = None


@dataclass(frozen=True)
class Context:
    """What a source that has no clock of its own is told about its user.

    Attributes
    ----------
    namespace : str
        Which radar, where a scene or recording holds several, e.g. ``"left"``; the only one is taken whatever its namespace.
    clock : callable
        Reads the time on which frames are due and stamped [ns]. It may stand still or go back, as simulated time does.
    rate, nap : float
        Pace relative to the radar's own; longest sleep between two looks at the clock [s], finite for one that does not run with real time.
    """

    namespace: str = ""
    clock: Callable[[], int] = time.monotonic_ns
    rate: float = 1.0
    nap: float = math.inf


def meant(namespace: str, places: Iterable[str]) -> str | None:
    """Find which of several radars the namespace of a driver means.

    Parameters
    ----------
    namespace : str
        Of the driver, e.g. ``"left"``, or ``"hall/left"`` where the graph has a namespace of its own.
    places : iterable of str
        Where a scene or recording has its radars, e.g. ``"left"`` and ``"right"``.

    Returns
    -------
    str or None
        The same place, else the longest one that the namespace ends with, else the only one that ends with the namespace; None: there is
        no such radar.
    """
    space, known = namespace.strip("/"), list(places)
    if space in known:
        return space
    inner = sorted((place for place in known if place and space.endswith(f"/{place}")), key=len)
    outer = [place for place in known if space and place.endswith(f"/{space}")]
    return inner[-1] if inner else outer[0] if len(outer) == 1 else None


class Source(Protocol):
    """Something that gives frames or clouds once resumed. Its methods are called from one thread at a time.

    Stamps are on CLOCK_MONOTONIC, those of a source that was opened with a `Context` on the context's clock. ``info`` says what the radar
    is; it is known before `power_up`, but for the calibration.
    """

    info: RadarInfo

    def power_up(self) -> None:
        """Open and set up the device, suspended; a `DeviceError` leaves it powered down."""

    def resume(self) -> None:
        """Let it send; what it still had from before is thrown away. A recording or scene goes on from where it was suspended."""

    def suspend(self) -> None:
        """Stop sending; may be called twice."""

    def power_down(self) -> None:
        """Let go of everything; may be called twice, and never fails."""

    def read(self, timeout: float) -> Reading | None:
        """Wait ``timeout`` seconds at most for what comes next; None: nothing came.

        A `DeviceError` says why; ``gone``: the device has to be powered up anew. Otherwise reading may go on.
        """

    def report(self) -> Mapping[str, Any]:
        """Say what is known of the source: states, temperature, counts; called from any thread."""


monotonic_ns: Final = time.monotonic_ns  # the clock on which boards stamp [ns]
