"""Knobs of people tracking; every duration in seconds, every length in metres."""

from __future__ import annotations

from functools import partial
from typing import Literal

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_tracking.clustering.base import ClusteringConfig
from radar_tracking.estimators.config import EstimatorConfig
from radar_tracking.people.zones import ZonesConfig
from radar_tracking.poisson.config import PoissonConfig

_metres = partial(knob, unit="m", low=0.0, high=10.0)
_seconds = partial(knob, unit="s", low=0.0, high=600.0)
_speed = partial(knob, unit="m/s", low=0.0, high=10.0)


@config
class AssociationConfig:
    """Which points belong to which track: gate, nearest track, density clustering (thesis, 6.2.2)."""

    method: Literal["euclidean", "mahalanobis"] = knob("euclidean", doc="distance that the gate measures")
    gate: float = knob(1.0, unit="m", low=0.05, high=10.0, doc="points farther from a track than this are not its own; an arm must fit in")
    gate_sigmas: float = knob(4.0, low=0.5, high=100.0, doc="gate of method mahalanobis, in standard deviations; `gate` still bounds it")
    clustering: ClusteringConfig = ClusteringConfig(eps=0.4, min_points=2)
    largest: Literal["body", "points"] = knob("body", doc="group_clustering: what makes a cluster large, torso-like points or points")
    split: Literal["none", "kmeans", "optics"] = knob("none", doc="cluster_first: how clusters of several merged tracks are divided")
    body_radius: float = knob(0.35, unit="m", low=0.05, high=5.0, doc="points count less for the centroid the farther beyond this (arms)")
    body_width: float = knob(0.35, unit="m", low=0.0, high=2.0, doc="least distance of two people, so that tracks do not swap; 0: off")
    arm_depth: float = knob(0.3, unit="m", low=0.01, high=100.0, doc="points this much nearer to the radar than the farthest count 1/e")
    torso_depth: float = _metres(0.2, doc="points up to this far behind where the torso was may be the torso")
    arm_length: float = _metres(0.7, doc="points up to here behind it may be the torso if they are strong")
    torso_echo: float = knob(0.5, low=0.0, high=1e6, doc="from this share of the strongest point's power on, for their ranges")
    body_depth: float = _metres(0.35, doc="separate clusters so far behind the torso are somebody else: arms reach forward")
    arm_speed: float = knob(0.4, unit="m/s", low=0.01, high=100.0, doc="points radially this much faster than the body count half (arms)")
    arm_height: float = _metres(10.0, doc="points higher than this (1.2 m is below shoulders) hardly count as torso: raised arms")
    reach: float = _metres(0.9, doc="separate clusters up to here stay with the track as limbs, outside its centroid")


@config
class FilterConfig:
    """Estimation of where a body is (thesis, 6.2.1 and A.21)."""

    estimator: EstimatorConfig = EstimatorConfig()
    position_std: float = knob(0.1, unit="m", low=1e-3, high=10.0, doc="how far the centroid of many points is from the body's centre")
    pull: float = knob(0.5, unit="m/s", low=0.01, high=100.0, doc="centroids pull a track off its prediction no faster (x 1 + its speed)")
    surface: float = knob(0.12, unit="m", low=0.0, high=1.0, doc="a standing body's centre lies this far behind what the radar sees")
    surface_walking: float = knob(0.06, unit="m", low=0.0, high=1.0, doc="the same at 1 m/s and more: arms and legs swing")
    angle_std: float = knob(0.03, unit="rad", low=0.0, high=1.0, doc="direction error of one point, for clouds that carry no own estimate")
    initial_speed_std: float = knob(1.0, unit="m/s", low=1e-3, high=100.0, doc="how fast a new track may move")
    damping: float = knob(1.0, unit="s", low=0.01, high=1e3, doc="time in which an unseen track loses 63 % of its speed")


