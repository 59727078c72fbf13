"""Make the people tracker that a configuration names."""

from __future__ import annotations

from radar_core import RadarInfo
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.tracker import PeopleTracker
from radar_tracking.poisson.tracker import PoissonTracker

AnyTracker = PeopleTracker | PoissonTracker


def make_tracker(config: TrackerConfig | None = None, info: RadarInfo | None = None) -> AnyTracker:
    """Make the tracker of ``config.tracker``; None: the default one, or a radar at the room's origin that sees everything."""
    if config is not None and config.tracker == "poisson_bernoulli":
        return PoissonTracker(config, info)
    return PeopleTracker(config, info)
