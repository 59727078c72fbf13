"""How good was a run? Tracks, gestures and hand against the simulator's truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, NO_GESTURE, Pose
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_core.linalg import SingularError
from radar_gestures.recognizer import Gesture
from radar_lab.evaluation.scoring import GestureScore, RecognisedGesture, TruthSegment, score_gestures
from radar_tracking import HandTrack, Tracks
from radar_tracking.metrics import (
    ClearMot,
    ClearMotConfig,
    ClearMotStep,
    Gospa,
    GospaConfig,
    GospaMetric,
    ObjectSet,
    PersonScore,
    nees,
    people,
)


@config
class EvaluationConfig:
    """What counts as followed."""

    # Wider than that of the benchmarks: a gesturing hand may drag a track by half a metre, and its gestures still belong to its person.
    radius: float = knob(0.8, unit="m", low=1e-6, high=1e6, doc="a track this near to a person, or nearer, can be of that person")
    gospa: GospaConfig = GospaConfig()
    settle: float = knob(1.0, unit="s", low=0.0, high=60.0, doc="a person counts when in view for this long: time to be found")


class Evaluator:
    """Compare results with the truth of the same stamps.

    A person counts as soon as they have been in view for `settle`: in the radar's field of view and nearer than its unambiguous range.
    Others may have a track or not. All distances are on the ground, between the track and the body's centre.

    Parameters
    ----------
    mount : Pose
        Of the radar.
    fov_azimuth : float
        Full field of view [rad].
    max_range : float
        Of the radar [m].
    settings : EvaluationConfig or None
        None: all defaults.
    """

    def __init__(self, mount: Pose, fov_azimuth: float, max_range: float, settings: EvaluationConfig | None = None) -> None:
        self.config = settings or EvaluationConfig()
        self._mount, self._half_view, self._max_range = mount, fov_azimuth / 2, max_range
        self._settle_ns = round(self.config.settle * 1e9)
        self._mot, self._gospa = ClearMot(ClearMotConfig(radius=self.config.radius)), GospaMetric(self.config.gospa)
        self._seen_since_ns: dict[int, int] = {}
        self._nees = _NeesMean()
        self._segments: dict[tuple[int, int], TruthSegment] = {}
        self._gestures: list[tuple[int | None, Gesture]] = []
        self._hand_square: list[float] = []
        self._drawing = 0
        self._owners: dict[int, int] = {}
        self._ghost_ids: set[int] = set()

    def add(self, tracks: Tracks, truth: Any) -> Gospa:
        """Take in the tracks and the truth of one moment.

        Parameters
        ----------
        tracks : Tracks
            What the tracker says.
        truth : Truth
            What the simulator knows.

        Returns
        -------
        Gospa
            Of this moment.

        Raises
        ------
        DataError
            When a place is not finite or an identity occurs twice; the moment is left out.
        """
        found = people(tracks)
        real = ObjectSet.of(truth.position[:, :2], truth.person_id, self._counts(truth))
        step = self._mot.process(real, found)
        self._owners.update(zip(step.estimate_id.tolist(), step.truth_id.tolist(), strict=True))
        self._ghost_ids.update(step.false.tolist())
        self._note_consistency(tracks, truth, step)
        self._note_gestures(truth)
        self._drawing += int(np.any(truth.drawing))
        return self._gospa.process(real, found)

    def add_gesture(self, gesture: Gesture) -> None:
        """Take in a recognised gesture."""
        self._gestures.append((self._owners.get(gesture.track_id), gesture))

    def add_hand(self, hand: HandTrack, truth: Any) -> None:
        """Take in a hand track and the truth of the same moment; only while the hand draws it is the hand that is meant."""
        rows = np.flatnonzero(truth.drawing)
        if hand.active and len(rows):
            offset = truth.hand_position[rows] - hand.position
            self._hand_square.append(float((offset**2).sum(axis=1).min()))

    def _counts(self, truth: Any) -> NDArray[np.bool_]:
        """Who has been in view for long enough, shape (n_people,)."""
        distance, azimuth, _ = cartesian_to_spherical(self._mount.from_room(truth.position))
        in_view = (np.abs(azimuth) <= self._half_view) & (distance < self._max_range)
        self._seen_since_ns = {
            int(number): self._seen_since_ns.get(int(number), truth.stamp_ns) for number in np.asarray(truth.person_id)[in_view]
        }
        since = [self._seen_since_ns.get(int(number), math.inf) for number in truth.person_id]
        return np.array([truth.stamp_ns - start >= self._settle_ns for start in since], np.bool_)

    def _note_consistency(self, tracks: Tracks, truth: Any, step: ClearMotStep) -> None:
        """Compare the errors of the tracks of people who count with the covariances that the tracks claim."""
        row = {int(number): i for i, number in enumerate(truth.person_id)}
        for person, number in zip(step.truth_id[step.visible].tolist(), step.estimate_id[step.visible].tolist(), strict=True):
            track = tracks.find(number)
            if track is not None:
                self._nees.add(track.position[:2] - truth.position[row[person], :2], track.covariance[:2, :2])

    def _note_gestures(self, truth: Any) -> None:
        """Open or prolong the gestures that are being performed; kept as segments, so that long runs stay small."""
        for number, label, index in zip(truth.person_id, truth.gesture, truth.gesture_index, strict=True):
            if label != NO_GESTURE:
                key = (int(number), int(index))
                old = self._segments.get(key)
                start = old.start_ns if old is not None else truth.stamp_ns
                self._segments[key] = TruthSegment(int(number), int(label), start, truth.stamp_ns)

    def score(self) -> GestureScore:
        """Match the recognised gestures with those performed."""
        recognised = [
            RecognisedGesture(person, g.label, g.start_ns, g.end_ns)
            for person, g in ((p if p is not None else self._owners.get(g.track_id), g) for p, g in self._gestures)
            if person is not None
        ]
        return score_gestures(sorted(self._segments.values(), key=lambda s: (s.start_ns, s.person_id)), recognised)

    def report(self) -> dict[str, Any]:
        """Summarise the run; None stands for what nothing is known of.

        Returns
        -------
        dict
            ``people`` (per person: tracked_fraction, identity_switches, position_rms_m), ``mota``, ``gospa`` (mean_m; power_mean_m and the
            mean parts localisation, missed, false_tracks [m^p], whose sum is its p-th power), ``nees`` (mean of the position on the ground
            over its 2 degrees of freedom, samples, refused: covariances that are none), ``ghost_tracks``, ``gestures`` (hits, wrong,
            misses, false_alarms, total and the list of outcomes), ``hand`` (rms_m, tracked_fraction of the time a hand drew), ``moments``.
        """
        mot = self._mot.summary()
        return {
            "moments": mot.moments,
            "people": {str(number): _person(person) for number, person in mot.people.items()},
            "mota": _known(mot.mota),
            "gospa": self._gospa_report(),
            "nees": self._nees.report(),
            "ghost_tracks": len(self._ghost_ids - set(self._owners)),
            "gestures": self._gesture_report(),
            "hand": {
                "rms_m": math.sqrt(float(np.mean(self._hand_square))) if self._hand_square else None,
                "tracked_fraction": len(self._hand_square) / self._drawing if self._drawing else None,
            },
        }

    def _gospa_report(self) -> dict[str, Any]:
        gospa = self._gospa.summary()
        return {
            "mean_m": _known(gospa.mean),
            "power_mean_m": _known(gospa.distance),
            "localisation": _known(gospa.localisation),
            "missed": _known(gospa.missed),
            "false_tracks": _known(gospa.false_tracks),
        }

    def _gesture_report(self) -> dict[str, Any]:
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
            "total": score.total,
            "hits": score.hits,
            "wrong": score.wrong,
            "misses": score.misses,
            "false_alarms": score.false_alarms,
            "outcomes": outcomes,
        }


class _NeesMean:
    """Mean NEES of positions on the ground, per degree of freedom."""

    def __init__(self) -> None:
        self._sum, self._samples, self._refused = 0.0, 0, 0

    def add(self, error: NDArray[np.float64], covariance: NDArray[np.float64]) -> None:
        """Take in one error, shape (2,) [m], and its covariance, shape (2, 2) [m^2]; NaN: the tracker gives none."""
        if not np.isfinite(covariance).all():
            return
        try:
            self._sum += float(nees(error, covariance)) / 2
            self._samples += 1
        except SingularError:
            self._refused += 1

    def report(self) -> dict[str, Any]:
        """Mean, number of samples, number of covariances that are none."""
        return {"mean": self._sum / self._samples if self._samples else None, "samples": self._samples, "refused": self._refused}


def _known(value: float) -> float | None:
    """None for NaN, which JSON does not have."""
    return None if math.isnan(value) else value


def _person(score: PersonScore) -> dict[str, Any]:
    return {
        "tracked_fraction": _known(score.tracked_fraction),
        "identity_switches": score.switches,
        "position_rms_m": _known(score.rms),
    }
