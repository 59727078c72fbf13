"""Symptoms of the tracking, and the settings that cure them: each is tried on the recorded clouds before it is named."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from radar_core import HandwaveError, Quality
from radar_core.config import load, nest
from radar_lab.doctor.echoes import FEWEST, ordered
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding, unknown
from radar_lab.doctor.people import Followed, Life, follow
from radar_tracking import TrackerConfig, make_tracker

Settings = Mapping[str, Any]
"""Knobs of `TrackerConfig` by dotted names, without ``tracking.``."""
UNFOLLOWED: Final = 0.5
"""Share of the half seconds with a walker who is not followed that is a fault. Of the rooms for development healthy ones had 0.0, those
with settings that find nobody 1.0."""
MERGED: Final = 0.25
"""Share of a track's clouds in which it holds two people that is a fault: of the rooms for development one person had
0.22 and less, two in one track 0.43 and more."""
GHOSTS: Final = 0.2
"""Ghosts at a time, on average, that are a fault: one for 2 s of 10 s; shorter ones are not told from people."""
_SHOWN: Final = ("min_speed", "max_distance")
"""Knobs of all trackers that a user may have changed."""
_CURES: Final[Mapping[str, Sequence[Settings]]] = {
    "nobody found": ({}, {"poisson.moved": 0.1}, {"poisson.moved": 0.05, "poisson.leave_time": 2.0}),
    "merged people": ({}, {"poisson.reach": 0.6}, {"poisson.reach": 0.4, "poisson.arm_time": 1.0, "poisson.body_width": 0.3}),
    "lost when still": ({}, *({"poisson.stay_time": t} for t in (8.0, 20.0, 60.0))),
    "ghosts": ({}, {"poisson.moved": 0.4}, {"poisson.moved": 0.8, "poisson.clutter_density": 0.2}),
}
"""Settings of the default tracker that are tried for a symptom, in this order."""
_THESIS_CURES: Final[Mapping[str, Sequence[Settings]]] = {
    "nobody found": (
        {},
        {"life.birth_points": 2, "life.confirm_points": 1.0},
        {"association.clustering.min_points": 1, "life.birth_points": 1, "life.confirm_points": 0.5},
        {
            "association.clustering.min_points": 1,
            "life.birth_points": 1,
            "life.confirm_points": 0.3,
            "life.birth_snr": 6.0,
            "life.tentative_after": 0.5,
            "life.confirm_speed": 0.05,
        },
    ),
    "merged people": (
        {},
        {"life.pair_distance": 0.4, "association.gate": 0.8, "life.birth_distance": 0.6},
        {"life.pair_distance": 0.3, "association.gate": 0.6, "life.birth_distance": 0.5, "life.birth_together": 0.4},
    ),
    "lost when still": ({}, *({"min_speed": 0.0, "life.delete_static_after": t} for t in (3.0, 6.0, 15.0, 60.0))),
    "ghosts": ({}, {"life.confirm_activity": 0.4}, {"life.confirm_activity": 0.4, "life.confirm_points": 3.0}),
}
"""The same of the thesis's trackers."""


