"""How good was a run? Tracks, gestures and hand against the simulator's truth; the same for demo, node, benchmarks and reports."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from radar_core import RadarInfo
from radar_core.config import config, knob
from radar_core.linalg import SingularError
from radar_core.types import Float64Array
from radar_gestures.gesture import Gesture
from radar_lab.evaluation.matching import Matched, Matching, MatchingConfig, Visibility
from radar_lab.evaluation.scoring import GestureScore, RecognisedGesture, TruthSegment, in_order, note_gestures, own_name, score_gestures
from radar_sim.truth import Truth
from radar_tracking import HandTrack, Tracks
from radar_tracking.metrics import Gospa, nees

_GOSPA = {"mean_m": "mean", "power_mean_m": "distance", "localisation": "localisation", "missed": "missed", "false_tracks": "false_tracks"}


@config
class EvaluationConfig(MatchingConfig):
    """What counts as followed, and as recognised."""

    tolerance: float = knob(0.6, unit="s", low=0.0, high=60.0, doc="a gesture may be found so much before or after it is performed")


class Evaluator:
    """Compare results with the truth of the same stamps, for a radar of which mount, field of view and unambiguous range count.

    Who counts is said by `Visibility`, which track is on whom and what a ghost is by `Matching`, which gestures are right by
    `score_gestures`. A gesture belongs to the person whose its track was while it was performed. A **false gesture** is every published one
    (not random) without a performed one of that person; a gesture of a track that is on nobody is always false.
    """

    def __init__(self, info: RadarInfo, config: EvaluationConfig | None = None) -> None:
        self.config = config or EvaluationConfig()
        self._visibility, self._matching = Visibility(info, self.config), Matching(self.config)
        self._nees = _NeesMean()
        self._segments: dict[tuple[int, int], TruthSegment] = {}
        self._gestures: list[tuple[int | None, Gesture]] = []
        self._hand_square: list[float] = []
        self._drawing = 0

    def add(self, tracks: Tracks, truth: Truth) -> Gospa:
        """Take in the tracks and the truth of one moment. Raises `DataError` for places that are not finite and repeated identities."""
        matched = self._matching.process(tracks, truth, self._visibility.process(truth))
        self._note_consistency(tracks, matched)
        note_gestures(truth, self._segments)
        self._drawing += int(np.any(truth.drawing))
        return matched.gospa

    def add_gesture(self, gesture: Gesture) -> None:
        """Take in a published gesture."""
        self._gestures.append((self._matching.last_owner(gesture.track_id), gesture))

    def add_hand(self, hand: HandTrack, truth: Any) -> None:
        """Take in a hand track and the truth of the same moment; only while the hand draws it is the hand that is meant."""
        rows = np.flatnonzero(truth.drawing)
        if hand.active and len(rows):
            offset = truth.hand_position[rows] - hand.position
            self._hand_square.append(float((offset**2).sum(axis=1).min()))

    def _note_consistency(self, tracks: Tracks, matched: Matched) -> None:
        """Compare the errors of the tracks of people who count with the covariances that the tracks claim."""
        row = {number: i for i, number in enumerate(matched.truth.id.tolist())}
        step, known = matched.step, {track.id: track for track in tracks.tracks}
        pairs = zip(step.truth_id[step.visible].tolist(), step.estimate_id[step.visible].tolist(), strict=True)
        found = [(known[number], matched.truth.position[row[person]]) for person, number in pairs if number in known]
        if found:
            errors = np.array([track.position[:2] - place for track, place in found])
            self._nees.add(errors, np.array([track.covariance[:2, :2] for track, _ in found]))

    def score(self) -> GestureScore:
        """Match the published gestures with those performed."""
        return self._score(self._owned())

    def _owned(self) -> list[tuple[int | None, Gesture]]:
        return [(self._matching.owner(g.track_id, g.start_ns, g.stamp_ns), g) for _, g in self._gestures]

    def score_of_owned(self) -> GestureScore:
        """Score by the first definition: by who a track was on last, gestures of tracks that were on nobody ever left out."""
        owned = [(self._matching.last_owner(g.track_id) if then is None else then, g) for then, g in self._gestures]
        return self._score([(person, g) for person, g in owned if person is not None])

    def _score(self, owned: list[tuple[int | None, Gesture]]) -> GestureScore:
        recognised = [RecognisedGesture(person, g.label, g.start_ns, g.end_ns, own_name(g.label, g.labels)) for person, g in owned]
        return score_gestures(in_order(self._segments), recognised, tolerance=self.config.tolerance)

    def report(self) -> dict[str, Any]:
        """Summarise the run; None stands for what nothing is known of.

        Returns
        -------
        dict
            ``people`` (per person: tracked_fraction, identity_switches, position_rms_m), ``mota``, ``gospa`` (mean_m; power_mean_m and the
            mean parts localisation, missed, false_tracks [m^p], whose sum is its p-th power), ``nees`` (mean of the position on the ground
            over its 2 degrees of freedom, samples, refused: covariances that are none), ``minutes``, ``gate_m`` of the matching,
            ``track_frames``, ``ghost_track_frames`` and ``ghost_track_frames_per_minute``, ``ghost_tracks`` (identities that were on nobody
            ever), ``gestures`` (hits, wrong, misses, false_gestures, false_gestures_per_minute, ghost_gestures, total, outcomes;
            ``false_alarms``: see `score_of_owned`), ``hand`` (rms_m, tracked_fraction of the time a hand drew), ``moments``.
        """
        tracks, mot = self._matching, self._matching.mot
        return {
            "moments": mot.moments,
            "people": {
                str(number): {
                    "tracked_fraction": _known(person.tracked_fraction),
                    "identity_switches": person.switches,
                    "position_rms_m": _known(person.rms),
                }
                for number, person in mot.people.items()
            },
            "mota": _known(mot.mota),
            "gospa": {name: _known(getattr(tracks.gospa, field)) for name, field in _GOSPA.items()},
            "nees": self._nees.report(),
            "minutes": tracks.minutes,
            "gate_m": self.config.gate,
            "track_frames": tracks.track_frames,
            "ghost_track_frames": tracks.ghost_track_frames,
            "ghost_track_frames_per_minute": tracks.ghost_track_frames / tracks.minutes if tracks.minutes else None,
            "ghost_tracks": tracks.ghost_tracks,
            "gestures": self._gesture_report(tracks.minutes),
            "hand": {
                "rms_m": math.sqrt(float(np.mean(self._hand_square))) if self._hand_square else None,
                "tracked_fraction": len(self._hand_square) / self._drawing if self._drawing else None,
            },
        }

    def _gesture_report(self, minutes: float) -> dict[str, Any]:
        score = self.score()
        outcomes = [
            {
                "person": segment.person_id,
                "time_s": segment.start_ns * 1e-9,
                "performed": segment.name,
                "recognised": found.name if found is not None else None,
            }
            for segment, found in score.outcomes
        ]
        return {
            "total": score.total,
            "hits": score.hits,
            "wrong": score.wrong,
            "misses": score.misses,
            "false_gestures": score.false_alarms,
            "false_gestures_per_minute": score.false_alarms / minutes if minutes else None,
            "ghost_gestures": sum(person is None and g.name != "random" for person, g in self._owned()),
            "false_alarms": self.score_of_owned().false_alarms,
            "outcomes": outcomes,
        }


class _NeesMean:
    """Mean NEES of positions on the ground, per degree of freedom."""

    def __init__(self) -> None:
        self._sum, self._samples, self._refused = 0.0, 0, 0

    def add(self, errors: Float64Array, covariances: Float64Array) -> None:
        """Take in errors, shape (n, 2) [m], and their covariances, shape (n, 2, 2) [m^2]; NaN: the tracker gives none."""
        given = np.isfinite(covariances).all(axis=(1, 2))
        errors, covariances = errors[given], covariances[given]
        try:
            self._sum += float(nees(errors, covariances).sum()) / 2
            self._samples += len(errors)
        except SingularError:
            if len(errors) == 1:
                self._refused += 1
                return
            for k in range(len(errors)):
                self.add(errors[k : k + 1], covariances[k : k + 1])

    def report(self) -> dict[str, Any]:
        """Mean, number of samples, number of covariances that are none."""
        return {"mean": self._sum / self._samples if self._samples else None, "samples": self._samples, "refused": self._refused}


def _known(value: float) -> float | None:
    """None for NaN, which JSON does not have."""
    return None if math.isnan(value) else value
