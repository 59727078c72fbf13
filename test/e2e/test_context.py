"""Calibrations by the same names in the graph and offline: the same bits, and others than without."""

import dataclasses

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from test_lockstep import canonical
from typer.testing import CliRunner

from radar_app.cli import app
from radar_core import ConfigError, Pose
from radar_core.config import load
from radar_core.mounting import MountCalibration
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.array_file import CalibratedArray, save_array
from radar_dsp.context import RadarContext
from radar_lab.pipeline import Pipeline, PipelineConfig
from radar_ros import bags
from radar_ros.messages.convert import frame_to_msg, info_from_msg, info_to_msg
from radar_ros.offline import open_recording, parse, simulators

FRAMES = 60
MOUNT = Pose(x=0.3, y=-0.4, z=1.4, yaw=0.2, tilt=-0.1)


def run(*words):
    """The command, which must succeed."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, f"{done.output} {done.exception!r}"


def with_errors(array):
    """The same array with channels that differ from the drawing, gain and phase."""
    rng = np.random.default_rng(3)
    n = array.n_tx * array.n_rx
    gain, phase = rng.normal(0.0, 1.5, n), rng.normal(0.0, 0.6, n)
    return dataclasses.replace(
        array, channel_gain=tuple(gain.tolist()), channel_phase=tuple(phase.tolist()), channel_shift=((0.0, 0.0),) * n
    )


def calibrated(info):
    """What handwave calibrate would find of that array."""
    n, none = info.array.n_tx * info.array.n_rx, np.zeros(info.array.n_tx * info.array.n_rx)
    kept = dict.fromkeys(("phase_residual", "gain_residual", "gain_std", "phase_std"), none)
    return CalibratedArray(
        array=with_errors(info.array),
        carrier=info.waveform.carrier,
        observed=(True, True),
        dead=np.zeros(n, np.bool_),
        shift_std=np.zeros((n, 2)),
        offset=np.zeros((2, 2)),
        offset_std=np.zeros((2, 2)),
        condition=1.0,
        structure=0.0,
        range=3.0,
        n_snapshot=182,
        **kept,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Raw frames of a radar whose channels have errors, in ``raw``, and the files of its calibrations."""
    path = tmp_path_factory.mktemp("context")
    (simulator,) = simulators("short")
    factor = with_errors(simulator.info.array).response.reshape(2, 1, 4, 1)
    with bags.BagWriter(path / "raw") as writer:
        writer.write("/radar/info", bags.TYPES["radar/info"], 0, serialize_message(info_to_msg(simulator.info, 0)))
        for k in range(100, 100 + FRAMES):
            frame = simulator.process(k).frame
            frame = dataclasses.replace(frame, cube=(frame.cube * factor).astype(np.complex64))
            writer.write("/radar/frame", bags.TYPES["radar/frame"], frame.stamp_ns, serialize_message(frame_to_msg(frame)))
    save_array(calibrated(simulator.info), path / "array.npz")
    MountCalibration(radar=simulator.info.frame_id, mount=MOUNT).save(path / "mount.yaml")
    run("process", path / "raw", "--out", path / "plain")
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "file", "changed"), [("baseband", "array.npz", ("radar/points", "tracks")), ("driver", "mount.yaml", ("radar/info", "tracks"))]
)
def test_a_calibration_gives_the_same_bits_in_the_graph_and_offline(folder, name, file, changed):
    """One name for the file, whose effect is there in both."""
    knob = f"{name}.calibration={folder / file}"
    run("process", folder / "raw", "--out", folder / f"{name}_offline", "-p", knob)
    run("replay", folder / "raw", "--lockstep", "--out", folder / f"{name}_online", "-p", knob)
    for topic in ("radar/info", "radar/points", "tracks"):
        offline = canonical(folder / f"{name}_offline", topic)
        assert offline == canonical(folder / f"{name}_online", topic), topic
        assert (offline != canonical(folder / "plain", topic)) == (topic in changed), topic
        assert len(offline) == (1 if topic == "radar/info" else FRAMES)


def azimuths(clouds):
    """Azimuth of the strongest point of each cloud [rad]."""
    return np.array([cloud.azimuth[np.argmax(cloud.snr)] for cloud in clouds])


def test_the_array_calibration_puts_points_where_an_array_without_errors_sees_them(folder):
    """Directions of the calibrated radar are those of an ideal one; without the file they are not."""
    (simulator,) = simulators("short")
    ideal = Baseband(BasebandConfig(), simulator.info)
    truth = azimuths(ideal.process(simulator.process(k).frame) for k in range(100, 100 + FRAMES))
    context = RadarContext(simulator.info, calibrated(simulator.info))
    frames = [frame for _, frame in open_recording(folder / "raw").messages()]
    found, plain = (azimuths(map(Baseband(BasebandConfig(), info).process, frames)) for info in (context.radar, context.info))
    error, without = (np.median(np.abs(each - truth)) for each in (found, plain))
    assert error < 0.25 * without
    assert without > 0.01


def test_the_mount_is_in_what_process_writes(folder):
    """Results can be replayed: their radar stands where it was when they were made."""
    run("process", folder / "raw", "--out", folder / "moved", "-p", f"driver.calibration={folder / 'mount.yaml'}")
    item = next(iter(bags.read(folder / "moved", ("radar/info",))))
    assert info_from_msg(parse(item.data, "radar/info")).mount == MOUNT


def test_a_context_in_memory_is_the_same_as_files(folder):
    """Calibrations as objects and as files give the same radar; both at once are refused, and so is a stage's knobs without its file."""
    info = simulators("short")[0].info
    given = {"driver": {"calibration": str(folder / "mount.yaml")}, "baseband": {"calibration": str(folder / "array.npz")}}
    config = load(PipelineConfig, given)
    context = RadarContext(info, calibrated(info), MountCalibration(radar=info.frame_id, mount=MOUNT))
    assert Pipeline(info, config).context.radar == Pipeline(context).context.radar
    assert context.radar.mount == MOUNT
    assert context.radar.array == with_errors(info.array)
    assert RadarContext(info, mount=MountCalibration(radar="right/radar", mount=MOUNT)).radar == info
    with pytest.raises(ConfigError, match="as a context and as files"):
        Pipeline(context, config)
    with pytest.raises(ConfigError, match="give a CalibratedBasebandConfig"):
        PipelineConfig(baseband=BasebandConfig())