class Tuning:
    """Looks for the four symptoms of the tracking in one radar's evidence; ``given`` are settings that the user's tracking has already."""

    def __init__(self, evidence: Evidence, given: Settings | None = None) -> None:
        self._evidence, self._given = evidence, dict(given or {})
        self._thesis = self._given.get("tracker", TrackerConfig().tracker) != "poisson_bernoulli"
        self._clouds = ordered(evidence)
        self.followed = follow(evidence.paired(), evidence.info.mount)

    def findings(self) -> list[Finding]:
        """Look for all four."""
        return [self._nobody(), self._lost(), self._merged(), self._ghosts()]

    def _nobody(self) -> Finding:
        share = self.followed.unfollowed_share
        if share is None or self.followed.walking < FEWEST:
            return unknown("nobody found", "nothing walks towards the radar or away from it: let somebody walk while it is recorded")
        fault = share > UNFOLLOWED
        text = f"in {share:.0%} of the half seconds in which somebody walks nobody is followed there; a fault above {UNFOLLOWED:.0%}"
        well = self._cure("nobody found", lambda f: (f.unfollowed_share or 0.0) <= UNFOLLOWED / 2) if fault else ""
        bounds = "look at zones.boundaries, zones.areas and the mount (x, y, yaw): tracks may lie outside"
        return Finding("nobody found", fault, share, UNFOLLOWED, "", text, (well or bounds) if fault else "")

    def _lost(self) -> Finding:
        lost = self.followed.lost
        gaps = [new.begin - old.end for old, new in lost]
        text = f"{len(lost)} times a track ended and another went on from there"
        text += f", up to {max(gaps):.1f} s later: who stood still was lost" if lost else "; a fault from 1 on"
        if not lost:
            return Finding("lost when still", False, 0.0, 1.0, "", text)
        if any(Quality.STATIC_REMOVED in cloud.quality for cloud in self._clouds):
            remedy = "keep what stands still: --param baseband.spectrum.static=keep"
        else:
            knob = "life.delete_static_after" if self._thesis else "poisson.stay_time"
            longest = f"--param tracking.{knob}={max(2 * max(gaps), 3.0):.0f}"
            remedy = self._cure("lost when still", lambda f: not f.lost) or f"believe longer in who stands still: {longest}"
        return Finding("lost when still", True, float(len(lost)), 1.0, "", text, remedy)

    def _merged(self) -> Finding:
        share, life = self.followed.merged
        fault = share > MERGED
        where = "" if life is None else f" (track {life.number})"
        text = f"of the track that looks most like two people{where} {share:.0%} of the clouds hold two; a fault above {MERGED:.0%}"
        well = self._cure("merged people", lambda f: f.merged[0] <= MERGED) if fault else ""
        second = "look for a second direction in every cell: --config baseband=people"
        return Finding("merged people", fault, share, MERGED, "", text, (well or second) if fault else "")

    def _ghosts(self) -> Finding:
        found, share = self.followed.ghosts, self.followed.ghost_share
        fault = share > GHOSTS
        text = f"{share:.1f} tracks at a time are on nobody; a fault above {GHOSTS:.1f}"
        kinds = {"still": "nothing moves there", "spins": "something turns on the spot, as a fan does"}
        text += "".join(f"; at x {one.last[0]:.1f} m, y {one.last[1]:.1f} m {kinds[one.ghost]}" for one in found if fault)
        if not fault:
            return Finding("ghosts", False, share, GHOSTS, "", text)
        remedy = self._cure("ghosts", lambda f: f.ghost_share <= GHOSTS / 2) or _exclude(found)
        return Finding("ghosts", True, share, GHOSTS, "", text, remedy)

    def _cure(self, symptom: str, well: Callable[[Followed], bool]) -> str:
        """Name the first settings with which the symptom is gone, and nobody is lost for it; empty: none of them helps."""
        before = self.followed.unfollowed_share or 0.0
        candidates = (_THESIS_CURES if self._thesis else _CURES)[symptom]
        for settings in candidates:
            then = self._again(settings)
            if then is None or not well(then) or (then.unfollowed_share or 0.0) > before + 0.1:
                continue
            if settings:
                return f"on this recording this helps: {_params(settings)}"
            defaults = TrackerConfig()
            back = {name: _value(defaults, name) for name in ("tracker", *_SHOWN, *dict.fromkeys(k for other in candidates for k in other))}
            return f"with the defaults it is well on this recording; set back what you have changed, of: {_params(back)}"
        return ""

    def _again(self, settings: Settings) -> Followed | None:
        """Track the same clouds with other settings; None: they make no sense together."""
        chosen = {**self._given, **settings} if settings else {}
        try:
            tracker = make_tracker(load(TrackerConfig, nest(chosen)), self._evidence.info)
            pairs = [(cloud, tracker.process(cloud)) for cloud in self._clouds]
        except HandwaveError:
            return None
        return follow(pairs, self._evidence.info.mount)


def _value(config: Any, name: str) -> Any:
    for part in name.split("."):
        config = getattr(config, part)
    return config


def _params(settings: Settings) -> str:
    return " ".join(f"--param tracking.{name}={value}" for name, value in settings.items())


def _exclude(ghosts: Sequence[Life]) -> str:
    """Write the zones in which nothing is followed, half a metre about each place."""
    zones = []
    for one in ghosts:
        x, y = one.last
        corners = ((x - 0.4, y - 0.4), (x + 0.4, y - 0.4), (x + 0.4, y + 0.4), (x - 0.4, y + 0.4))
        zones.append("'exclusion " + ", ".join(f"{a:.1f} {b:.1f}" for a, b in corners) + "'")
    return f'follow nobody there: --param "tracking.zones.areas=[{", ".join(zones)}]"'
