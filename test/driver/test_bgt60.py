"""A BGT60TR13C: the message where the maker's library is missing, and the adapter's arithmetic and manners with a stand-in for it.

The library is not on the package index, so nothing here was tried with it; its calls are those of its published wrapper.
"""

import sys
import time
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from radar_core import ConfigError, DeviceError, Pose, RadarInfo
from radar_driver.bgt60.config import Bgt60Config
from radar_driver.bgt60.source import Bgt60, to_cube
from radar_driver.boards import board, boards
from radar_driver.health import Verdict, probe
from radar_driver.live import Reader
from radar_dsp import Baseband, BasebandConfig
from radar_lab.pipeline import Pipeline
from radar_sim import Action, Effects, NoiseConfig, Person, Scene, SceneRadar, Simulator
from radar_sim.people import Walk
from radar_tracking import TrackStatus

SMALL = {"chirps": 16, "samples": 64, "frame_interval": 0.02}


class ErrorTimeout(Exception):  # noqa: N818  (the library's names)
    pass


class ErrorFrameAcquisitionFailed(Exception):  # noqa: N818
    pass


class Device:
    """Behaves as the library's; ``plan``: what the next calls give, arrays or errors."""

    plan: list
    said: list
    opened: int

    @staticmethod
    def get_list():
        return ["0123-4567"]

    def __init__(self, uuid=""):
        self.uuid = uuid
        type(self).opened += 1

    def create_simple_sequence(self, shape):
        return shape

    def set_acquisition_sequence(self, shape):
        self.said.append(shape)

    def get_chirp_sampling_bandwidth(self, chirp):
        return 0.9 * (chirp.end_frequency_Hz - chirp.start_frequency_Hz)

    def get_chirp_sampling_center_frequency(self, chirp):
        return 60.6e9

    def get_board_uuid(self):
        return "0123-4567"

    def get_sensor_type(self):
        return "BGT60TR13C"

    def start_acquisition(self):
        self.said.append("start")

    def stop_acquisition(self):
        self.said.append("stop")

    def get_next_frame(self, timeout_ms):
        if not self.plan:
            time.sleep(timeout_ms * 1e-3)
            raise ErrorTimeout
        found = self.plan.pop(0)
        if isinstance(found, Exception):
            raise found
        return [found]

    def _close(self):
        type(self).opened -= 1


@pytest.fixture
def library(monkeypatch):
    """The stand-in where the library would be."""
    device = type("DeviceFmcw", (Device,), {"plan": [], "said": [], "opened": 0})
    types = ModuleType("ifxradarsdk.fmcw.types")
    types.FmcwSequenceChirp = types.FmcwSimpleSequenceConfig = SimpleNamespace
    fmcw = ModuleType("ifxradarsdk.fmcw")
    fmcw.DeviceFmcw = device
    for name, module in (("ifxradarsdk", ModuleType("ifxradarsdk")), ("ifxradarsdk.fmcw", fmcw), ("ifxradarsdk.fmcw.types", types)):
        monkeypatch.setitem(sys.modules, name, module)
    return device


def test_without_the_library_one_line_says_where_to_get_it(monkeypatch):
    """The registry knows the board all the same, and finds none."""
    monkeypatch.setitem(sys.modules, "ifxradarsdk", None)
    assert boards()["bgt60"].variant == "live"
    assert board("bgt60").find() == ()
    with pytest.raises(DeviceError, match=r"needs Infineon's library ifxradarsdk, .* install the wheel in it") as error:
        Bgt60(Bgt60Config()).power_up()
    assert "\n" not in str(error.value)


