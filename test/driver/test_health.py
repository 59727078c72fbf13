"""Health checks against signals whose noise, leakage, clipping, pace and losses are known."""

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import AntennaArray, DataError, DeviceError, PointCloud, RadarFrame, RadarInfo, Waveform
from radar_driver.boards import board
from radar_driver.health import Health, HealthConfig, Verdict, probe, worst
from radar_driver.sources import Reading
from radar_sim import Simulator, load_scene
from radar_sim.effects import config as effects
from radar_sim.effects import noise, transmitter
from radar_sim.propagation.base import IMPEDANCE

INFO = RadarInfo(full_scale=1000.0)
STEP = round(INFO.waveform.frame_interval * 1e9)


def frames(count=5, sigma=1.0, leak=0.0, info=INFO, seed=0):
    """White noise of known power in every receiver, and a still tone at zero range."""
    rng = np.random.default_rng(seed)
    sigmas = np.broadcast_to(sigma, info.array.n_rx)[:, None]
    for number in range(count):
        white = rng.normal(size=(*info.cube_shape, 2)) @ [1, 1j] / math.sqrt(2)
        yield RadarFrame(np.asarray(white * sigmas + leak, np.complex64), number * STEP, number, "radar")


def judge(given, info=INFO, report=None, **limits):
    """All checks of some frames that come in time, by name."""
    health = Health(info, HealthConfig(**limits))
    for frame in given:
        health.process(frame, frame.sequence * STEP)
    return {check.name: check for check in health.checks(report or {}, 1.0)}


@pytest.mark.parametrize("sigma", [1e-3, 1.0, 300.0])
def test_noise_floor(sigma):
    """5 frames have 128 x 64 cells per receiver each; the median of 128 errs by 10 %, that of 64 such by 2 %: 0.1 dB is five of them."""
    found = judge(frames(sigma=sigma))
    assert found["noise floor"].value == pytest.approx(20 * math.log10(sigma / 1000), abs=0.1)
    assert found["noise floor"].verdict is Verdict.OK
    assert found["noise floor"].unit == "dBFS"
    assert found["noise spread"].value < 0.3


def test_noise_floor_of_an_analytic_signal():
    """Real samples turned analytic fill half of the ranges: the floor is that of the filled half, and the empty one does not count."""
    half = []
    for frame in frames(sigma=2.0):
        spectrum = np.fft.fft(frame.cube, axis=-1)
        spectrum[..., 32:] = 0
        half.append(replace(frame, cube=np.fft.ifft(spectrum, axis=-1).astype(np.complex64)))
    assert judge(half)["noise floor"].value == pytest.approx(20 * math.log10(2 / 1000), abs=0.3)  # fewer cells, and two at the edge


def test_noise_floor_of_a_simulated_room():
    """People, walls of clutter and coupling hardly move it: k T F B, as the simulator has it."""
    simulator = Simulator(load_scene("demo"))
    found = judge((simulator.process(k).frame for k in range(300, 310)), simulator.info)
    config = load_scene("demo").effects
    expected = 10 * math.log10(noise.power(config.noise, simulator.info) * IMPEDANCE)
    # Two bodies fill some of the 64 ranges with Doppler: a bias upwards.
    assert -0.1 < found["noise floor"].value - expected < 0.6
    leak = 20 * math.log10(transmitter.leaked(config.coupling, simulator.info))
    # Between two bins a Hann window takes up to 1.4 dB; the leakage appears at 0.03 m, 0.3 bins of 0.1 m.
    assert found["coupling"].value == pytest.approx(leak, abs=1.4)
    assert found["coupling"].verdict is Verdict.UNKNOWN  # no full scale to compare with


@pytest.mark.parametrize(("leak", "verdict"), [(1.0, Verdict.OK), (400.0, Verdict.WARN), (900.0, Verdict.FAIL)])
def test_coupling(leak, verdict):
    """An amplitude at zero range, against full scale."""
    found = judge(frames(leak=leak))
    assert found["coupling"].value == pytest.approx(20 * math.log10(leak / 1000), abs=0.1 if leak > 1 else 0.5)
    assert found["coupling"].verdict is verdict
    assert bool(found["coupling"].advice) == (verdict is not Verdict.OK)


def test_coupling_of_the_simulator_in_counts():
    """With a converter the frames are counts and full scale is known: volts over volts."""
    scene = load_scene("single_target")
    given = replace(
        scene.effects,
        coupling=effects.CouplingConfig(level=-50.0, distance=0.0),
        noise=effects.NoiseConfig(noise_figure=15.0),
        converter=effects.ConverterConfig(bits=16, full_scale=0.05),
    )
    simulator = Simulator(replace(scene, effects=given))
    found = judge((simulator.process(k).frame for k in range(3)), simulator.info)
    expected = 20 * math.log10(transmitter.leaked(given.coupling, simulator.info) / 0.05)
    assert found["coupling"].value == pytest.approx(expected, abs=0.1)
    assert found["saturation"].value == 0.0


