"""Who is there: log odds of existence and of being a person, confirmation, duplicates, deletion."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.people.zones import View, Zones
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.kernels import Shares, hidden
from radar_tracking.poisson.motion import Update, resting
from radar_tracking.poisson.person import MOVED_TIME, faint, person_odds, went
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import SHOWN, Table
from radar_tracking.tracks import Deleted, Reason

CONFIRM_ODDS: Final = 3.0  # log odds from which a track may be a person; it ends below minus this
MOST_ODDS: Final = 6.0  # more evidence than this is not collected
_LEAST, _MOST = -1.0, 3.0  # nat: one cloud says no more
_LEAST_RATE: Final = 0.5  # points of a cloud: who has fewer is hard to tell from nobody
_RATE_TIME, _HIT_TIME, _PRESENCE_TIME, _ANCHOR_TIME, _LIVELY_TIME = 1.0, 0.5, 30.0, 1.0, 0.2  # s
_STANDS_WITHIN: Final = 0.35  # m of the anchor
_RESTED: Final = 1.0  # s unseen: nobody knows any more whether somebody rests
_LIKELY: Final = 1.0  # log odds of being a person
_GIVE_POINTS: Final = 0.8  # share of the time with points: radars to which those who stand give fewer lose people when they stop
_VANISHED: Final = 0.25  # s: there, people who give no points any more have stopped
_SLOW_RATE: Final = 0.3  # who stands gives few points for a while and many again: the rate falls so much slower
_TENTATIVE: Final = 0.5  # s: what has moved only once is believed no longer
_HIDDEN: Final = 4.0  # who is hidden is believed so many times longer
_KNOWN_AFTER: Final = 2.0  # s in sight: before, nobody is believed to stand
_SURELY: Final = 3.0  # log odds of being a person: who looks less like one is believed less
_HELD: Final = 7.0  # and who has been in sight all the time
_ASIDE: Final = 0.3  # m from the side of the view: who vanishes there has probably left
_FURNISHED: Final = 20.0  # s: who stands with still points about, furniture or not, is believed at least so long
_PERSON_TIME: Final = 1.5  # s: the odds are averaged over this
_JUST: Final = 0.2  # s: who is unseen for longer gives no look to judge
_NO_PERSON: Final = -1.0  # log odds below which a confirmed track is no person any more
_LEAST_HITS: Final = 0.2
_DRIFT: Final = 0.3  # m: tracks of nothing wander so far
_ALONG: Final = 1.0  # m: an arm never goes so far from where it appeared
_ARM_RATE: Final = 0.25  # of the rate of its person: fewer points are an arm's
_LIMB_RATE: Final = 0.65  # what goes along with somebody who walks and has fewer points is an arm or a leg, until it has stayed
_LIMB_STAYS: Final = 2.0  # and so many times longer beside somebody who stands, whose arms come again and again
_TOO_NEAR: Final = 0.6  # m: nobody appears so near to somebody who stands and is seen; what is there is an arm
_OWN_POINTS: Final = 1.0  # s: who has looked like a person for so long keeps the points, confirmed or not
_BODY_RATE: Final = 0.6  # of the points of the person who has most
_SAME_TIME, _SAME_TIME_APART = 1.0, 8.0  # s: two confirmed tracks at one place for so long are one; if they have been apart
_APART: Final = 1.0  # m
_AGAIN, _AGAIN_AFTER = 1.2, 0.5  # m, s: who appears so near to a person unseen for so long is that person
_WENT_OFF: Final = 2.0  # s: who is not seen any more since shortly after somebody began beside them is that person, who went off
_ONE_BODY: Final = 1.3  # body widths: of two people this near to each other one follows the other's body, if somebody begins beside them
_OUT_AFTER: Final = 0.3  # s unseen out of view: left


_jit = numba.njit(cache=True, nogil=True)


@_jit
def _share(dt: float, time: float) -> float:
    """Weight of a new value in a mean over ``time`` [s]."""
    return 1.0 - math.exp(-dt / time)


def weigh(table: Table, shares: Shares, dt: float, now: float, config: PoissonConfig, view: View) -> None:
    """Change log odds and rates by what a cloud says."""
    rows, away = table.rows, table.mean[:, :2] - view.origin[:2]
    aside = view.margin(np.column_stack([table.mean[:, :2], np.full(len(table), view.origin[2])])) < _ASIDE
    # Copies are contiguous whether there is one row or more: loops are compiled once.
    covered = hidden(np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0]), rows["confirmed"].copy())
    held = _HELD * min((1.0 - table.stood[0] / table.stood[1]) / (1.0 - SHOWN), 1.0)
    times = config.stay_time, config.leave_time, config.correlation_time
    _weigh(rows, shares.sums, shares.evidence, shares.count, shares.support, aside, covered, held, times, dt, now)


@_jit
def _weigh(
    rows: Any, sums: Any, evidence: Any, count: Any, support: Any, aside: Any, covered: Any, held: float, times: Any, dt: float, now: float
) -> None:
    for i in range(len(rows)):
        row, said, corr = rows[i], evidence[i], times[2]
        patience = _patience(row, row.stands and support[i] > 0.5, covered[i], 0.0 if aside[i] else held, times)
        fresh = min(max((now - row.counted) / corr, min(1.0, dt / corr)), 1.0)
        loss = min(max(said, _LEAST), 0.0) * (MOST_ODDS + CONFIRM_ODDS) * dt / patience
        row.odds = min(row.odds + min(max(said, 0.0), _MOST) * fresh + loss, MOST_ODDS)
        if said > 0.5:
            row.counted = now
        slower = _SLOW_RATE if row.stands and count[i] < row.rate else 1.0
        row.rate = max(row.rate + _share(dt, _RATE_TIME) * (count[i] - row.rate) * slower, _LEAST_RATE)
        points, moving = sums[i].points, sums[i].moving
        row.lively += _share(dt, _LIVELY_TIME) * (moving - row.lively * points) / max(points, 1.0)
        hit = 1.0 if max(count[i], support[i] if row.stands else 0.0) > 0.5 else 0.0
        row.hits += _share(dt, _HIT_TIME) * (hit - row.hits)
        row.presence += _share(dt, _PRESENCE_TIME) * (hit - row.presence)


@_jit
def _patience(row: Any, supported: bool, covered: bool, held: float, times: Any) -> float:
    """How long a track is believed without points [s]."""
    known = min(row.presence * _PRESENCE_TIME / _KNOWN_AFTER, 1.0)
    if row.confirmed:
        known *= min(max(row.person / _SURELY, 0.05), 1.0)
    stay, leave = times[0] * (1.0 + held * min(2.0 * row.presence, 1.0)) * known, times[1]
    patience = max(stay, leave) if row.stands else leave
    if covered:
        patience *= _HIDDEN
    if not (row.confirmed or row.stands):
        patience = min(patience, _TENTATIVE)
    return float(max(patience, _FURNISHED) if supported else patience)


def note_motion(table: Table, update: Update, measured: Measured, dt: float, now: float, config: PoissonConfig) -> None:
    """Add up how far tracks have moved, and whether they stand."""
    rows = table.rows
    _move(rows, update.rows, np.abs(update.speed), measured.still_speed, dt, now, config.correlation_time)
    rests = resting(table) & (now - rows["seen"] < _RESTED)
    _stand(rows, table.mean, rests, table.stood, dt, now)


@_jit
def _move(rows: Any, own: Any, speed: Any, still_speed: float, dt: float, now: float, corr: float) -> None:
    """Take in speeds [m/s] of the tracks ``own``, shape (n_rows,); NaN: not measured."""
    fading = math.exp(-dt / MOVED_TIME)
    for i in range(len(rows)):
        rows[i].moved *= fading
    for k in range(len(own)):
        row = rows[own[k]]
        row.seen = now
        if speed[k] > still_speed:
            row.moved += (speed[k] - 0.05) * min(now - row.stirred, corr)
            row.stirred = now


@_jit
def _stand(rows: Any, mean: Any, rests: Any, stood: Any, dt: float, now: float) -> None:
    for i in range(len(rows)):
        row = rows[i]
        for k in range(2):
            row.anchor[k] += _share(dt, _ANCHOR_TIME) * (mean[i, k] - row.anchor[k])
            row.haunt[k] += _share(dt, MOVED_TIME) * (mean[i, k] - row.haunt[k])
        row.stands = rests[i] or math.hypot(mean[i, 0] - row.anchor[0], mean[i, 1] - row.anchor[1]) < _STANDS_WITHIN
        if row.confirmed and row.person > _LIKELY and row.stands:
            stood[0] += dt if row.hits > 0.5 else 0.0
            stood[1] += dt
    if stood[0] < _GIVE_POINTS * stood[1]:
        for i in range(len(rows)):
            row = rows[i]
            vanished = now - row.seen > _VANISHED and now - row.born > _KNOWN_AFTER
            row.stands |= row.confirmed and row.person > _LIKELY and vanished


def bodies(table: Table) -> BoolArray:
    """People, and likely tracks with enough points for a body, shape (n_tracks,)."""
    rows = table.rows
    least = _BODY_RATE * float(rows["rate"][rows["confirmed"]].max(initial=0.0))
    return np.asarray(rows["confirmed"] | ((rows["odds"] > CONFIRM_ODDS) & (rows["rate"] > least)))


class Decisions:
    """Confirms, joins and ends tracks."""

    def __init__(self, config: PoissonConfig, view: View, zones: Zones) -> None:
        self._config, self._view, self._zones = config, view, zones

    def process(self, table: Table, dt: float, now: float) -> tuple[tuple[Deleted, ...], list[int]]:
        """Decide after a cloud; returns the tracks that ended and the rows, of those that stay, that were confirmed now."""
        if not len(table):
            return (), []
        rows = table.rows
        ends: dict[int, Reason] = {}
        self._judge(table, dt, now)
        place = np.column_stack([table.mean[:, :2], np.full(len(table), self._view.origin[2])])
        inside = self._view.sees(place) & self._zones.inside(place)
        gaps = table.gaps()
        new = self._confirm(table, gaps, inside, now, ends)
        self._join(table, self._coarse(table), gaps, dt, ends)
        for row in np.flatnonzero(rows["odds"] < -CONFIRM_ODDS):
            ends.setdefault(int(row), Reason.UNSEEN if rows["confirmed"][row] else Reason.NOT_CONFIRMED)
        for row in np.flatnonzero(~inside & (now - rows["seen"] > _OUT_AFTER)):
            ends.setdefault(int(row), Reason.LEFT)
        if not ends:
            return (), new
        ended = [(rows[row], why) for row, why in ends.items()]
        deleted = tuple(Deleted(abs(int(row["id"])), why, bool(row["confirmed"] and row["id"] > 0)) for row, why in ended)
        stay = np.array(sorted(set(range(len(table))) - ends.keys(), key=lambda row: int(rows["id"][row])), np.int64)
        table.keep(stay)
        renamed = {old: position for position, old in enumerate(stay.tolist())}
        return deleted, [renamed[row] for row in new if row in renamed]

    def _judge(self, table: Table, dt: float, now: float) -> None:
        """Average the odds of being a person while a track is seen; who loses them is no person any more, and keeps its points."""
        rows = table.rows
        odds = person_odds(table)
        share = 1.0 - np.exp(-dt / np.minimum(now - rows["born"] + 0.1, _PERSON_TIME))
        rows["person"] += np.where(now - rows["seen"] < _JUST, share, 0.0) * (odds - rows["person"])
        rows["confirmed"] &= rows["person"] >= _NO_PERSON

    def _confirm(self, table: Table, gaps: Float64Array, inside: BoolArray, now: float, ends: dict[int, Reason]) -> list[int]:
        rows, config, found = table.rows, self._config, []
        if rows["confirmed"].all():
            rows["arm_of"] = 0
            return []
        way = went(table)
        ready = (rows["odds"] > CONFIRM_ODDS) & (rows["hits"] > _LEAST_HITS) & (rows["person"] > 0.0) & inside & ~rows["confirmed"]
        ready &= ~faint(table, self._view.origin, config.body_height)
        ready &= np.maximum(rows["moved"], way - _DRIFT) > config.moved * np.clip(1.5 * (1.0 - rows["person"]), 0.0, 1.5)
        ready &= ~self._zones.excluded(np.column_stack([table.mean[:, :2], rows["height"]]))
        near = self._near(table, gaps, way, now)
        there = rows["confirmed"] & rows["stands"] & (now - rows["seen"] < _AGAIN_AFTER)
        for row in np.flatnonzero(ready).tolist():
            own = near[row]
            limb = (rows["rate"][row] < _LIMB_RATE * rows["rate"][own & rows["stands"]]).any()
            young = now - rows["born"][row] < config.arm_time * (_LIMB_STAYS if limb else 1.0)
            if (gaps[row][there] < _TOO_NEAR).any():
                continue
            if own.any() and (young or (rows["rate"][row] < _ARM_RATE * rows["rate"][own]).any()):
                continue  # has not yet stayed, or gone along, as somebody would
            self._recover(table, gaps, row, now, ends)
            rows["confirmed"][row] = True
            found.append(row)
            near = self._near(table, gaps, way, now)
        somebody = (rows["odds"] > CONFIRM_ODDS) & (rows["person"] > 0.0) & (now - rows["born"] > _OWN_POINTS)
        away = np.where(near, gaps, np.inf)
        arm = near.any(axis=1) & ~(somebody & (away.min(axis=1) > _TOO_NEAR))
        rows["arm_of"] = np.where(arm, rows["id"][away.argmin(axis=1)], 0)
        return found

    def _near(self, table: Table, gaps: Float64Array, way: Float64Array, now: float) -> BoolArray:
        """Which tentative tracks are, or began, within reach of which people and did not go along with them, shape (n_tracks, n_tracks)."""
        rows, people, away = table.rows, table.rows["confirmed"], table.mean[:, :2] - self._view.origin[:2]
        error = np.sqrt(np.maximum(table.covariance[:, 0, 0], table.covariance[:, 1, 1]))
        error += 0.5 * self._config.angle_std * np.hypot(away[:, 0], away[:, 1])
        limit = (self._config.reach + error)[:, None]
        step = rows["birthplace"][:, None] - table.mean[None, :, :2]
        began = (np.hypot(step[..., 0], step[..., 1]) < limit) & (gaps < 2.0 * self._config.reach)
        limb = (rows["rate"][:, None] < _LIMB_RATE * rows["rate"]) & (now - rows["born"] < self._config.arm_time)[:, None]
        return np.asarray(((gaps < limit) | began) & (people & ~people[:, None]) & (rows["stands"] | (way[:, None] < _ALONG) | limb))

    def _recover(self, table: Table, gaps: Float64Array, row: int, now: float, ends: dict[int, Reason]) -> None:
        """Give a new person the identity of one who stood there unseen since, who went off, follows another's body, or is a limb."""
        rows = table.rows
        people = [k for k in np.flatnonzero(rows["confirmed"]).tolist() if k not in ends]
        step = table.mean[:, :2] - rows["birthplace"][row]
        unseen = [k for k in people if now - rows["seen"][k] > _AGAIN_AFTER]
        lost = [k for k in unseen if gaps[row, k] < _AGAIN]
        lost = lost or [k for k in unseen if rows["seen"][k] < rows["born"][row] + _WENT_OFF and math.hypot(*step[k]) < _AGAIN]
        if not lost:  # who began together with a person of few points is the body of which that one was a limb
            began = np.hypot(*(rows["birthplace"] - rows["birthplace"][row]).T)
            limb = (rows["rate"] < _LIMB_RATE * rows["rate"][row]) & (began < _TOO_NEAR) & (gaps[row] < self._config.reach)
            lost = [k for k in people if limb[k]]
        if not lost:
            near = [k for k in people if math.hypot(*step[k]) < _AGAIN]
            lost = [k for k in near if any(gaps[k, j] < _ONE_BODY * self._config.body_width and table.were_apart(k, j) for j in people)]
        if not lost:
            return
        old = min(lost, key=lambda k: float(gaps[row, k]))
        rows["id"][row], rows["id"][old] = rows["id"][old], -rows["id"][row]
        for name in ("born", "presence", "total"):
            rows[name][row] = rows[name][old]
        table.ways[row] = np.maximum(table.ways[row], table.ways[old])
        ends[old] = Reason.DUPLICATE

    def _coarse(self, table: Table) -> Float64Array:
        """Distances between tracks in body widths, or in range cells along the line of sight where these are larger; shape (n, n)."""
        step = table.mean[:, None, :2] - table.mean[None, :, :2]
        sight = table.rows["sight"][:, None] + table.rows["sight"][None, :]
        sight /= np.maximum(np.hypot(sight[..., 0], sight[..., 1]), 1e-6)[..., None]
        along, across = (step * sight).sum(axis=-1), step[..., 0] * sight[..., 1] - step[..., 1] * sight[..., 0]
        gap = np.hypot(along / max(self._config.body_width, self._view.range_cell), across / self._config.body_width)
        np.fill_diagonal(gap, np.inf)
        return np.asarray(gap)

    def _join(self, table: Table, coarse: Float64Array, gaps: Float64Array, dt: float, ends: dict[int, Reason]) -> None:
        """End tracks on top of others: tentative ones at once, confirmed ones when they stay there."""
        rows = table.rows
        table.part(dt)
        people = rows["confirmed"]
        before = np.arange(len(table))[:, None] < np.arange(len(table))
        table.note_apart(*np.nonzero(before & people[:, None] & people & (gaps > _APART)))
        for one, other in np.argwhere(before & (coarse < 1.0)).tolist():
            if one in ends or other in ends:
                continue
            if people[one] and people[other]:
                limit = _SAME_TIME_APART if table.were_apart(one, other) else _SAME_TIME
                if table.together(one, other, dt) > limit:
                    weight = rows["rate"] * (rows["presence"] + 0.1)
                    ends[one if weight[one] < weight[other] else other] = Reason.DUPLICATE
            elif people[one] or people[other]:
                ends[other if people[one] else one] = Reason.DUPLICATE
            else:
                ends[one if rows["odds"][one] < rows["odds"][other] else other] = Reason.DUPLICATE
