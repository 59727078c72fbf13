"""Make the people tracker that a configuration names."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from radar_core import RadarInfo
from radar_tracking.people.config import TrackerConfig

if TYPE_CHECKING:
    from radar_tracking.people.tracker import PeopleTracker
    from radar_tracking.poisson.tracker import PoissonTracker

AnyTracker: TypeAlias = "PeopleTracker | PoissonTracker"


def make_tracker(config: TrackerConfig | None = None, info: RadarInfo | None = None) -> AnyTracker:
    """Make the tracker of ``config.tracker``; None: the default one, or a radar at the room's origin that sees everything."""
    config = config or TrackerConfig()
    if config.tracker == "poisson_bernoulli":  # only who chooses a tracker imports it
        from radar_tracking.poisson.tracker import PoissonTracker

        return PoissonTracker(config, info)
    from radar_tracking.people.tracker import PeopleTracker

    return PeopleTracker(config, info)
