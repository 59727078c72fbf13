"""Presence from raw frames of one channel: nobody, somebody who moves, somebody who only breathes; truth by construction."""

import numpy as np
import pytest

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_tracking.presence import PresenceConfig, PresenceDetector

WAVEFORM = {"carrier": 60.5e9, "bandwidth": 2.5e9, "chirp_duration": 64e-6, "chirp_pause": 436e-6, "frame_interval": 0.05}
INFO = RadarInfo(waveform=Waveform(**WAVEFORM, n_tx=1, n_chirp=16, n_sample=48), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),)))
SAMPLES = np.arange(48)


def echo(distance, info=INFO):
    """Samples of every chirp of an echo at these distances, one for each chirp [m]."""
    wave = info.waveform
    phase = 4 * np.pi * distance[:, None] / wave.wavelength + 2 * np.pi * distance[:, None] / wave.range_resolution * SAMPLES / 48
    return np.exp(1j * phase)


def frames(path, seconds, *, seed=0, snr=20.0, still=0.0, info=INFO, lost=()):
    """Frames of noise of unit power, an echo whose distance over time is ``path``, and one at 1.5 m that stands still."""
    rng, wave = np.random.default_rng(seed), info.waveform
    for k in range(round(seconds / wave.frame_interval)):
        if k in lost:
            continue
        time = k * wave.frame_interval + np.arange(wave.n_chirp) * wave.slow_interval
        cube = rng.normal(size=(wave.n_chirp, 48, 2)) @ [1, 1j] / np.sqrt(2)
        if path is not None:
            cube = cube + 10 ** (snr / 20) * echo(path(time))
        cube = cube + still * echo(np.full(wave.n_chirp, 1.52))
        yield RadarFrame(cube[None, :, None].astype(np.complex64), 1 + round(k * wave.frame_interval * 1e9), k, "radar")


def look(given, config=None, info=INFO):
    detector = PresenceDetector(config or PresenceConfig(), info)
    return [detector.process(frame) for frame in given]


def test_nobody_is_nobody():
    """Noise alone, and noise with a strong wall, a thousand frames each."""
    for still in (0.0, 100.0):
        assert not any(one.present for one in look(frames(None, 50.0, still=still)))


@pytest.mark.parametrize("speed", [-1.0, -0.4, 0.5, 1.1])
def test_who_walks_is_seen_with_distance_and_speed(speed):
    """From the first frame on; the speed has its sign."""
    start = 2.6 if speed < 0 else 0.8
    found = look(frames(lambda t: start + speed * t, 1.0, snr=10.0, still=10.0))
    assert all(one.moving and one.present for one in found)
    for k, one in enumerate(found):
        assert one.distance == pytest.approx(start + speed * k * 0.05, abs=0.12)
    assert np.median([one.speed for one in found]) == pytest.approx(speed, abs=0.08)


@pytest.mark.parametrize(("rate", "still"), [(0.2, 0.0), (0.3, 30.0), (0.45, 30.0)])
def test_a_chest_that_breathes(rate, still):
    """Nothing but a chest that goes 4 mm to and fro, also beside a stronger wall in the same cell: there, with its rate."""
    found = look(frames(lambda t: 1.5 + 2e-3 * np.sin(2 * np.pi * rate * t), 24.0, snr=5.0, still=still, seed=3))
    assert not any(one.moving for one in found)
    late = found[-100:]
    assert all(one.present and one.still for one in late)
    assert np.median([one.distance for one in late]) == pytest.approx(1.5, abs=0.06)
    assert np.median([one.breathing for one in late]) == pytest.approx(rate, abs=0.03)


def test_a_fan_does_not_breathe():
    """What shakes at 1.5 Hz is there, but its rate is no breath's; nor is a slow drift by centimetres."""
    for path in (lambda t: 1.5 + 2e-3 * np.sin(2 * np.pi * 1.5 * t), lambda t: 1.5 + 5e-3 * t):
        assert np.isnan([one.breathing for one in look(frames(path, 20.0, snr=5.0))]).all()


def test_who_leaves_is_gone():
    """After the time that is held, and not before."""
    given = [*frames(lambda t: 2.0 + 0.5 * t, 1.0), *frames(None, 31.0, seed=2)]
    given = [RadarFrame(one.cube, 1 + k * 50_000_000, k, "radar") for k, one in enumerate(given)]
    found = look(given, PresenceConfig(hold=3.0))
    assert all(one.present for one in found[: 20 + 58])
    assert not any(one.present for one in found[20 + 62 :])


def test_ranges_that_do_not_count():
    """Nearer than near, farther than far."""
    for config in (PresenceConfig(near=2.5), PresenceConfig(far=1.5)):
        assert not any(one.present for one in look(frames(lambda t: 2.0 + 0.1 * np.sin(9 * t), 1.0, snr=0.0), config))


def test_a_gap_and_a_replay_begin_anew():
    """Breath is not joined over a long gap; stamps that go back are a new recording; chirps that were lost do not count."""

    def path(t):
        return 1.5 + 2e-3 * np.sin(2 * np.pi * 0.3 * t)

    found = look(frames(path, 40.0, snr=5.0, lost=range(300, 600)))
    assert found[299].still
    assert not found[300].still
    detector = PresenceDetector(PresenceConfig(), INFO)
    first = [detector.process(frame) for frame in frames(path, 15.0, snr=5.0)]
    again = [detector.process(frame) for frame in frames(path, 15.0, snr=5.0)]
    assert [one.still for one in first] == [one.still for one in again]
    one = next(iter(frames(path, 0.1, snr=5.0)))
    cube = one.cube.copy()
    cube[:, 3:6] = 0
    holed = RadarFrame(cube, 1, 0, "radar", np.array([3, 4, 5], np.uint32))
    assert not look([holed])[0].moving
    with pytest.raises(DataError, match="lacks 14 of its 16 chirps"):
        look([RadarFrame(cube, 1, 0, "radar", np.arange(14, dtype=np.uint32))])


def test_silence_is_nobody():
    """Frames of zeros."""
    found = look([RadarFrame(np.zeros(INFO.cube_shape, np.complex64), 1 + k, k, "radar") for k in range(200)])
    assert not any(one.present for one in found)
    assert all(np.isfinite(one.level) for one in found)


def test_radars_that_do_not_suit():
    """Too few chirps, point clouds only, no cell between near and far, ranges turned round."""
    for waveform, config, message in (
        ({"n_chirp": 2, "n_sample": 48}, {}, "at least four chirps"),
        ({"n_chirp": 16, "n_sample": 0}, {}, "at least four chirps"),
        ({"n_chirp": 16, "n_sample": 48}, {"near": 2.8}, "lie 1 of the radar's range cells"),
    ):
        with pytest.raises(ConfigError, match=message):
            PresenceDetector(PresenceConfig(**config), RadarInfo(waveform=Waveform(**WAVEFORM, n_tx=1, **waveform), array=INFO.array))
    with pytest.raises(ConfigError, match="near must be less than far"):
        PresenceConfig(near=3.0, far=2.0)
