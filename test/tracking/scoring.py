"""How well tracks follow truth: fraction of the time, identity switches, position error, false tracks (CLEAR-MOT's pairing)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from radar_tracking import Tracks
from radar_tracking.metrics import ClearMot, ClearMotConfig, ObjectSet, people


@dataclass
class Score:
    """Call `add` for every cloud; a person counts as tracked when a confirmed or coasting track is within `radius` on the floor plane."""

    radius: float = 0.7
    false_clouds: int = 0
    clouds: int = 0
    last: dict[int, int] = field(default_factory=dict)
    false_ids: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._mot = ClearMot(ClearMotConfig(radius=self.radius))

    def add(self, truth: np.ndarray, tracks: Tracks, visible: np.ndarray | None = None) -> None:
        """Compare with the bodies, shape (people, 3); those that are not visible do not count."""
        step = self._mot.process(ObjectSet.of(np.asarray(truth)[:, :2], visible=visible), people(tracks))
        self.last.update(zip(step.truth_id.tolist(), step.estimate_id.tolist(), strict=True))
        self.false_ids.update(step.false.tolist())
        self.false_clouds += len(step.false) > 0
        self.clouds += 1

    @property
    def switches(self) -> int:
        """Changes of a person's track."""
        return self._mot.summary().switches

    @property
    def mota(self) -> float:
        """Multiple-object tracking accuracy."""
        return self._mot.summary().mota

    @property
    def tracked(self) -> float:
        """Fraction of the time of the person who was followed worst."""
        return min(person.tracked_fraction for person in self._mot.summary().people.values() if person.moments)

    @property
    def rms(self) -> float:
        """Position error on the floor plane over everybody [m]."""
        return self._mot.summary().rms
