"""How well tracks follow truth: fraction of the time, identity switches, position error, false tracks (CLEAR-MOT's pairing)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_tracking import Tracks, TrackStatus

FAR = 1e6


@dataclass
class Score:
    """Call `add` for every cloud; a person counts as tracked when a confirmed or coasting track is within `radius` on the floor plane."""

    radius: float = 0.7
    switches: int = 0
    false_clouds: int = 0
    clouds: int = 0
    last: dict[int, int] = field(default_factory=dict)
    present: dict[int, int] = field(default_factory=dict)
    errors: dict[int, list[float]] = field(default_factory=dict)
    false_ids: set[int] = field(default_factory=set)

    def add(self, truth: np.ndarray, tracks: Tracks) -> None:
        """Compare with the bodies, shape (people, 3)."""
        people = [t for t in tracks.tracks if t.status != TrackStatus.TENTATIVE]
        place = np.array([t.position[:2] for t in people]).reshape(-1, 2)
        distance = np.hypot(*np.moveaxis(place[None] - np.asarray(truth)[:, None, :2], -1, 0))
        cost = np.where(distance < self.radius, distance, FAR)
        for i, identity in self.last.items():  # the pairing of before stays as long as it holds
            for j, track in enumerate(people):
                if track.id == identity and i < len(truth) and distance[i, j] < self.radius:
                    cost[i, j] = -1.0
        rows, columns = linear_sum_assignment(cost)
        pairs = {int(i): int(j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < FAR}
        for i in range(len(truth)):
            self.present[i] = self.present.get(i, 0) + 1
            if i in pairs:
                identity = people[pairs[i]].id
                self.switches += self.last.get(i, identity) != identity
                self.last[i] = identity
                self.errors.setdefault(i, []).append(float(distance[i, pairs[i]]))
        wrong = {t.id for j, t in enumerate(people) if j not in pairs.values()}
        self.false_ids |= wrong
        self.false_clouds += bool(wrong)
        self.clouds += 1

    @property
    def tracked(self) -> float:
        """Fraction of the time of the person who was followed worst."""
        return min(len(self.errors.get(i, [])) / n for i, n in self.present.items())

    @property
    def rms(self) -> float:
        """Position error on the floor plane over everybody [m]."""
        return float(np.sqrt(np.mean(np.square([e for errors in self.errors.values() for e in errors]))))
