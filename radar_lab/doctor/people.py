"""Whether the people that are followed are those who move: nobody found, lost when still, merged, ghosts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import PointCloud, Pose
from radar_core.types import BoolArray, Float64Array
from radar_lab.doctor.echoes import WALKS
from radar_lab.doctor.heaps import MOVES, windows
from radar_tracking import Tracks
from radar_tracking.people.config import AssociationConfig, LifeConfig
from radar_tracking.people.pairs import two_heaps
from radar_tracking.tracks import Reason, Track

_LIFE: Final = LifeConfig()
_GATE: Final = AssociationConfig().gate  # m: points farther from a track than this are not its own
_BESIDE: Final = 1.3  # m: and who has no track of their own beside somebody is up to half a body farther away
TWO: Final = 0.6
"""Two people are at least so far apart [m]: two bodies are 0.5 m wide, and side by side nearer than that they look like one."""
_LONG: Final = 2.0  # s: tracks that live shorter say nothing about what they are on
_LONGER: Final = 4.0  # s: steps of one person look like two people for shorter
_STILL: Final = 0.15  # of a track's clouds have a moving point: people who stood, swayed and gestured had 0.35 and more, furniture to 0.05
_EVER: Final = 0.95  # of them: people who walk about had 0.92 and less, fans all
_SPOT: Final = 0.4  # m: a fan's track goes no farther


@dataclass(frozen=True, eq=False)
class Life:
    """One confirmed track from its first to its last cloud.

    Attributes
    ----------
    number : int
        Its identity.
    begin, end : float
        [s], from the first cloud on.
    first, last : ndarray of float64, shape (2,)
        Where it was then [m].
    extent : float
        How far it went at most between two places [m].
    moves : float
        Share of its clouds with a moving point near it.
    two : float
        Share of its clouds whose points near it fall into two heaps across the line of sight, or along it, whichever is more.
    unseen : bool
        Whether it ended because nothing belonged to it, within the radar's view.
    """

    number: int
    begin: float
    end: float
    first: Float64Array
    last: Float64Array
    extent: float
    moves: float
    two: float
    unseen: bool

    @property
    def ghost(self) -> str:
        """Why it is on nobody; empty: it may well be somebody."""
        if self.end - self.begin < _LONG:
            return ""
        if self.moves < _STILL and self.extent < _LIFE.walk_distance:
            return "still"
        return "spins" if self.moves > _EVER and self.extent < _SPOT else ""


@dataclass(frozen=True, eq=False)
class Followed:
    """What became of who moves, over a recording.

    Attributes
    ----------
    seconds : float
        Length of the recording.
    walking, unfollowed : int
        Half seconds in which something walks, and those of them in which nobody is followed there.
    lives : tuple of Life
        All confirmed tracks.
    """

    seconds: float
    walking: int
    unfollowed: int
    lives: tuple[Life, ...]

    @property
    def unfollowed_share(self) -> float | None:
        """Share of the half seconds with somebody who walks and is not followed; None: nobody walks."""
        return self.unfollowed / self.walking if self.walking else None

    @property
    def lost(self) -> tuple[tuple[Life, Life], ...]:
        """Tracks that ended, and the later ones that went on from where they ended: who was there all the time."""
        walked = [life for life in self.lives if life.extent >= _LIFE.walk_distance]
        pairs = [
            (old, new)
            for old in walked
            for new in walked
            if old.unseen and new.begin > old.end and np.hypot(*(new.first - old.last)) < _LIFE.walk_distance
        ]
        return tuple({old.number: (old, new) for old, new in reversed(pairs)}.values())

    @property
    def merged(self) -> tuple[float, Life | None]:
        """The largest share of a track's clouds in which it holds two people, and that track."""
        long = [life for life in self.lives if life.end - life.begin >= _LONGER]
        most = max(long, key=lambda life: life.two, default=None)
        return (0.0, None) if most is None else (most.two, most)

    @property
    def ghosts(self) -> tuple[Life, ...]:
        """Tracks that are on nobody."""
        return tuple(life for life in self.lives if life.ghost)

    @property
    def ghost_share(self) -> float:
        """Ghosts at a time, mean over the recording."""
        return sum(life.end - life.begin for life in self.ghosts) / max(self.seconds, 1e-9)


