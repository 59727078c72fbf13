"""Knobs of people tracking; every duration in seconds, every length in metres."""

from __future__ import annotations

from radar_core import ConfigError
from radar_core.config import config, knob


@config
class AssociationConfig:
    """Which points belong to which track: gate, nearest track, density clustering (thesis, 6.2.2)."""

    method: str = knob("euclidean", choices=("euclidean", "mahalanobis"), doc="distance that the gate measures")
    gate: float = knob(1.0, unit="m", low=0.05, high=10.0, doc="points farther from a track than this are not its own; an arm must fit in")
    gate_sigmas: float = knob(4.0, low=0.5, high=100.0, doc="gate of method mahalanobis, in standard deviations; `gate` still bounds it")
    eps: float = knob(0.4, unit="m", low=0.01, high=10.0, doc="DBSCAN: points this near are neighbours (floor plane)")
    min_points: int = knob(2, low=1, high=1000, doc="DBSCAN: neighbours of a core point, itself included")
    body_radius: float = knob(0.35, unit="m", low=0.05, high=5.0, doc="points count less for the centroid the farther beyond this (arms)")
    arm_depth: float = knob(
        0.3, unit="m", low=0.01, high=100.0, doc="points this much nearer to the radar than the farthest count 1/e (arms)"
    )
    arm_speed: float = knob(
        0.4, unit="m/s", low=0.01, high=100.0, doc="points this much faster radially than the body count one half (arms)"
    )
    reach: float = knob(
        0.9, unit="m", low=0.0, high=10.0, doc="separate clusters up to here stay with the track as limbs, outside its centroid"
    )
    max_points: int = knob(2000, low=10, high=20000, doc="more points than this are merged on a grid before clustering")


@config
class FilterConfig:
    """Constant-velocity Kalman filter (thesis, 6.2.1)."""

    process_noise: float = knob(
        1.0, unit="m^2/s^3", low=1e-6, high=1e4, doc="spectral density of the acceleration that the model leaves out"
    )
    position_std: float = knob(
        0.1, unit="m", low=1e-3, high=10.0, doc="how far the centroid of many points still is from the body's centre"
    )
    pull: float = knob(
        0.5, unit="m/s", low=0.01, high=100.0, doc="centroids pull a track off its prediction no faster than this (x 1 + its speed)"
    )
    angle_std: float = knob(0.03, unit="rad", low=0.0, high=1.0, doc="direction error of one point, for clouds that carry no own estimate")
    initial_speed_std: float = knob(1.0, unit="m/s", low=1e-3, high=100.0, doc="how fast a new track may move")
    damping: float = knob(1.0, unit="s", low=0.01, high=1e3, doc="time in which an unseen track loses 63 % of its speed")


@config
class LifeConfig:
    """Track management (thesis, 6.2.3): birth, confirmation, death."""

    birth_points: int = knob(3, low=1, high=1000, doc="points of a cluster that starts a track")
    birth_snr: float = knob(15.0, unit="dB", low=-100.0, high=200.0, doc="summed SNR of a cluster that starts a track")
    birth_distance: float = knob(
        0.8, unit="m", low=0.0, high=10.0, doc="a new track starts at least this far from every other (else: an arm)"
    )
    confirm_after: float = knob(0.2, unit="s", low=0.0, high=60.0, doc="a tentative track that is seen this long is confirmed")
    confirm_points: float = knob(2.0, low=0.0, high=1000.0, doc="points per cloud that a track must have had on average to be confirmed")
    confirm_speed: float = knob(0.1, unit="m/s", low=0.0, high=10.0, doc="some point must have been this fast radially: furniture never is")
    tentative_after: float = knob(0.15, unit="s", low=0.0, high=60.0, doc="a tentative track unseen for longer is deleted")
    delete_after: float = knob(1.0, unit="s", low=0.0, high=600.0, doc="a confirmed track unseen for longer is deleted")
    delete_static_after: float = knob(
        3.0, unit="s", low=0.0, high=600.0, doc="the same for one that stood still: a person who stands gives few points"
    )
    static_speed: float = knob(0.3, unit="m/s", low=0.0, high=10.0, doc="slower tracks stand still")
    merge_distance: float = knob(0.3, unit="m", low=0.0, high=10.0, doc="two tracks this near for `merge_after` are one person")
    merge_after: float = knob(1.0, unit="s", low=0.0, high=600.0, doc="see merge_distance; a tentative track goes at once")
    max_tracks: int = knob(50, low=1, high=1000, doc="no new tracks beyond this many")


@config
class TrackerConfig:
    """Everything that `PeopleTracker` can be told."""

    association: AssociationConfig = AssociationConfig()
    filter: FilterConfig = FilterConfig()
    life: LifeConfig = LifeConfig()
    min_speed: float = knob(
        0.0, unit="m/s", low=0.0, high=10.0, doc="points slower than this radially are ignored: for clouds full of furniture"
    )
    max_distance: float = knob(100.0, unit="m", low=0.1, high=1e4, doc="points farther than this from the room's origin are dropped")

    def validate(self) -> None:
        """Raise `ConfigError` when confirmed tracks would die sooner than tentative ones."""
        if self.life.delete_after < self.life.tentative_after:
            raise ConfigError(
                f"life.delete_after = {self.life.delete_after:g} s is shorter than life.tentative_after = {self.life.tentative_after:g} s; "
                "confirmed tracks must live longer than tentative ones"
            )
