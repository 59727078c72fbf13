"""Point clouds to people and hands: clustering, association, estimation, track management."""

from radar_tracking.clustering import dbscan, kmeans
from radar_tracking.hand import HandConfig, HandTracker
from radar_tracking.people.config import AssociationConfig, FilterConfig, LifeConfig, TrackerConfig
from radar_tracking.people.tracker import PeopleTracker
from radar_tracking.tracks import HandTrack, Track, TrackedCloud, Tracks, TrackStatus

__all__ = [
    "AssociationConfig",
    "FilterConfig",
    "HandConfig",
    "HandTrack",
    "HandTracker",
    "LifeConfig",
    "PeopleTracker",
    "Track",
    "TrackStatus",
    "TrackedCloud",
    "TrackerConfig",
    "Tracks",
    "dbscan",
    "kmeans",
]
