"""One detection per Doppler bin (thesis, 4.2): what is left is the strongest of what the full chain finds, number for number."""

import dataclasses

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise

import radar_dsp.baseband
from radar_core import ConfigError, RadarInfo, Waveform
from radar_core.cloud import ARRAY_FIELDS
from radar_core.config import load
from radar_dsp import Baseband, BasebandConfig, DoaConfig
from radar_dsp.baseband import strongest_per_speed

INFO = RadarInfo()
ALL = BasebandConfig(doa=DoaConfig(gate=False))  # a gate would drop points after the choice


def crowd(seed):
    """A frame with thirty echoes at ten speeds: several ranges share every Doppler bin."""
    rng = np.random.default_rng(seed)
    speeds = rng.uniform(-3.5, 3.5, 10)
    parts = [
        echo(
            INFO,
            rng.uniform(0.6, 5.8),
            rng.choice(speeds),
            *rng.uniform([-0.9, -0.4], [0.9, 0.4]),
            amplitude_for(rng.uniform(15, 40), INFO),
        )
        for _ in range(30)
    ]
    return frame(INFO, noise(INFO, rng), *parts)


@pytest.mark.parametrize("backend", ["numba", "numpy"])
@pytest.mark.parametrize("grouping", ["none", "range", "peak"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_strongest_detection_of_every_doppler_bin_of_the_full_chain(monkeypatch, seed, grouping, backend):
    """Every field is the full chain's, bit for bit: each direction is estimated from its own cell."""
    seen = []

    def spy(cells, power):
        seen.append((cells, power[cells]))
        return strongest_per_speed(cells, power)

    config = dataclasses.replace(ALL, grouping=grouping, backend=backend, max_detections=4096)
    full = Baseband(config, INFO).process(crowd(seed))
    monkeypatch.setattr(radar_dsp.baseband, "strongest_per_speed", spy)
    one = Baseband(dataclasses.replace(config, select="doppler"), INFO).process(crowd(seed))
    (speed, _), power = seen[-1]
    assert len(speed) == len(full)  # the points of the full chain are those cells, in that order
    expected = full.select(np.array([np.flatnonzero(speed == s)[np.argmax(power[speed == s])] for s in np.unique(speed)]))
    assert len(one) == len(expected) < len(full)
    for name in ARRAY_FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(expected, name))


def test_of_equal_powers_the_nearest_stays():
    """By hand: two equal cells at speed 0, one at speed 5; no cells at all."""
    power = np.zeros((8, 8), np.float32)
    power[0, [2, 6]], power[0, 4], power[5, 1] = 3.0, 1.0, 2.0
    cells = np.nonzero(power)
    speed, distance = strongest_per_speed(cells, power)
    assert (speed.tolist(), distance.tolist()) == ([0, 5], [2, 1])
    speed, distance = strongest_per_speed((np.empty(0, np.intp), np.empty(0, np.intp)), power)
    assert len(speed) == len(distance) == 0


def test_the_cap_counts_what_was_chosen():
    """At most one point per bin reaches the cap, so that 64 bins never exceed it, and no frame is called capped."""
    baseband = Baseband(dataclasses.replace(ALL, grouping="none", select="doppler", max_detections=64), INFO)
    cloud = baseband.process(crowd(1))
    assert 0 < len(cloud) <= INFO.waveform.n_chirp
    assert baseband.n_capped == 0


def test_one_chirp_is_one_bin():
    """Without Doppler measurement there is one bin, and the strongest echo of all is left."""
    info = dataclasses.replace(INFO, waveform=dataclasses.replace(Waveform(), n_chirp=1))
    rng = np.random.default_rng(3)
    near, far = (echo(info, d, 0.0, 0.1, 0.0, amplitude_for(snr, info)) for d, snr in ((2.0, 30.0), (4.0, 45.0)))
    cloud = Baseband(dataclasses.replace(ALL, select="doppler"), info).process(frame(info, noise(info, rng), near, far))
    assert cloud.range.tolist() == pytest.approx([4.0], abs=0.05)


def test_a_choice_that_does_not_exist_is_refused():
    with pytest.raises(ConfigError, match="select"):
        load(BasebandConfig, {"select": "range"}, "test")
