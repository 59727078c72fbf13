"""How good was a run? Tracks, gestures and hand against the simulator's truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from radar_core import GESTURES, NO_GESTURE, Pose
from radar_core.geometry import cartesian_to_spherical
from radar_gestures.recognizer import Gesture
from radar_gestures.scoring import GestureScore, RecognisedGesture, TruthSegment, score_gestures
from radar_tracking import HandTrack, Tracks, TrackStatus

_GATE = 0.8  # m on the ground: a track farther away is not this person's
_FAR = 1e6


@dataclass(eq=False)
class _Person:
    """What has been counted for one person."""

    seen_since_ns: int | None = None
    in_view: int = 0
    tracked: int = 0
    track_id: int | None = None
    switches: int = 0
    square: list[float] = field(default_factory=list)


class Evaluator:
    """Compare results with the truth of the same stamps.

    A person counts as soon as they have been in view for `settle`: in the radar's field of view and nearer than its unambiguous range. An
    identity switch is a person whose track is another one than before. The position error is on the ground, between the track and the
    body's centre.

    Parameters
    ----------
    mount : Pose
        Of the radar.
    fov_azimuth : float
        Full field of view [rad].
    max_range : float
        Of the radar [m].
    settle : float
        Time a tracker is given to find a person [s].
    """

    def __init__(self, mount: Pose, fov_azimuth: float, max_range: float, settle: float = 1.0) -> None:
        self._mount, self._half_view, self._max_range = mount, fov_azimuth / 2, max_range
        self._settle_ns = round(settle * 1e9)
        self._people: dict[int, _Person] = {}
        self._segments: dict[tuple[int, int], TruthSegment] = {}
        self._gestures: list[tuple[int | None, Gesture]] = []
        self._hand_square: list[float] = []
        self._drawing = 0
        self._owners: dict[int, int] = {}
        self._ghost_ids: set[int] = set()
        self._pairs = 0

    def add(self, tracks: Tracks, truth: Any) -> None:
        """Take in the tracks and the truth of one moment."""
        self._note_gestures(truth)
        self._pairs += 1
        live = [t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE]
        owner = self._match(live, truth)
        for row, number in enumerate(truth.person_id):
            person = self._people.setdefault(int(number), _Person())
            if not self._in_view(truth.position[row]):
                person.seen_since_ns = None
                continue
            if person.seen_since_ns is None:
                person.seen_since_ns = truth.stamp_ns
            track = next((t for t in live if owner.get(t.id) == row), None)
            if truth.stamp_ns - person.seen_since_ns >= self._settle_ns:
                person.in_view += 1
                person.tracked += track is not None
            if track is not None:
                person.switches += person.track_id is not None and person.track_id != track.id
                person.track_id = track.id
                person.square.append(float(np.sum((track.position[:2] - truth.position[row, :2]) ** 2)))
                self._owners[track.id] = int(number)
        self._ghost_ids |= {t.id for t in live if t.id not in owner and t.id not in self._owners}
        self._drawing += int(np.any(truth.drawing))

    def add_gesture(self, gesture: Gesture) -> None:
        """Take in a recognised gesture."""
        self._gestures.append((self._owners.get(gesture.track_id), gesture))

    def add_hand(self, hand: HandTrack, truth: Any) -> None:
        """Take in a hand track and the truth of the same moment; only while the hand draws it is the hand that is meant."""
        rows = np.flatnonzero(truth.drawing)
        if hand.active and len(rows):
            offset = truth.hand_position[rows] - hand.position
            self._hand_square.append(float((offset**2).sum(axis=1).min()))

    def _note_gestures(self, truth: Any) -> None:
        """Open or prolong the gestures that are being performed; kept as segments, so that long runs stay small."""
        for number, label, index in zip(truth.person_id, truth.gesture, truth.gesture_index, strict=True):
            if label != NO_GESTURE:
                key = (int(number), int(index))
                old = self._segments.get(key)
                start = old.start_ns if old is not None else truth.stamp_ns
                self._segments[key] = TruthSegment(int(number), int(label), start, truth.stamp_ns)

    def _in_view(self, position: NDArray[np.float64]) -> bool:
        distance, azimuth, _ = cartesian_to_spherical(self._mount.from_room(position))
        return bool(abs(azimuth) <= self._half_view and distance < self._max_range)

    def _match(self, live: list[Any], truth: Any) -> dict[int, int]:
        """Track id to row of the truth; a person keeps their track while it stays within the gate."""
        if not live or not len(truth.person_id):
            return {}
        away = np.array([np.hypot(*(truth.position[:, :2] - t.position[:2]).T) for t in live])
        cost = np.where(away <= _GATE, away, _FAR)
        for j, number in enumerate(truth.person_id):
            known = self._people.get(int(number))
            for i, track in enumerate(live):
                if known is not None and known.track_id == track.id and cost[i, j] < _FAR:
                    cost[i, j] -= 10.0
        rows, columns = linear_sum_assignment(cost)
        return {live[i].id: int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _FAR / 2}

    def score(self) -> GestureScore:
        """Match the recognised gestures with those performed."""
        recognised = [
            RecognisedGesture(person, g.label, g.start_ns, g.end_ns)
            for person, g in ((p if p is not None else self._owners.get(g.track_id), g) for p, g in self._gestures)
            if person is not None
        ]
        return score_gestures(sorted(self._segments.values(), key=lambda s: (s.start_ns, s.person_id)), recognised)

    def report(self) -> dict[str, Any]:
        """Summarise the run.

        Returns
        -------
        dict
            ``people`` (per person: tracked_fraction, identity_switches, position_rms_m), ``ghost_tracks``, ``gestures`` (hits, wrong,
            misses, false_alarms, total and the list of outcomes), ``hand`` (rms_m, tracked_fraction of the time a hand drew), ``moments``.
        """
        score = self.score()
        outcomes = [
            {
                "person": segment.person_id,
                "time_s": segment.start_ns * 1e-9,
                "performed": GESTURES[segment.label],
                "recognised": GESTURES[found.label] if found is not None else None,
            }
            for segment, found in score.outcomes
        ]
        return {
            "moments": self._pairs,
            "people": {str(number): _summary(person) for number, person in sorted(self._people.items())},
            "ghost_tracks": len(self._ghost_ids - set(self._owners)),
            "gestures": {
                "total": score.total,
                "hits": score.hits,
                "wrong": score.wrong,
                "misses": score.misses,
                "false_alarms": score.false_alarms,
                "outcomes": outcomes,
            },
            "hand": {
                "rms_m": math.sqrt(float(np.mean(self._hand_square))) if self._hand_square else None,
                "tracked_fraction": len(self._hand_square) / self._drawing if self._drawing else None,
            },
        }


def _summary(person: _Person) -> dict[str, Any]:
    return {
        "tracked_fraction": person.tracked / person.in_view if person.in_view else None,
        "identity_switches": person.switches,
        "position_rms_m": math.sqrt(float(np.mean(person.square))) if person.square else None,
    }
