"""Whether echoes of people are strong enough, and their speeds what they seem."""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_core import PointCloud
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding, unknown
from radar_lab.doctor.heaps import Heap, Window, windows
from radar_tracking.people.config import LifeConfig

WALKS: Final = 0.4
"""Somebody walks who has this range rate [m/s]: half of slow walking, 0.8 m/s."""
REACH: Final = 3.0
"""Distance up to which somebody has to be found [m]: people gesture 1.5 to 3.5 m away in the scenes of the models. Of the rooms for
development walkers reached 5.6 m and more, arms of somebody on the spot 3.4 m, faint walkers 2.7 m and less."""
FOLDED: Final = 0.25
"""Share of the half seconds with somebody who walks whose speed is folded: an eighth is chance (see `FEWEST`), more is not."""
FEWEST: Final = 3  # half seconds with somebody who walks; fewer say nothing
_SURE: Final = 0.25  # m/s: how well the change of range over half a second is known: 0.1 m of range cell over 0.5 s, and more
_PERIODS: Final = 0.25  # of a period: how far the difference may be from a whole number of them


def walkers(cut: list[Window]) -> list[Heap]:
    """Give the strongest heap of each window in which somebody walks towards the radar or away from it."""
    walking = [[h for h in w.heaps if abs(np.median(h.speed)) > WALKS and np.isfinite(h.snr).any()] for w in cut]
    return [heaps[0] for heaps in walking if heaps]


def low_snr(evidence: Evidence) -> Finding:
    """Tell how far away somebody who walks would still begin a track, by the strength of their echo (power falls with range^4)."""
    strong = walkers(windows(ordered(evidence), along_range=True))
    if not strong:  # one is enough: chance makes no heap, and who is hardly seen makes few
        return unknown("low SNR", "nobody walks towards the radar or away from it, whose echo could be measured")
    need = LifeConfig().birth_snr
    at_1m = float(np.median([np.nanmax(heap.snr + 40 * np.log10(np.maximum(heap.range, 0.1))) for heap in strong]))
    reach = float(10 ** ((at_1m - need) / 40))
    fault = reach < REACH
    text = f"somebody who walks reaches {need:.0f} dB, with which a track begins, up to {reach:.1f} m away; a fault below {REACH:.1f} m"
    weaker = max(need - (at_1m - 40 * np.log10(REACH)), 0.0)
    remedy = (
        f"take covers off and point the radar at people (mount.tilt, mount.yaw): {weaker:.0f} dB are missing; until then: "
        f"--param tracking.life.birth_snr={max(need - weaker, 6.0):.0f} --param baseband.cfar.false_alarm=0.001"
    )
    return Finding("low SNR", fault, reach, REACH, "m", text, remedy if fault else "")


def aliased(evidence: Evidence) -> Finding:
    """Compare range rates with how the range changes: they differ by whole periods where the speed is beyond the unambiguous one."""
    wave = evidence.info.waveform
    if wave.n_sample == 0 or not np.isfinite(wave.max_range) or wave.n_chirp < 2:
        return unknown("aliased speed", "this radar's unambiguous speed is not known")
    turns, speeds = [], []
    for window in windows(ordered(evidence), along_range=True):
        for heap in window.heaps[:1]:
            if np.ptp(heap.time) < 0.3:
                continue
            slope = float(np.polyfit(heap.time, heap.range, 1, w=10 ** (np.nan_to_num(heap.snr) / 40))[0])
            if abs(slope) < WALKS:
                continue
            periods = (slope - _circular_mean(heap, wave.max_speed)) / (2 * wave.max_speed)
            whole = round(periods)
            sure = 2 * wave.max_speed > 3 * _SURE and abs(periods - whole) < _PERIODS
            turns.append(whole != 0 and sure)
            speeds.append(abs(slope))
    if len(turns) < FEWEST:
        return unknown("aliased speed", "nobody walks towards the radar or away from it, whose range could be followed")
    share = float(np.mean(turns))
    fault = share > FOLDED
    fast = float(np.quantile(speeds, 0.9))
    text = f"in {share:.0%} of the half seconds with somebody who walks (up to {fast:.1f} m/s) the speed is folded: "
    text += f"the radar tells ±{wave.max_speed:.2f} m/s; a fault above {FOLDED:.0%}"
    return Finding("aliased speed", fault, share, FOLDED, "", text, _faster(evidence, fast) if fault else "")


def _faster(evidence: Evidence, fast: float) -> str:
    """Say what makes the radar tell speeds apart up to ``fast`` [m/s] and the limbs of who walks so, twice as fast."""
    wave = evidence.info.waveform
    interval = wave.wavelength / (4 * 2 * fast * wave.n_tx)
    pause = interval - wave.chirp_duration
    shorter = f"chirp_pause of the waveform to {max(pause, 0.0) * 1e6:.0f} us or less (now {wave.chirp_pause * 1e6:.0f} us)"
    if pause < 0:
        shorter = f"chirps to {interval * 1e6:.0f} us each, pause included (now {wave.chirp_interval * 1e6:.0f} us)"
    return ("--param baseband.tdm.unfold=true; better: shorten " if wave.n_tx > 1 else "shorten ") + shorter


def _circular_mean(heap: Heap, limit: float) -> float:
    """Mean of range rates that wrap around at the unambiguous speed [m/s]."""
    phase = np.pi * heap.speed / limit
    weight = 10 ** (np.nan_to_num(heap.snr) / 10)
    return float(np.angle((weight * np.exp(1j * phase)).sum()) / np.pi * limit)


def ordered(evidence: Evidence) -> list[PointCloud]:
    """Give the clouds in ``room``, by stamp."""
    return [c.to_room(evidence.info.mount) for c in sorted(evidence.clouds, key=lambda cloud: cloud.stamp_ns)]