@pytest.mark.parametrize(("count", "verdict"), [(0, Verdict.OK), (3, Verdict.WARN), (1000, Verdict.FAIL)])
def test_saturation(count, verdict):
    """The exact share of samples of which a part is at full scale, either sign."""
    given = list(frames(2))
    flat = given[0].cube.reshape(-1)
    flat[:count] = np.resize([1000 + 1j, 5 - 1000j, -1000 + 1000j], count)
    found = judge(given)["saturation"]
    assert found.value == count / (2 * flat.size)
    assert found.verdict is verdict


def test_receivers_that_differ_and_one_that_is_dead():
    """The receiver is named as people count, from 1."""
    found = judge(frames(sigma=[1.0, 1.0, 4.0, 1.0]))["noise spread"]
    assert found.verdict is Verdict.WARN
    assert found.value == pytest.approx(12.0, abs=0.3)
    dead = judge(frames(sigma=[1.0, 0.0, 1.0, 1.0]))["noise spread"]
    assert (dead.verdict, "receiver 2 gives zeros" in dead.advice) == (Verdict.FAIL, True)


def test_nothing_but_zeros():
    """A radar that does not transmit; a signal without any noise is odd, but no failure."""
    assert judge(frames(sigma=0.0))["noise floor"].verdict is Verdict.FAIL
    assert judge(frames(sigma=0.0, leak=5.0))["noise floor"].verdict is Verdict.WARN


def test_lost_frames_and_chirps():
    """Gaps in the sequence; missing chirps of what came, whose samples count for nothing."""
    given = [f for f in frames(40) if f.sequence not in (7, 8, 30)]
    broken = given[5].cube.copy()
    broken[1, 3] = 1000.0  # chirp 3 of transmitter 2 is number 7
    given[5] = replace(given[5], cube=broken, missing=np.array([7], np.uint32))
    found = judge(given)
    assert found["lost frames"].value == 3 / 40
    assert found["lost frames"].verdict is Verdict.FAIL
    assert found["lost chirps"].value == 1 / (37 * 128)
    assert found["lost chirps"].verdict is Verdict.WARN
    assert found["saturation"].value == 0.0
    everywhere = [replace(f, missing=np.array([0], np.uint32)) for f in frames(4)]
    assert judge(everywhere)["noise floor"].verdict is Verdict.UNKNOWN


def clouds(times, sequence=None, n=3):
    """Clouds that arrive then [ms]."""
    health = Health(RadarInfo(waveform=Waveform(n_sample=0)))
    for k, ms in enumerate(times):
        arrays = [np.full(n, v, np.float32) for v in (1, 0, 0)]
        cloud = PointCloud(0, sequence[k] if sequence else k, "radar", *arrays, snr=np.full(n, 17.0, np.float32))
        health.process(cloud, round(ms * 1e6))
    return {check.name: check for check in health.checks({}, 1.0)}


def test_rate_and_jitter():
    """A fast clock, one long stall, and bursts: the rate is the device's, lateness is told apart from it."""
    steady = clouds(np.arange(100) * 20.0)
    assert steady["frame rate"].value == pytest.approx(50.0)
    assert steady["jitter"].value == pytest.approx(0.0, abs=1e-6)
    fast = clouds(np.arange(100) * 19.0)
    assert fast["frame rate"].value == pytest.approx(1000 / 19)
    assert fast["frame rate"].verdict is Verdict.WARN
    late = np.arange(200) * 20.0
    late[50:55] = late[55] - 0.1
    stalled = clouds(late)
    assert stalled["frame rate"].value == pytest.approx(50.0, rel=1e-6)
    assert 50 < stalled["jitter"].value < 100
    assert stalled["jitter"].verdict is Verdict.FAIL
    gaps = clouds([0, 20, 80, 100, 120], [5, 6, 9, 10, 11])
    assert gaps["frame rate"].value == pytest.approx(50.0)
    assert gaps["lost frames"].value == 2 / 7


def test_a_device_that_starts_again_lost_nothing():
    """Its count begins anew."""
    assert clouds(np.arange(20) * 20.0, [*range(100, 110), *range(10)])["lost frames"].value == 0.0


def test_clouds_have_checks_of_their_own():
    """Points per cloud and SNR instead of noise, coupling and saturation."""
    found = clouds(np.arange(10) * 20.0)
    assert (found["points per cloud"].value, found["snr"].value) == (3.0, pytest.approx(17.0))
    assert not {"noise floor", "coupling", "saturation", "lost chirps"} & set(found)
    empty = clouds(np.arange(10) * 20.0, n=0)
    assert (empty["points per cloud"].verdict, empty["snr"].verdict) == (Verdict.WARN, Verdict.UNKNOWN)
    assert "walk before the radar" in empty["points per cloud"].advice