def test_an_echo_has_its_range_speed_and_direction(library):
    """Real samples around a half, as the board gives them, of an echo whose phases are written down from the formulas."""
    config = Bgt60Config(samples=128, chirps=32)
    source = Bgt60(config)
    source.power_up()
    w, array = source.info.waveform, source.info.array
    assert (w.bandwidth, w.carrier, w.n_sample) == (pytest.approx(0.9 * 2e9), 60.6e9, 64)
    distance, speed, azimuth, elevation = 1.7, 0.8, 0.3, -0.15
    time_ = np.arange(32)[:, None] * w.slow_interval + np.arange(128) / config.sample_rate
    delay = 2 * (distance + speed * (time_ - w.acquisition_time / 2)) / 299_792_458.0
    beat = 2 * np.pi * ((w.carrier - w.bandwidth / 2) * delay + w.slope * delay * (np.arange(128) / config.sample_rate))
    path = np.array([[np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]]) @ np.array(array.rx).T
    beat = beat[None] - 2 * np.pi / w.wavelength * path[0][:, None, None]
    noise = np.random.default_rng(2).normal(size=beat.shape) * 1e-3
    library.plan.append(0.5 + 0.05 * np.cos(beat) + noise)
    source.resume()
    cloud = Baseband(BasebandConfig(), source.info).process(source.read(0.1).data)
    best = int(cloud.snr.argmax())
    for name, true in (("range", distance), ("radial_speed", speed), ("azimuth", azimuth), ("elevation", elevation)):
        assert getattr(cloud, name)[best] == pytest.approx(true, abs=0.02), name
    source.power_down()
    assert library.said[1:] == ["start", "stop"]
    assert library.said[0].chirp.rx_mask == 7
    assert library.opened == 0


def test_real_samples_keep_order_and_size():
    """Receivers and chirps change places; a tone keeps its amplitude; the converter's middle is gone."""
    tone = np.cos(2 * np.pi * 8 * np.arange(64) / 64)
    frame = 0.5 + np.arange(1, 4)[:, None, None] * np.ones((3, 5, 1)) * tone
    cube = to_cube(frame)
    assert cube.shape == (1, 5, 3, 32)
    np.testing.assert_allclose(np.abs(cube[0, :, :, 8:24]).mean(axis=(0, 2)), [1, 2, 3], rtol=1e-3)


def test_frames_that_are_lost_broken_or_do_not_come(library):
    """Each is told; reading goes on; silence and what is unknown open the board anew."""
    source = Bgt60(Bgt60Config(**SMALL, timeout=0.1))
    source.power_up()
    source.resume()
    good = np.random.default_rng(1).random((3, 16, 64))
    library.plan += [good, ErrorFrameAcquisitionFailed(), good, good[:2], good]
    assert source.read(0.05).data.sequence == 0
    with pytest.raises(DeviceError, match="were lost") as lost:
        source.read(0.05)
    assert not lost.value.gone
    assert library.said[-2:] == ["stop", "start"]
    assert source.read(0.05).data.sequence == 2
    with pytest.raises(DeviceError, match=r"shape \(2, 16, 64\), expected \(3, 16, 64\)"):
        source.read(0.05)
    assert source.read(0.05).data.sequence == 4
    assert source.read(0.05) is None
    time.sleep(0.1)
    with pytest.raises(DeviceError, match="gave no frame for 0") as silent:
        source.read(0.05)
    assert silent.value.gone
    library.plan.append(OSError("no such device"))
    with pytest.raises(DeviceError, match=r"has gone .*no such device") as gone:
        source.read(0.05)
    assert gone.value.gone
    assert {"lost": 1, "broken": 1}.items() <= source.report().items()
    source.power_down()
    assert library.opened == 0


def test_boards_are_listed_and_refused(library, monkeypatch):
    """By their numbers; what the library refuses is told in one line, and nothing stays open."""
    (found,) = board("bgt60").find()
    assert found.options == {"uuid": "0123-4567"}

    def refuse(self, shape):
        raise ValueError("ErrorRfOutOfRange")

    monkeypatch.setattr(library, "set_acquisition_sequence", refuse)
    with pytest.raises(DeviceError, match=r"cannot be set up .ValueError: ErrorRfOutOfRange"):
        Bgt60(Bgt60Config()).power_up()
    assert library.opened == 0


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"end_frequency": 59e9}, "must be above start_frequency"),
        ({"samples": 1024}, "the samples take longer than chirp_interval"),
        ({"chirps": 512}, "the chirps take longer than frame_interval"),
    ],
)
def test_settings_that_contradict_each_other(knobs, message):
    """With what to change."""
    with pytest.raises(ConfigError, match=message):
        Bgt60Config(**knobs)


