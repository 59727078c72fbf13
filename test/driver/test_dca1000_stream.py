"""Frames over real UDP: all of them, or marked where packets were lost; and a simulated scene through the whole wire."""

import dataclasses

import numpy as np
import pytest
from dca1000_emulator import Faults, cfg, encode

from radar_core import RadarFrame
from radar_driver.dca1000.ti_config import radar_info, read_ti_config
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Effects, NoiseConfig, Person, Point, Scene, SceneRadar, Simulator

SHAPE = (2, 16, 4, 64)
PATIENCE = 20.0  # s
MEASURED = ("range", "radial_speed", "azimuth")  # TX1 and TX3 lie in one line: nobody knows elevations


def cubes(n, shape=SHAPE):
    """Samples of all 16 bits."""
    rng = np.random.default_rng(7)
    words = rng.integers(-32768, 32768, (2, n, *shape))
    return (words[0] + 1j * words[1]).astype(np.complex64)


def collect(source, n):
    """Read n frames; those that come in the meantime are not thrown away by anybody."""
    source.power_up()
    source.resume()
    try:
        frames = []
        while len(frames) < n:
            reading = source.read(PATIENCE)
            assert reading is not None, source.report()
            frames.append(reading.data)
        return frames
    finally:
        source.power_down()


@pytest.mark.long
def test_250_frames_without_a_loss(bench):
    """Five seconds at 50 Hz: every frame once, in order, sample by sample; stamps follow the sensor's clock to a thousandth of a frame."""
    sent = cubes(3)
    source = bench([encode(c) for c in sent]).source()
    frames = collect(source, 250)
    assert [f.sequence for f in frames] == list(range(250))
    assert all(np.array_equal(f.cube, sent[f.sequence % 3]) for f in frames)
    assert not any(len(f.missing) for f in frames)
    counts = source.report()
    assert counts["capture board.packets_lost"] == counts["capture board.packets_garbled"] == counts["capture board.frames_skipped"] == 0
    # A stamp is never earlier than the one before says, but for a better guess, and at most 1e-4 of an interval later.
    steps = np.diff([f.stamp_ns for f in frames])
    assert steps.max() < 20e6 * (1 + 2e-4) or (steps > 25e6).any()  # the second: this machine slept for half a frame
    assert steps.min() > 0


@pytest.mark.long
@pytest.mark.parametrize("flush", [True, False], ids=["short ends", "full packets"])
def test_every_loss_is_marked(bench, flush):
    """One per cent lost, and some sent twice, swapped and garbled: what is not marked is right, and what is marked was touched."""
    sent = cubes(3)
    faults = Faults(seed=11, lose=0.01, duplicate=0.005, reorder=0.01, corrupt=0.002)
    one = bench([encode(c) for c in sent], faults=faults, flush=flush)
    frames = collect(one.source(), 100)
    size, chirps = len(one.card.frames[0]), SHAPE[0] * SHAPE[1]
    touched = {}
    for place, n in faults.lost:
        for chirp in range(place * chirps // size, (place + n - 1) * chirps // size + 1):
            touched.setdefault(chirp // chirps, set()).add(chirp % chirps)
    last = frames[-1].sequence
    assert len({f.sequence for f in frames}) == 100
    assert sum(len(chirp) for number, chirp in touched.items() if number < last) > 20
    for frame in frames[:-1]:
        marked = set(frame.missing.tolist())
        assert touched.get(frame.sequence, set()) <= marked
        in_time = frame.cube.swapaxes(0, 1).reshape(chirps, -1)
        right = sent[frame.sequence % 3].swapaxes(0, 1).reshape(chirps, -1)
        good = sorted(set(range(chirps)) - marked)
        np.testing.assert_array_equal(in_time[good], right[good])
        assert np.logical_or(in_time == right, in_time == 0).all()
    # Only a packet that was swapped across a short end next to a loss may be given up too: nearly all that is marked was touched.
    marked = sum(len(f.missing) for f in frames[:-1])
    wanted = sum(len(touched.get(f.sequence, ())) for f in frames[:-1])
    assert wanted <= marked <= 1.1 * wanted


@pytest.mark.parametrize(("lanes", "order"), [(2, "q_first"), (2, "i_first"), (4, "q_first")])
def test_a_scene_through_the_wire_gives_the_same_cloud(bench, lanes, order):
    """A person and a scatterer, simulated for the .cfg's waveform, rounded to counts, sent, decoded: the simulator's own cloud.

    The noise has a deviation of 20 counts, so rounding (1/12 count squared) adds 0.02 % to its power, which moves an estimate by
    sqrt(0.0002) = 1.4 % of its own deviation; ten times that is allowed, and no more than one point at the threshold may differ.
    """
    text = cfg(64, 64, platform="xWR14xx" if lanes == 4 else "xWR18xx", swap=int(order == "q_first"))
    one = bench([], text)
    info = radar_info(read_ti_config(one.cfg))
    scene = Scene(
        duration=0.1,
        radars=(SceneRadar.of(info),),
        people=(Person(position=(2.2, 0.4)),),
        points=(Point(position=(3.0, -0.8, 1.4), velocity=(0.7, 0.0, 0.0), rcs=0.1),),
        effects=Effects(noise=NoiseConfig()),
    )
    simulator = Simulator(scene)
    frames = [simulator.process(k).frame for k in range(3)]
    empty = Simulator(dataclasses.replace(scene, people=(), points=())).process(0).frame.cube
    scale = 20 / empty.real.std()
    counts = [np.round(f.cube * scale) for f in frames]
    assert max(np.abs(c.real).max() for c in counts) < 32767
    one.card.frames = [encode(c, order, lanes) for c in counts]
    received = collect(one.source(lanes=lanes, order=order), 3)
    baseband = Baseband(BasebandConfig(), info)
    for got, direct in zip(received, frames, strict=True):
        np.testing.assert_array_equal(got.cube, counts[got.sequence])
        cloud = baseband.process(got)
        wanted = baseband.process(RadarFrame((direct.cube * scale).astype(np.complex64), 0, 0, "radar"))
        assert len(wanted) > 3
        assert abs(len(cloud) - len(wanted)) <= 1
        sure = wanted.select(wanted.snr > wanted.snr.min() + 0.1)
        # In deviations, axes (quantity, point, point that is wanted).
        errors = np.array([(getattr(cloud, q)[:, None] - getattr(sure, q)) / getattr(sure, f"{q}_std") for q in MEASURED])
        nearest = np.abs(errors).max(axis=0).min(axis=0)
        assert nearest.max() < 0.14


def test_swapped_components_are_advised_on(bench):
    """The wrong order mirrors the range, and the report says which one to set."""
    rng = np.random.default_rng(1)
    echo = 1000 * np.exp(2j * np.pi * 10 / 64 * np.arange(64)) * np.ones((*SHAPE[:3], 1))
    cube = np.round(echo + rng.normal(0, 30, echo.shape) + 1j * rng.normal(0, 30, echo.shape))
    one = bench([encode(cube, "i_first")])
    one.cfg.write_text(one.cfg.read_text().replace("adcbufCfg -1 0 1 1 1\n", ""))
    source = one.source()
    collect(source, 1)
    assert "set order to i_first" in source.report()["advice"]
    source = one.source(order="i_first")
    collect(source, 1)
    assert "advice" not in source.report()