@pytest.mark.parametrize(("degrees", "verdict"), [(40.0, Verdict.OK), (80, Verdict.WARN), (120.0, Verdict.FAIL)])
def test_temperature(degrees, verdict):
    """As any part of the board tells it."""
    found = judge(frames(1), report={"frontend.temperature": degrees, "port": "x", "b.temperature": float("nan")})
    assert found["frontend.temperature"].verdict is verdict
    assert "b.temperature" not in found


def test_a_frame_of_another_radar_is_refused():
    """With both shapes in the message; a NaN is named too."""
    with pytest.raises(DataError, match="has shape"):
        judge(frames(1), RadarInfo(waveform=Waveform(n_chirp=32)))
    bad = next(frames(1))
    bad.cube[0, 0, 0, 0] = np.nan
    with pytest.raises(DataError, match=r"RadarFrame\.cube has 1 non-finite"):
        judge([bad])


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 3), st.integers(1, 5), st.integers(1, 3), st.integers(1, 5), st.sampled_from([1e-18, 1.0, 1e15]), st.integers(0, 99))
def test_any_shape_and_scale_gives_numbers(n_tx, n_chirp, n_rx, n_sample, scale, seed):
    """One chirp, one sample, tiny and huge units: every value is finite or left out, and JSON takes it."""
    waveform = Waveform(n_tx=n_tx, n_chirp=n_chirp, n_sample=n_sample)
    info = RadarInfo(waveform=waveform, array=AntennaArray(tx=((0.0, 0.0),) * n_tx, rx=((0.0, 0.0),) * n_rx))
    found = judge(frames(2, sigma=scale, info=info, seed=seed), info)
    values = [check.value for check in found.values() if check.value is not None]
    assert np.isfinite(values).all()
    json.dumps(values)


class Canned:
    """A source that gives what it was made with, then fails as told; everything but the board is real."""

    def __init__(self, given=(), end=None, refuse=None):
        self.info, self.given, self.end, self.refuse, self.said = INFO, list(given), end, refuse, []

    def power_up(self):
        self.said.append("up")
        if self.refuse:
            raise self.refuse

    def resume(self):
        self.said.append("resume")

    def suspend(self):
        self.said.append("suspend")

    def power_down(self):
        self.said.append("down")

    def read(self, timeout):
        time.sleep(0.001)
        if self.given:
            return Reading(self.given.pop(0))
        if self.end:
            raise self.end
        return None

    def report(self):
        return {"temperature": 30.0}


def test_probe_of_a_board_that_is_well():
    """Up, listen, down; the report is asked for while it runs; progress ends at 1."""
    shares = []
    source = Canned(frames(8))
    found = probe(source, 0.3, progress=shares.append)
    assert source.said == ["up", "resume", "suspend", "down"]
    assert found.checks[0].text.startswith("8 frames")
    assert found.report == {"temperature": 30.0}
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


@pytest.mark.parametrize(
    ("source", "verdict", "advice"),
    [
        (Canned(refuse=DeviceError("plug it in", gone=True)), Verdict.FAIL, "plug it in"),
        (Canned(frames(5), DeviceError("it has gone", gone=True)), Verdict.FAIL, "it has gone"),
        (Canned(frames(5), DeviceError("one packet was bad")), Verdict.WARN, "one packet was bad"),
        (Canned(), Verdict.FAIL, "check the cable"),
    ],
    ids=["refuses", "unplugged", "hiccup", "silent"],
)
def test_probe_of_a_board_with_a_problem(source, verdict, advice):
    """The link's check says what the device said; whatever happens, it is powered down."""
    found = probe(source, 0.2)
    assert found.checks[0].verdict is verdict
    assert advice in found.checks[0].advice
    assert source.said[-1] == "down"
    assert worst(found.checks) is found.verdict


def test_a_simulated_radar_sends_by_itself(tmp_path):
    """In its own time, counting what was left out; the scene begins again where it ends; its health is its scene's."""
    path = tmp_path / "brief.yaml"
    path.write_text("duration: 0.2\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], rcs: 0.1}]\neffects: {noise: {noise_figure: 12}}\n")
    source = board("sim").source(board("sim").config(scene=str(path)))
    found = {check.name: check for check in probe(source, 0.6).checks}
    expected = 10 * math.log10(noise.power(effects.NoiseConfig(), source.info) * IMPEDANCE)
    assert found["noise floor"].value == pytest.approx(expected, abs=0.2)  # one target, as many cells as above at least
    source.power_up()
    source.resume()
    got = [r.data for r in (source.read(0.05) for _ in range(30)) if r]
    source.power_down()
    assert got[-1].sequence >= 10  # the scene has ten frames
    stamps, numbers = np.array([f.stamp_ns for f in got]), np.array([f.sequence for f in got])
    np.testing.assert_array_equal(np.diff(stamps), np.diff(numbers) * STEP)