def test_health(library):
    """`probe` finds the stand-in well, with its number; without frames it says so."""
    noise = np.random.default_rng(1).normal(0.5, 0.01, (200, 3, 16, 64))
    library.plan += list(noise)
    found = probe(Bgt60(Bgt60Config(**SMALL)), 0.3)
    assert found.checks[0].verdict is Verdict.OK
    assert found.report["board.uuid"] == "0123-4567"
    library.plan.clear()
    silent = probe(Bgt60(Bgt60Config(**SMALL, timeout=0.1)), 0.5)
    assert "gave no frame" in silent.checks[0].advice
    assert library.opened == 0


def walk(config):
    """Real samples (frame, rx, chirp, sample) of somebody who walks away, and where they are [m]."""
    info = config.info(0.9 * (config.end_frequency - config.start_frequency), 60.6e9)
    fine = RadarInfo(waveform=replace(info.waveform, n_sample=config.samples), array=info.array, mount=Pose(z=1.2))
    person = Person(id=1, position=(1.3, 0.2), script=(Action(walk=Walk(to=(4.3, -0.2))),))
    scene = Scene(duration=3.0, seed=5, radars=(SceneRadar.of(fine),), people=(person,), effects=Effects(noise=NoiseConfig()))
    simulator = Simulator(scene)
    made = [simulator.process(k) for k in range(simulator.n_frames)]
    real = np.stack([one.frame.cube.real[0].transpose(1, 0, 2) for one in made])
    return 0.5 + 0.3 * real / np.abs(real).max(), [one.truth.position[0] for one in made]


@pytest.mark.long
def test_a_walker_is_tracked_over_garbage_and_unplugging(library, monkeypatch):
    """Samples to one person in the room: half a frame and one of no numbers are left out, and frames go on once the board is back."""
    config = Bgt60Config(chirps=32, mount=Pose(z=1.2))
    frames, truth = walk(config)
    state = {"next": 0, "there": True, "due": 0.0}

    def give(self, timeout_ms):
        if not state["there"]:
            raise OSError("no such device")
        time.sleep(max(min(state["due"] - time.monotonic(), timeout_ms * 1e-3), 0.0))
        if time.monotonic() < state["due"] or state["next"] >= len(frames):
            raise ErrorTimeout
        k, state["due"] = state["next"], time.monotonic() + config.frame_interval
        state["next"] += 1
        return [frames[k][:, :9] if k == 8 else np.full_like(frames[k], np.nan) if k == 12 else frames[k]]

    def plugged(self, shape):
        if not state["there"]:
            raise ErrorFrameAcquisitionFailed
        self.said.append(shape)

    monkeypatch.setattr(library, "get_next_frame", give)
    monkeypatch.setattr(library, "set_acquisition_sequence", plugged)
    source, problems = Bgt60(config), set()
    source.power_up()
    pipeline = Pipeline(source.info)
    reader = Reader(source, lambda: problems.add(reader.problem), again=0.1)
    reader.start()
    try:
        found, end, unplugged = None, time.monotonic() + 60.0, 0.0
        while state["next"] < len(frames) and time.monotonic() < end:
            reading = reader.take()
            if reading is None:
                time.sleep(0.005)
            else:
                found = pipeline.process(reading.data)
            if state["next"] == 20 and not unplugged:
                unplugged, state["there"] = time.monotonic(), False
            if unplugged and time.monotonic() > unplugged + 0.3:
                state["there"] = True
    finally:
        reader.stop()
        source.power_down()
    said = " ".join(problems)
    for words in ("shape (3, 9, 128), expected (3, 32, 128), or is no number", "has gone (OSError", "cannot be set up"):
        assert words in said
    assert reader.counts["reopened"] >= 1
    assert source.report()["broken"] == 2
    (person,) = [track for track in found.tracks.tracks if track.status != TrackStatus.TENTATIVE]
    assert np.hypot(*(person.position[:2] - truth[-1][:2])) < 0.5
    assert library.opened == 0
