"""Pictures: they show what the numbers say, they can be read back, and a place that cannot be written is named."""

from __future__ import annotations

import json

import matplotlib.image
import numpy as np
import pytest
from small_sets import random_set, stroke_clouds

from radar_core import GESTURES, DataError, RadarInfo
from radar_lab.datasets.labelled import Moment, import_labelled
from radar_lab.datasets.samples import read_samples
from radar_lab.evaluation import pictures
from radar_lab.evaluation.comparison import ComparisonConfig, compare
from radar_lab.evaluation.scoring import TruthSegment

LABELS = (1, 2, 9)


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set")
    label = TruthSegment(1, GESTURES.index("push"), 1_600_000_000, 2_100_000_000)
    import_labelled(folder, RadarInfo(), map(Moment, stroke_clouds()), [label], source="x")
    return next(iter(read_samples(folder)))


def drawn(monkeypatch, draw):
    """What a function draws, before it becomes a file."""
    kept = []
    monkeypatch.setattr(pictures, "save_figure", lambda figure, path: kept.append(figure))
    draw()
    return kept[0]


def test_a_sample_s_picture_shows_maps_and_signals(sample, monkeypatch):
    """The approaching arm is on the negative side while it moves; the event's lines are where the event is."""
    figure = drawn(monkeypatch, lambda: pictures.draw_sample_maps(sample, "none.png"))
    image = next(axes.images[0] for axes in figure.axes if axes.get_title() == "Micro-Doppler [dB]")
    power, (left, right, low, high) = np.ma.filled(image.get_array().astype(float), np.nan), image.get_extent()
    speed = np.linspace(low, high, power.shape[0] + 1)[:-1]
    time = np.linspace(left, right, 2 * power.shape[1] + 1)[1::2]  # middles
    fast = np.isfinite(power) & (np.abs(speed) > 1.0)[:, None]
    assert (speed[fast.any(axis=1)] < 0).all()
    # From the stroke's start, 0, to its end at 0.5 s, within a frame of 20 ms.
    np.testing.assert_allclose(time[fast.any(axis=0)][[0, -1]], [0.0, 0.5], atol=0.021)
    signal = next(axes for axes in figure.axes if axes.get_ylabel() == "Speed [m/s]" and axes.lines[0].get_marker() == ".")
    assert np.min(signal.lines[0].get_ydata()) == pytest.approx(-1.5, abs=0.01)
    event = [(stamp - int(sample["stroke_ns"][0])) * 1e-9 for stamp in sample["event_ns"]]
    assert [line.get_xdata()[0] for line in signal.lines[1:]] == pytest.approx(event)
    assert "push, subject 1, found" in figure.get_suptitle()


@pytest.mark.long
def test_a_missed_gesture_is_drawn_too(sample, tmp_path):
    missed = sample | {"stroke_ns": sample["stroke_ns"] + 10**10}
    pictures.draw_sample_maps(missed, tmp_path / "missed.png")
    assert matplotlib.image.imread(tmp_path / "missed.png").std() > 0.05


@pytest.mark.long
def test_a_comparison_has_all_its_pictures(tmp_path):
    """Two scatters, the table, and one box plot a gesture; each a picture with something in it, and the same bytes every time."""
    a, b = random_set(20, LABELS, seed=1), random_set(15, LABELS, seed=2)
    result = compare(a, b, ComparisonConfig(max_iterations=10))
    made = pictures.draw_comparison(result, a, b, tmp_path / "new", ("simulated", "recorded"))
    names = ["kruskal", "scatter_1", "scatter_2", *(f"box_{GESTURES[label]}" for label in LABELS)]
    assert [path.stem for path in made] == names
    for path in made:
        assert matplotlib.image.imread(path)[..., :3].std() > 0.02
    pictures.draw_kruskal(result, tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == made[0].read_bytes()


def test_the_table_is_green_where_distributions_differ(monkeypatch):
    """Feature 4 shifted by five standard deviations: its column is green and nothing else has to be; a constant feature is red."""
    a, b = random_set(30, LABELS, seed=1), random_set(30, LABELS, seed=2)
    a.features[:, 0] = b.features[:, 0] = 1.0
    b.features[:, 4] += 5.0
    result = compare(a, b, ComparisonConfig(max_iterations=10))
    kinds = drawn(monkeypatch, lambda: pictures.draw_kruskal(result, "none.png")).axes[0].images[0].get_array()
    assert (kinds[:, 4] == 0).all()
    assert (kinds[:, 0] == 1).all()


def test_scatters_are_on_the_same_axes(monkeypatch):
    """Both plots reach over the samples of both."""
    a, b = random_set(10, (1, 2), seed=1), random_set(10, (1, 2), shift=4.0, seed=2)
    features = ("zero_crossings", "max_speed", "min_speed")
    figure = drawn(monkeypatch, lambda: pictures.draw_scatter(a, b, ("pull", "push", "wave"), features, "none.png"))
    left, right = figure.axes
    for axis in "xyz":
        limits = getattr(left, f"get_{axis}lim")()
        assert limits == getattr(right, f"get_{axis}lim")()
    both = np.concatenate([a.features, b.features])[:, 3]
    assert left.get_ylim()[0] < both.min() < both.max() < left.get_ylim()[1]
    assert [text.get_text() for text in left.get_legend().get_texts()] == ["pull (10)", "push (10)", "wave (0)"]


def test_a_place_that_cannot_be_written_is_named(sample, tmp_path):
    (tmp_path / "file").write_text(json.dumps(0))
    with pytest.raises(DataError, match=r"file/x\.png: cannot be written"):
        pictures.draw_sample_maps(sample, tmp_path / "file" / "x.png")
    a = random_set(5, LABELS)
    with pytest.raises(DataError, match="cannot be written"):
        pictures.draw_comparison(compare(a, a, ComparisonConfig(max_iterations=2)), a, a, tmp_path / "file" / "x")