def follow(pairs: Sequence[tuple[PointCloud, Tracks]], mount: Pose) -> Followed:
    """Compare tracks with what moves.

    Parameters
    ----------
    pairs : sequence of (PointCloud, Tracks)
        Clouds in ``room``, each with its tracks, in order.
    mount : Pose
        Where the radar stands.
    """
    if not pairs:
        return Followed(0.0, 0, 0, ())
    clouds = [cloud for cloud, _ in pairs]
    walking = unfollowed = 0
    for window in windows(clouds):
        places = [track.position[:2] for k in window.clouds for track in _people(pairs[k][1])]
        for heap in window.heaps:
            if abs(np.median(heap.speed)) > WALKS:
                walking += 1
                unfollowed += not any(np.hypot(*(place - heap.place)) < _GATE for place in places)
    seconds = (clouds[-1].stamp_ns - clouds[0].stamp_ns) * 1e-9
    return Followed(seconds, walking, unfollowed, _lives(pairs, mount))


def _people(tracks: Tracks) -> list[Track]:
    return list(tracks.people)


def _lives(pairs: Sequence[tuple[PointCloud, Tracks]], mount: Pose) -> tuple[Life, ...]:
    begin = pairs[0][0].stamp_ns
    seen: dict[int, list[tuple[float, ...]]] = {}
    ended: dict[int, bool] = {}
    for cloud, tracks in pairs:
        people = _people(tracks)
        place = np.column_stack([cloud.x, cloud.y]).astype(np.float64)
        distance = np.array([np.hypot(*(place - track.position[:2]).T) for track in people]).reshape(len(people), len(cloud))
        own = (distance < _BESIDE) & (distance == distance.min(axis=0, initial=np.inf)) if len(people) else distance > 0
        for track, near in zip(people, own, strict=True):
            moves = bool((np.abs(cloud.radial_speed[near]) > MOVES).any())
            two = _is_two(cloud, place, near, track.position[:2], np.array([mount.x, mount.y]))
            seen.setdefault(track.id, []).append(((cloud.stamp_ns - begin) * 1e-9, *track.position[:2].tolist(), moves, *two))
        ended |= {gone.id: gone.reason is Reason.UNSEEN for gone in tracks.deleted}
    return tuple(_life(number, np.array(rows, np.float64), ended) for number, rows in seen.items())


def _life(number: int, rows: Float64Array, ended: Mapping[int, bool]) -> Life:
    place = rows[:, 1:3]
    extent = float(np.hypot(*np.ptp(place, axis=0)))
    moves, across, along = rows[:, 3:].mean(axis=0).tolist()
    times = float(rows[0, 0]), float(rows[-1, 0])
    return Life(number, *times, place[0], place[-1], extent, moves, max(across, along), ended.get(number, False))


def _is_two(cloud: PointCloud, place: Float64Array, near: BoolArray, centre: Float64Array, origin: Float64Array) -> tuple[bool, bool]:
    """Tell whether the points near a track fall into two heaps, across the line of sight and along it, as the tracker tests it."""
    line = (centre - origin) / max(float(np.hypot(*(centre - origin))), 1e-3)
    step = place[near] - centre
    power = np.where(np.isfinite(cloud.snr[near]), 10 ** (cloud.snr[near] / 10), 1.0)
    strength = np.sqrt(power).astype(np.float64) * np.hypot(*(place[near] - origin).T) ** 2
    group = np.zeros(len(step), np.int64)
    across, along = line[0] * step[:, 1] - line[1] * step[:, 0], step @ line
    heaps = [bool(np.isfinite(two_heaps(group, axis, strength, 1, TWO)[0])) for axis in (across, along)]
    return heaps[0], heaps[1]
