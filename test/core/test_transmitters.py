"""One transmitter of a radar: the same echoes at the same times through its own channels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.transmitters import one_transmitter, one_transmitter_frame

INFO = RadarInfo(array=AntennaArray(channel_gain=tuple(np.arange(8.0)), channel_phase=tuple(0.1 * np.arange(8))))


@pytest.mark.parametrize("tx", [0, 1])
def test_waveform_and_channels(tx):
    """Speeds, Doppler bins and frame interval stay; channels and their calibration are the transmitter's own."""
    one = one_transmitter(INFO, tx)
    for name in ("max_speed", "speed_resolution", "slow_interval", "acquisition_time", "frame_interval", "max_range"):
        assert getattr(one.waveform, name) == pytest.approx(getattr(INFO.waveform, name), rel=1e-12), name
    np.testing.assert_array_equal(one.array.virtual, INFO.array.virtual[4 * tx : 4 * tx + 4])
    np.testing.assert_array_equal(one.array.response, INFO.array.response[4 * tx : 4 * tx + 4])
    assert one.cube_shape == (1, 64, 4, 64)


def test_frames_keep_their_chirps_and_times():
    """Chirp l of transmitter t starts (l n_tx + t) chirp intervals after the stamp, before and after."""
    rng = np.random.default_rng(1)
    cube = rng.standard_normal((2, 64, 4, 64, 2)).astype(np.float32).view(np.complex64)[..., 0]
    frame = RadarFrame(cube, 10**9, 7, "radar", np.array([0, 3, 5, 6], np.uint32))
    for tx, missing in ((0, [0, 3]), (1, [1, 2])):
        one, info = one_transmitter_frame(frame, INFO, tx), one_transmitter(INFO, tx)
        one.check(info)
        np.testing.assert_array_equal(one.cube[0], cube[tx])
        assert one.missing.tolist() == missing
        for chirp in (0, 5, 63):
            before = frame.stamp_ns + (chirp * 2 + tx) * INFO.waveform.chirp_interval * 1e9
            after = one.stamp_ns + chirp * info.waveform.chirp_interval * 1e9
            assert after == pytest.approx(before, abs=1)  # stamps are whole nanoseconds


def test_what_is_not_there_is_named():
    with pytest.raises(ConfigError, match="no transmitter 2: the array has 2"):
        one_transmitter(INFO, 2)
    with pytest.raises(ConfigError, match="no transmitter -1"):
        one_transmitter(INFO, -1)
    other = RadarFrame(np.zeros((1, 2, 4, 8), np.complex64), 0, 0, "radar")
    with pytest.raises(DataError, match="has shape"):
        one_transmitter_frame(other, dataclasses.replace(INFO))
