"""`show`: tables, CSV, JSON, pictures and films of bags, and the plot helpers, against what was simulated."""

import csv
import io
import json

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.showing.results import read_results
from radar_app.showing.tables import COLUMNS, POSITIONS
from radar_core import ConfigError, DataError, PointCloud, RadarInfo
from radar_lab.plots import PEOPLE, plot_micro_doppler, plot_range_doppler
from radar_sim import Simulator, load_scene

av = pytest.importorskip("av")


def call(*words):
    return CliRunner().invoke(app, ["show", *map(str, words)])


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Three seconds of a person who pushes after two: raw frames, and what `process` made of them."""
    folder = tmp_path_factory.mktemp("show")
    scene = folder / "push.yaml"
    person = "  - {id: 1, position: [2.3, 0.2], script: [{gesture: push, at: 2.0}]}\n"
    scene.write_text("duration: 3.2\nseed: 7\neffects: {noise: {noise_figure: 15}, losses: {level: 20}}\npeople:\n" + person)
    raw, results = folder / "raw", folder / "results"
    for words in (["simulate", str(scene), "--out", str(raw)], ["process", str(raw), "--out", str(results)]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    return raw, results


@pytest.mark.long
def test_tables_csv_and_json_say_what_happened(bags):
    """One person where it stood, one push when it was performed; the same in all three."""
    _, results = bags
    table = call(results).output
    assert "push" in table
    found = json.loads(call(results, "--json").output)
    (person,), (gesture,) = found["people"], found["gestures"]
    assert abs(person["x_m"] - 2.3) < 0.3
    assert abs(person["y_m"] - 0.2) < 0.3
    assert person["walked_m"] < 1.0
    assert (gesture["gesture"], gesture["person"]) == ("push", person["person"])
    assert 1.9 < gesture["start_s"] < gesture["end_s"] < 3.0
    rows = list(csv.DictReader(io.StringIO(call(results, "--csv").output)))
    assert tuple(rows[0]) == COLUMNS
    assert [row["kind"] for row in rows] == ["person", "gesture"]
    assert float(rows[1]["start_s"]) == pytest.approx(gesture["start_s"], abs=1e-3)
    places = list(csv.DictReader(io.StringIO(call(results, "--positions").output)))
    assert tuple(places[0]) == POSITIONS
    assert len(places) == len(read_results(results).people[0].time)
    assert abs(np.mean([float(row["x_m"]) for row in places]) - 2.3) < 0.3


@pytest.mark.long
def test_pictures_and_films_of_any_bag(bags, tmp_path):
    """Of results and of raw frames alone; a picture has the person in its colour, a film one picture each 40 ms."""
    raw, results = bags
    done = call(results, "--preview", tmp_path / "results.png")
    assert done.exit_code == 0, done.output
    assert f"drawn: {tmp_path / 'results.png'}" in done.output.replace("\n", "").replace("drawn", "\ndrawn")
    picture = imread(tmp_path / "results.png")
    assert picture.shape[:2] == (720, 1280)
    assert shown(picture, PEOPLE[0]) > 20
    assert call(raw, "--preview", tmp_path / "raw.png").exit_code == 0
    assert shown(imread(tmp_path / "raw.png"), PEOPLE[0]) == 0
    assert call(results, "--preview", tmp_path / "results.mp4").exit_code == 0
    with av.open(str(tmp_path / "results.mp4")) as film:
        pictures = sum(1 for _ in film.decode(video=0))
    assert 70 <= pictures <= 85
    assert call(raw, "--range-doppler", tmp_path / "map.png", "--at", "2.4", "--micro-doppler", tmp_path / "time.png").exit_code == 0
    assert imread(tmp_path / "map.png").ndim == imread(tmp_path / "time.png").ndim == 3
    assert not list(tmp_path.glob("*.part"))


def shown(picture, colour):
    """Pixels of about a colour."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return int(np.count_nonzero(np.abs(picture[..., :3] - wanted).max(axis=-1) < 0.08))


@pytest.mark.long
def test_what_cannot_be_shown_says_why(bags, tmp_path):
    """One error each, and no file."""
    raw, results = bags
    for words, message in (
        ((raw,), "handwave process"),
        ((results, "--csv", "--json"), "choose one of"),
        ((results, "--range-doppler", tmp_path / "x.png"), "holds no raw frames"),
        ((raw, "--range-doppler", tmp_path / "x.png", "--at", 90), "is over after 3"),
        ((results, "--preview", tmp_path / "x.gif"), r"end its name in .mp4 or .png"),
        ((tmp_path / "nowhere",), "there is no such recording"),
    ):
        error = call(*words).exception
        assert isinstance(error, (ConfigError, DataError)), words
        assert message in str(error)
    assert list(tmp_path.iterdir()) == []


def test_a_target_is_where_it_is_in_the_plots():
    """Range and range rate of a simulated reflector, in units of the axes."""
    scene = load_scene("single_target")
    simulator = Simulator(scene)
    frames = [simulator.process(k).frame for k in range(4)]
    ax = plot_range_doppler(frames[0], simulator.info)
    image = ax.get_images()[0]
    near, far, slow, fast = image.get_extent()
    level = np.asarray(image.get_array())
    level[:, :5] = -400.0  # what the radar hears of itself
    row, column = np.unravel_index(level.argmax(), level.shape)
    place = simulator.process(0).truth
    distance = float(np.linalg.norm(place.scatterer_position[0] - simulator.info.mount.origin))
    assert near + (column + 0.5) / level.shape[1] * (far - near) == pytest.approx(distance, abs=0.3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("range [m]", "range rate [m/s], positive: going away")
    over_time = plot_micro_doppler(frames, simulator.info).get_images()[0]
    rates = np.asarray(over_time.get_array()).argmax(axis=0)
    assert np.abs(rates - row).max() <= 1
    assert over_time.get_extent()[2:] == [slow, fast]
    with pytest.raises(ConfigError, match="has the shape"):
        plot_range_doppler(frames[0], RadarInfo(waveform=simulator.info.waveform.__class__(n_chirp=32)))
    with pytest.raises(DataError, match="no frames"):
        plot_micro_doppler([])


def test_a_gap_in_the_clouds_stays_empty():
    """Time goes on where nothing was recorded; points are in the cell of their range rate."""

    def cloud(stamp, rate):
        one = np.array([1.0], np.float32)
        return PointCloud(stamp, 0, "radar", one, one, one, radial_speed=np.array([rate], np.float32), snr=np.array([20.0], np.float32))

    stamps = [*range(0, 200, 20), *range(1000, 1200, 20)]
    image = plot_micro_doppler([cloud(ms * 10**6, 1.0) for ms in stamps]).get_images()[0]
    level = np.asarray(np.ma.filled(image.get_array(), np.nan))
    assert level.shape[1] == 60
    assert np.isfinite(level).any(axis=0).tolist() == [True] * 10 + [False] * 40 + [True] * 10
    (row,) = np.unique(np.nonzero(np.isfinite(level))[0])
    low, high = image.get_extent()[2:]
    assert low + row / level.shape[0] * (high - low) <= 1.0 < low + (row + 1) / level.shape[0] * (high - low)
