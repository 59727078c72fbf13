"""Point clouds to people and hands: clustering, association, estimation, track management."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.clustering.density import dbscan
    from radar_tracking.clustering.lloyd import kmeans
    from radar_tracking.hand.config import HandConfig
    from radar_tracking.hand.tracker import HandTracker
    from radar_tracking.people.config import AssociationConfig, FilterConfig, LifeConfig, TrackerConfig
    from radar_tracking.people.make import make_tracker
    from radar_tracking.people.tracker import PeopleTracker
    from radar_tracking.tracks import HandTrack, Track, TrackedCloud, Tracks, TrackStatus

__all__ = [
    "AssociationConfig", "FilterConfig", "HandConfig", "HandTrack", "HandTracker", "LifeConfig", "PeopleTracker", "Track", "TrackStatus",
    "TrackedCloud", "TrackerConfig", "Tracks", "dbscan", "kmeans", "make_tracker",
]  # fmt: skip
__getattr__ = lazily(
    __name__,
    {
        "dbscan": "clustering.density",
        "kmeans": "clustering.lloyd",
        "HandConfig": "hand.config",
        "HandTracker": "hand.tracker",
        "AssociationConfig FilterConfig LifeConfig TrackerConfig": "people.config",
        "make_tracker": "people.make",
        "PeopleTracker": "people.tracker",
        "HandTrack Track TrackedCloud Tracks TrackStatus": "tracks",
    },
)
