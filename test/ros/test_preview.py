"""Previews: real files, decoded again."""

import builtins
import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.preview import draw
from radar_app.preview_panels import COLOURS, Deed, Observer, Strip, deeds, find_scale, room_extent
from radar_app.preview_picture import MOST_SNAPSHOTS, SNAPSHOTS, snapshot_times
from radar_app.preview_video import step_of
from radar_core import AntennaArray, ConfigError, Waveform
from radar_sim import (
    Action,
    CouplingConfig,
    Effects,
    Furniture,
    LossesConfig,
    NoiseConfig,
    Person,
    Point,
    Scene,
    SceneRadar,
    Simulator,
    Wall,
    load_scene,
)

EFFECTS = Effects(noise=NoiseConfig(noise_figure=15.0), losses=LossesConfig(level=25.0), coupling=CouplingConfig(level=-60.0))
PEOPLE = (
    Person(id=1, position=(2.2, 0.7), script=(Action(gesture="push"),)),
    Person(id=7, position=(2.4, -0.7), script=(Action(stand=0.2), Action(fidget=2.0))),
)


def simulator(duration=0.5, **more):
    """A room with two people, a wall and a table."""
    things = {"people": PEOPLE, "walls": (Wall(start=(4, -2), end=(4, 2)),), "furniture": (Furniture(position=(3, 0)),), "effects": EFFECTS}
    return Simulator(Scene(**{"duration": duration, **things, **more}))


def decode(path: Path):
    """Pictures of a film, times [s] of each, and its length [s]."""
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
        length = container.duration / 1e6
        assert container.streams.video[0].codec_context.pix_fmt == "yuv420p"
    return [f.to_ndarray(format="rgb24") for f in frames], [f.time for f in frames], length


def shown(picture, colour) -> int:
    """Pixels of about a colour."""
    away = np.abs(np.asarray(picture, float)[..., :3] / (1.0 if np.max(picture) <= 1.0 else 255.0) - to_rgb(colour)).max(axis=-1)
    return int(np.count_nonzero(away < 0.12))


@pytest.mark.long
def test_a_picture_shows_people_and_spectra(tmp_path):
    """It decodes; both people are there in their colours, and the maps hold dark noise and bright echoes."""
    draw(simulator(), tmp_path / "scene.png")
    picture = imread(tmp_path / "scene.png")
    assert picture.shape[0] > 600
    assert picture.shape[1] == 1300
    assert shown(picture, COLOURS[0]) > 200
    assert shown(picture, COLOURS[1]) > 200
    assert shown(picture, COLOURS[2]) < 20
    assert shown(picture, "black") > 0.1 * picture.shape[0] * picture.shape[1]
    assert [p.name for p in tmp_path.iterdir()] == ["scene.png"]