@config
class LifeConfig:
    """Track management (thesis, 6.2.3): birth, confirmation, deletion."""

    birth_points: int = knob(3, low=1, high=1000, doc="points of a cluster that starts a track")
    birth_snr: float = knob(15.0, unit="dB", low=-100.0, high=200.0, doc="summed SNR of a cluster that starts a track")
    birth_distance: float = _metres(0.8, doc="a new track starts at least this far from every other (else: an arm)")
    birth_behind: float = _metres(0.4, doc="the same for points behind a person (see association.body_depth), which are no arm")
    birth_before: float = _metres(1.1, doc="the same for points before a person, nearer to the radar: people stretch their arms to it")
    birth_together: float = _metres(0.6, doc="tracks that begin with the same cloud are this far apart; nearer: see pair_distance")
    confirm_after: float = knob(0.2, unit="s", low=0.0, high=60.0, doc="a tentative track that is seen this long is confirmed")
    confirm_matches: int = knob(3, low=1, high=1000, doc="and has been updated by so many clouds")
    confirm_points: float = knob(2.0, low=0.0, high=1000.0, doc="points per cloud that a track must have had on average to be confirmed")
    confirm_speed: float = _speed(0.1, doc="points this fast radially move; furniture never does")
    confirm_activity: float = knob(0.15, low=0.0, high=1.0, doc="least share of the last half second's clouds with a moving point")
    reflection_after: float = _seconds(0.0, doc="a tentative track that looks like the reflection of another one waits this long; 0: off")
    reflection_farther: float = knob(0.3, unit="m", low=-10.0, high=100.0, doc="a reflection is at least so much farther than its cause")
    reflection_weaker: float = knob(2.0, unit="dB", low=-50.0, high=50.0, doc="and at least so much weaker, for its range")
    reflection_depth: float = knob(0.4, unit="m", low=0.01, high=10.0, doc="allowed error of a reflection's range where walls are known")
    reflection_time: float = knob(0.1, unit="s", low=1e-3, high=100.0, doc="whether a track looks like a reflection is averaged over this")
    tentative_after: float = knob(0.15, unit="s", low=0.0, high=60.0, doc="a tentative track unseen for longer is deleted")
    delete_after: float = _seconds(1.0, doc="a confirmed track unseen for longer is deleted")
    delete_static_after: float = _seconds(3.0, doc="the same for one that stood still: a person who stands gives few points")
    walk_distance: float = knob(0.8, unit="m", low=0.0, high=100.0, doc="who has been this far from their first place has walked")
    delete_idle_after: float = knob(10.0, unit="s", low=0.0, high=1e6, doc="a confirmed track that never walked and rests longer is ended")
    left_after: float = _seconds(0.2, doc="the same for one that is predicted beyond the radar's view or the boundaries")
    static_speed: float = _speed(0.3, doc="slower tracks stand still")
    merge_distance: float = _metres(
        0.3, doc="tracks this near for `merge_after` are one person; confirmed ones: if association.body_width is less"
    )
    merge_after: float = _seconds(1.0, doc="see merge_distance; a tentative track goes at once")
    pair_distance: float = _metres(0.4, doc="a track whose points fall into two heaps so far apart is two people; 0: never")
    pair_time: float = knob(1.0, unit="s", low=0.01, high=100.0, doc="if it is so in half of the clouds, averaged over this time")
    max_tracks: int = knob(50, low=1, high=1000, doc="no new tracks beyond this many")


@config
class BackgroundConfig:
    """Background: still points of nobody that come again and again at the same place."""

    enabled: bool = knob(True, doc="learn the background and leave it out")
    still_speed: float = _speed(0.1, doc="points slower than this radially do not move")
    learn_time: float = knob(5.0, unit="s", low=0.01, high=1e4, doc="time over which the share of clouds is counted")
    unlearn_time: float = knob(1.0, unit="s", low=0.01, high=1e4, doc="what stirs is forgotten within this time")
    share: float = knob(0.25, low=0.001, high=1.0, doc="a cell with a still point in this share of the clouds is background")
    stronger: float = knob(10.0, unit="dB", low=0.0, high=200.0, doc="still points so much stronger than usual in their cell are new")
    body: float = _metres(0.5, doc="nothing is learned within this of a person")
    range_cell: float = knob(0.15, unit="m", low=0.01, high=10.0, doc="cell in range")
    azimuth_cell: float = knob(0.06, unit="rad", low=0.005, high=1.5, doc="cell in azimuth")


@config
class TrackerConfig:
    """Knobs of the people tracker that `make_tracker` makes; `association`, `filter`, `life` and `background` are of the thesis's three."""

    tracker: Literal["poisson_bernoulli", "group_clustering", "group", "cluster_first"] = knob(
        "poisson_bernoulli", doc="points to tracks: a Poisson multi-Bernoulli filter, or one of the thesis's ways (6.2.2)"
    )
    association: AssociationConfig = AssociationConfig()
    filter: FilterConfig = FilterConfig()
    life: LifeConfig = LifeConfig()
    background: BackgroundConfig = BackgroundConfig()
    poisson: PoissonConfig = PoissonConfig()
    zones: ZonesConfig = ZonesConfig()
    min_distance: float = knob(0.3, unit="m", low=0.0, high=100.0, doc="nearer points are coupling, or fold over from the last range bin")
    min_speed: float = _speed(0.0, doc="points slower than this radially are ignored: for clouds full of furniture")
    max_distance: float = knob(100.0, unit="m", low=0.1, high=1e4, doc="points farther than this from the room's origin are dropped")

    def validate(self) -> None:
        """Raise `ConfigError` when confirmed tracks would die sooner than tentative ones."""
        if self.life.delete_after < self.life.tentative_after:
            raise ConfigError(
                f"life.delete_after = {self.life.delete_after:g} s is shorter than life.tentative_after = {self.life.tentative_after:g} s; "
                "confirmed tracks must live longer than tentative ones"
            )
