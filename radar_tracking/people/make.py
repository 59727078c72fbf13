"""Make the people tracker that a configuration names."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from radar_core import RadarInfo
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.tracker import PeopleTracker

if TYPE_CHECKING:
    from radar_tracking.poisson.tracker import PoissonTracker

AnyTracker: TypeAlias = "PeopleTracker | PoissonTracker"


def make_tracker(config: TrackerConfig | None = None, info: RadarInfo | None = None) -> AnyTracker:
    """Make the tracker of ``config.tracker``; None: the default one, or a radar at the room's origin that sees everything."""
    if config is not None and config.tracker == "poisson_bernoulli":
        from radar_tracking.poisson.tracker import PoissonTracker  # only who chooses it imports it

        return PoissonTracker(config, info)
    return PeopleTracker(config, info)