def test_the_same_scene_gives_the_same_picture(tmp_path):
    """There is no clock and no chance in it."""
    for name in ("a.png", "b.png"):
        draw(simulator(0.04), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.long
def test_a_film_runs_at_true_speed_and_moves(tmp_path):
    """25 pictures a second of 50 frames a second, as long as the scene, no two alike."""
    draw(simulator(1.0), tmp_path / "scene.mp4")
    pictures, times, length = decode(tmp_path / "scene.mp4")
    assert len(pictures) == 25
    assert times == pytest.approx(np.arange(25) / 25)
    assert length == pytest.approx(1.0, abs=0.05)
    assert all(p.shape == (720, 1280, 3) for p in pictures)
    assert shown(pictures[0], COLOURS[0]) > 200
    assert all(np.abs(a.astype(int) - b).max() > 40 for a, b in itertools.pairwise(pictures))
    # The micro-Doppler fills from the left, below and to the right of the range-Doppler map.
    right = [p[450:640, 950:1190].mean() for p in pictures]
    assert right[-1] > right[5] + 3


def test_the_caller_chooses_the_pictures_of_a_film(tmp_path):
    """One every 0.1 s: ten a second."""
    draw(simulator(), tmp_path / "scene.mp4", every=0.1)
    pictures, times, _ = decode(tmp_path / "scene.mp4")
    assert len(pictures) == 5
    assert times == pytest.approx(np.arange(5) / 10)


@pytest.mark.parametrize(
    ("interval", "every", "step"),
    [
        (0.02, None, 2),
        (0.04, None, 1),
        (0.04 * 1.00005, None, 1),
        (0.2, None, 1),
        (0.03, None, 2),
        (1e-3, None, 40),
        (0.02, 0.02, 1),
        (0.02, 1e-9, 1),
    ],
)
def test_films_have_at_most_25_pictures_a_second(interval, every, step):
    """Unless the caller wants more; never more than there are frames."""
    assert step_of(interval, every) == step


def test_where_there_is_no_h264_a_film_is_mpeg4(tmp_path, monkeypatch):
    """Some builds of FFmpeg leave H.264 out."""
    av = pytest.importorskip("av")
    monkeypatch.setattr(av.codec, "codecs_available", {"mpeg4"})
    draw(simulator(0.2), tmp_path / "scene.mp4")
    with av.open(str(tmp_path / "scene.mp4")) as container:
        assert container.streams.video[0].codec.name == "mpeg4"
    pictures, times, _ = decode(tmp_path / "scene.mp4")
    assert times == pytest.approx(np.arange(5) / 25)
    assert shown(pictures[-1], COLOURS[0]) > 100


def test_a_film_of_one_picture(tmp_path):
    """However long the caller wants to see it."""
    draw(simulator(0.1), tmp_path / "scene.mp4", every=1e6)
    assert len(decode(tmp_path / "scene.mp4")[0]) == 1


@pytest.mark.long
@pytest.mark.parametrize("ending", ["mp4", "png"])
def test_an_interruption_leaves_what_was_there(tmp_path, ending):
    """A file that was there stays whole, and nothing half done is left."""
    out = tmp_path / f"scene.{ending}"
    out.write_bytes(b"before")
    radar = simulator()
    process = radar.process

    def stopped(sequence):
        if sequence == 20 and len(seen) > 15:
            raise KeyboardInterrupt
        seen.append(sequence)
        return process(sequence)

    seen = []
    radar.process = stopped
    with pytest.raises(KeyboardInterrupt):
        draw(radar, out)
    assert out.read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == [out.name]


@pytest.mark.parametrize("ending", ["mp4", "png"])
def test_an_existing_file_is_replaced(tmp_path, ending):
    """By a whole one."""
    out = tmp_path / f"scene.{ending}"
    out.write_bytes(b"before")
    draw(simulator(0.04), out)
    assert out.stat().st_size > 5000


@pytest.mark.parametrize("ending", ["mp4", "png"])
@pytest.mark.parametrize(
    ("name", "message"), [("nowhere/scene", "cannot be written.*No such file"), ("folder", "cannot be written.*folder")]
)
def test_what_cannot_be_written_is_said_before_anything_is_simulated(tmp_path, name, message, ending):
    """With the path and what to do."""
    (tmp_path / f"folder.{ending}").mkdir()
    radar = simulator()
    radar.process = None  # whoever simulates fails
    out = tmp_path / f"{name}.{ending}"
    with pytest.raises(ConfigError, match=message) as caught:
        draw(radar, out)
    assert str(out) in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == [f"folder.{ending}"]


@pytest.mark.parametrize(("every", "what"), [(0.0, "every is 0"), (-1.0, "every is -1"), (math.nan, "every is nan")])
def test_a_time_between_pictures_that_is_none_is_refused(tmp_path, every, what):
    """Zero, negative, not a number."""
    with pytest.raises(ConfigError, match=what):
        draw(simulator(), tmp_path / "scene.png", every)


def test_other_endings_and_empty_scenes_are_refused(tmp_path):
    """Naming what there is."""
    with pytest.raises(ConfigError, match=r"\.mp4 or \.png"):
        draw(simulator(), tmp_path / "scene.gif")
    with pytest.raises(ConfigError, match="lengthen its duration"):
        draw(simulator(0.0), tmp_path / "scene.png")


def test_without_pyav_the_error_says_what_to_install(tmp_path, monkeypatch):
    """And that a picture needs nothing."""
    real = builtins.__import__

    def without(name, *args, **more):
        if name == "av":
            raise ImportError(name)
        return real(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ConfigError, match=r"pip install 'handwave\[video\]'.*\.png"):
        draw(simulator(), tmp_path / "scene.mp4")
    draw(simulator(0.02), tmp_path / "scene.png")


def test_a_target_is_where_it_is_in_the_map():
    """Peak within half a cell of range and range rate; leakage at range zero is stronger and is not among the echoes."""
    radar = simulator(people=(), walls=(), furniture=(), points=(Point(position=(3.0, 0.0, 1.2), velocity=(-1.2, 0.0, 0.0), rcs=0.3),))
    observer, w = Observer(radar.info), radar.info.waveform
    level = observer.process(radar.process(5).frame)
    echoes = observer.echoes(level)
    row, column = np.unravel_index(echoes.argmax(), echoes.shape)
    distance = 3.0 - 1.2 * (5 * radar.interval + w.acquisition_time / 2)
    # A moving target is found v carrier / slope beside its place (2.14): 4 mm here.
    assert column * w.range_resolution == pytest.approx(distance, abs=0.5 * w.range_resolution + 0.005)
    assert observer.speed[row] == pytest.approx(-1.2, abs=0.5 * w.speed_resolution + 1e-6)
    assert level.max() > echoes.max() + 10
    near, far, slow, fast = observer.extent
    assert (far - near) / level.shape[1] == pytest.approx(w.range_resolution)
    assert (fast - slow) / level.shape[0] == pytest.approx(w.speed_resolution)
    scale = find_scale(radar, observer)
    # Over the scene it comes from 3.0 to 2.4 m, 4 dB, and moves through cells, up to 2 dB.
    assert scale.low < scale.high == pytest.approx(echoes.max(), abs=6.0)


def test_lost_chirps_are_left_out_of_the_map():
    """Whatever garbage their samples are."""
    radar = simulator(people=())
    frame = radar.process(0).frame
    cube = frame.cube.copy()
    cube[1, 3] = 1e6
    broken = dataclasses.replace(frame, cube=cube, missing=np.array([3 * 2 + 1], np.uint32))
    observer = Observer(radar.info)
    assert observer.process(broken).max() == pytest.approx(observer.process(frame).max(), abs=1.0)


def test_a_strip_keeps_the_strongest_of_the_frames_of_a_column():
    """Ten frames in four columns."""
    strip = Strip(10, 2, 4, -5.0)
    for k in range(10):
        strip.add(k, np.array([k, -k]))
    assert strip.values.tolist() == [[2, 4, 7, 9], [0, -3, -5, -5]]


def test_snapshots_look_for_gestures():
    """Evenly, then towards gestures, then towards other deeds; with a given time between them, evenly only."""
    doing = [Deed(0, "walk", 0.0, 1.0, False), Deed(0, "push", 1.0, 1.5, True), Deed(1, "draw", 8.0, 9.0, False)]
    times = snapshot_times(12.0, doing, None)
    assert len(times) == SNAPSHOTS
    assert times == pytest.approx([1.3, 3.0, 5.0, 7.0, 8.6, 11.0])
    assert snapshot_times(12.0, doing, 5.0) == pytest.approx([2.5, 7.5])
    assert snapshot_times(3.0, doing, 5.0) == [1.5]
    assert len(snapshot_times(1000.0, doing, 1.0)) == MOST_SNAPSHOTS


def test_deeds_are_the_scripts():
    """Gestures by their names with the truth's span."""
    radar = Simulator(load_scene("short"))
    found = deeds(radar)
    assert [(d.name, d.gesture) for d in found] == [("push", True), ("swipe right", True)]
    assert [d.start for d in found] == pytest.approx([2.0, 4.0])
    truth = radar.process(110).truth
    assert (found[0].start, found[0].end) == pytest.approx((truth.gesture_start_ns[0] * 1e-9, truth.gesture_end_ns[0] * 1e-9))


def test_the_room_that_is_shown_holds_what_is_in_it():
    """Radar, people, things; but nothing beyond where the radar measures."""
    far = simulator(points=(Point(position=(900.0, 0.0, 1.0)),))
    extent = room_extent(far.scene, far.info)
    assert np.all(extent.low <= [0.0, -2.0, 0.0])
    assert np.all(extent.high >= [4.0, 2.0, 2.0])
    assert np.all(np.abs([extent.low, extent.high]) < 10)


WAVEFORMS = {
    "cw": Waveform(modulation="cw", n_tx=1),
    "ofdm": Waveform(modulation="ofdm", n_tx=1, n_chirp=8, bandwidth=1.5e9, chirp_duration=64 / 1.5e9, chirp_pause=100e-6),
    "one chirp": Waveform(n_chirp=1),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", WAVEFORMS)
def test_every_kind_of_radar_can_be_drawn(tmp_path, kind):
    """Also one that measures no range, or no speed."""
    waveform = WAVEFORMS[kind]
    array = AntennaArray() if waveform.n_tx == 2 else AntennaArray(tx=AntennaArray().tx[:1])
    radar = simulator(0.04, people=PEOPLE[:1], walls=(), radars=(SceneRadar(waveform=waveform, array=array),), effects=Effects())
    draw(radar, tmp_path / "scene.png")
    draw(radar, tmp_path / "scene.mp4")
    assert imread(tmp_path / "scene.png").std() > 0.05
    assert len(decode(tmp_path / "scene.mp4")[0]) == math.ceil(radar.n_frames / 2)


@pytest.mark.parametrize("ending", ["mp4", "png"])
def test_an_empty_room_can_be_drawn(tmp_path, ending):
    """Nobody, nothing, no noise: no echo at all."""
    out = tmp_path / f"scene.{ending}"
    draw(Simulator(Scene(duration=0.04)), out)
    assert out.stat().st_size > 5000


@pytest.mark.long
def test_the_command_draws_beside_its_recording(tmp_path):
    """`handwave simulate SCENE -o BAG --preview FILE`."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("duration: 0.04\npeople: [{position: [2, 0]}]\n")
    done = CliRunner().invoke(app, ["simulate", str(scene), "-o", str(tmp_path / "bag"), "--preview", str(tmp_path / "scene.png")])
    assert done.exit_code == 0, done.output
    assert imread(tmp_path / "scene.png").shape[2] == 4
