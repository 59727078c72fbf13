"""From the feed to the session to a data set that is trained on: what comes is kept, detection goes on, and what is not kept is told."""

from __future__ import annotations

import json
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from performances import LONG, STEP, Player, S, clouds_of
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.logger.logger import Logger, LoggerConfig
from radar_app.logger.store import JOURNAL, SessionStore, read_session
from radar_core import ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_lab.datasets.readings import collect
from radar_lab.datasets.samples import ONE, read_samples, unpack_clouds
from radar_sim import Simulator, load_scene

SCENE = """
duration: 3.6
seed: 5
radars: [{waveform: {n_sample: 32, bandwidth: 0.75e+9, frame_interval: 0.04}}]
people:
  - {id: 6, position: [2.0, 0.0], script: [{gesture: push, at: 2.0}]}
effects: {noise: {}, losses: {}}
"""


def until(wanted, timeout=30.0):
    """Wait for something."""
    end = time.monotonic() + timeout
    while not (found := wanted()):
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)
    return found


def test_every_event_is_kept_with_what_was_around_it(tmp_path):
    """Two events of one person: maps as the graph made them, clouds and raw frames from 2 s before to 0.8 s after, and where they were."""
    info = RadarInfo(waveform=Waveform(n_sample=32, n_chirp=16))
    player, clouds = Player(info), clouds_of(["push", "pull"])

    def frame(cloud):
        cube = np.full(info.cube_shape, cloud.sequence, np.complex64)
        stamp = cloud.stamp_ns - info.waveform.acquisition_ns // 2
        player.feed.put("frames", stamp, RadarFrame(cube, stamp, cloud.sequence, "radar"))

    with closing(Logger(player.feed, SessionStore(tmp_path, "anna"))) as logger:
        assert player.feed.wanted("frames")
        for k in (0, 1):  # six seconds of frames are kept, so the first event is looked for before the second comes
            player.put(clouds[160 * k : 160 * (k + 1)], frame)
            until(lambda k=k: len(logger.state.waiting) == k + 1)
        first, second = logger.state.waiting
        shown = logger.state.current
        logger.label(first, "push").result()
        assert logger.state.said[-1] == f"saved: event {first} is push"
        assert logger.state.counts == {"push": 1}
        assert logger.state.waiting == (second,)
        logger.discard(second).result()
        assert logger.state.current is None
        logger.undo().result()
        logger.undo().result()
        assert logger.state.said[-1] == f"taken back: event {first} was push; it waits again"
        assert logger.state.waiting == (first, second)
        logger.undo().result()
        assert logger.state.said[-1] == "there is nothing to take back"
        logger.label(first, "Oh no").result()
        assert logger.state.wrong
        assert "use small letters" in logger.state.said[-1]
        logger.label(first, "clap").result()
        assert logger.state.labels[-1] == "clap"
    assert not player.feed.wanted("frames")
    event = SessionStore(tmp_path).event(first, raw=True)
    history = player.feed.history()
    gesture, maps = history.gestures[0].value, history.maps[0].value.maps
    for kept in (event, shown):
        assert (kept.start_ns, kept.end_ns, kept.decided_ns) == (gesture.start_ns, gesture.end_ns, gesture.stamp_ns)
        assert (kept.guess, kept.confidence) == (gesture.name, gesture.confidence)
        for name in ("stamp_ns", "speed", "micro_doppler", "azimuth", "elevation"):
            np.testing.assert_array_equal(getattr(kept.maps, name), getattr(maps, name))
    stamps = [cloud.stamp_ns for cloud in event.clouds]
    inside = [cloud for cloud in clouds if event.start_ns - 2 * S <= cloud.stamp_ns <= event.end_ns + 8 * S // 10]
    assert stamps == [cloud.stamp_ns for cloud in inside]
    np.testing.assert_allclose(event.clouds[70].position, inside[70].position, atol=1e-5)
    assert [frame.sequence for frame in event.frames] == [cloud.sequence for cloud in inside]
    assert all((frame.cube == frame.sequence).all() for frame in event.frames)
    np.testing.assert_allclose(np.nanmedian(event.position, axis=0)[:2], [2.0, 0.0], atol=0.2)


@pytest.mark.long
def test_what_is_not_kept_is_told(tmp_path):
    """Too many wait; the time goes back and the clouds are gone; there are two radars. Detection goes on meanwhile."""
    player = Player()
    with closing(Logger(player.feed, SessionStore(tmp_path), LoggerConfig(waiting=1))) as logger:
        player.put(clouds_of(["push", "push", "push"]))
        until(lambda: logger.state.lost == 2)
        assert logger.state.wrong
        assert logger.state.said[-1] == "an event was not kept: 1 events wait for a label; label or discard some"
        logger.label(logger.state.waiting[0], "push").result()
        player.put(clouds_of(["pull"], start=3 * LONG))
        until(lambda: len(logger.state.waiting) == 1)
        logger.label(logger.state.waiting[0], "pull").result()
        player.feed.know(replace(RadarInfo(), frame_id="left/radar"))
        player.put(clouds_of(["pull"], start=4 * LONG))
        until(lambda: logger.state.lost == 3)
        assert "log one of them with --namespace" in logger.state.said[-1]
    assert [one.gesture for one in read_session(tmp_path).labels] == ["push", "pull"]


@pytest.mark.long
def test_an_event_at_the_end_of_a_source_is_kept_all_the_same(tmp_path):
    """Nothing comes after it: after a moment it counts as complete, and at the end of the logger at once."""
    player = Player()
    clouds = clouds_of(["push"])
    cut = next(k for k, cloud in enumerate(clouds) if cloud.stamp_ns > 1 * S + 25 * S // 10)
    logger = Logger(player.feed, SessionStore(tmp_path))
    player.put(clouds[:cut])
    until(lambda: logger.state.waiting)
    player.put(clouds_of(["push"], start=LONG)[:cut])
    logger.close()
    session = SessionStore(tmp_path)
    assert len(session.pending) == 2
    session.close()


def test_an_event_is_kept_when_the_time_goes_back(tmp_path):
    """A recording that is shown again and again: what waits for its last clouds is kept with those that had come."""
    player, clouds = Player(), clouds_of(["push"])
    cut = next(k for k, cloud in enumerate(clouds) if cloud.stamp_ns > 1 * S + 22 * S // 10)
    with closing(Logger(player.feed, SessionStore(tmp_path))) as logger:
        player.put(clouds[:cut])
        until(lambda: logger._history.end_ns or logger.state.waiting)
        for cloud in clouds[:20]:
            player.feed.put("clouds", cloud.stamp_ns, cloud)
        until(lambda: logger.state.waiting or logger.state.lost)
        assert logger.state.lost == 0
        event = logger.state.current
        assert event.end_ns <= event.clouds[-1].stamp_ns <= clouds[cut - 1].stamp_ns


def test_the_page_learns_what_a_crash_had_left(tmp_path):
    SessionStore(tmp_path).close()
    with (tmp_path / JOURNAL).open("ab") as journal:
        journal.write(b"12345678 {")
    with closing(Logger(Player().feed, SessionStore(tmp_path))) as logger:
        assert "the last write was cut off" in logger.state.said[-1]
    (tmp_path / "event_00000.npz").write_bytes(b"no event")
    with closing(Logger(Player().feed, SessionStore(tmp_path))) as logger:
        assert "event_00000.npz: cannot be read" in logger.state.said[-1]
        assert logger.state.current is None
        logger.discard(0).result()
        assert not logger.state.waiting


def run(*words, wrong=None):
    done = CliRunner().invoke(app, [str(word) for word in words])
    if wrong is not None:
        assert isinstance(done.exception, wrong), done.output
        return str(done.exception)
    assert done.exit_code == 0, (done.output, done.exception)
    return " ".join(done.output.split())


def logged(folder: Path, subjects, gestures, *, frames=False):
    """Let subjects perform gestures before a logger whose operator labels each event at once, `clap` for every third."""
    for subject in subjects:
        player = Player()
        with closing(Logger(player.feed, SessionStore(folder, subject))) as logger:
            for k, gesture in enumerate(gestures):
                player.put(clouds_of([gesture], start=k * LONG))
                number = until(lambda logger=logger: logger.state.waiting)[0]
                logger.label(number, gesture).result()


@pytest.mark.long
def test_from_the_page_to_a_trained_model(tmp_path):
    """Two people, two sessions: their labels become samples that training takes; the same name is the same person."""
    people, four = tmp_path / "people", ["push", "pull", "push", "pull"]
    logged(tmp_path / "monday", ["anna", "ben"], four)
    logged(tmp_path / "friday", ["ben"], ["pull"])
    store = SessionStore(tmp_path / "friday")
    store.undo()
    store.label(store.pending[0], "clap")
    store.close()
    assert "8 samples added" in (text := run("dataset", "import", tmp_path / "monday", people))
    assert "in 8 of them the gesture is found" in text
    assert "1 samples added" in run("dataset", "import", tmp_path / "friday", people)
    assert "0 samples added" in (text := run("dataset", "import", tmp_path / "monday", people))
    assert "8 were there already" in text
    assert json.loads((people / "subjects.json").read_text()) == {"anna": 0, "ben": 1}
    samples = list(read_samples(people))
    names = [(str(sample["gesture"]), int(sample["subject"])) for sample in samples]
    assert names == [*((name, person) for person in (0, 1) for name in four), ("clap", 1)]
    for sample in samples:
        assert np.isfinite(sample["position"]).mean() > 0.8
        assert np.abs(sample["stroke_ns"] - sample["event_ns"]).max() <= STEP * S
    read = collect(people)
    assert read.missed.sum() == 0
    assert read.labels[-1] == "clap"
    model = tmp_path / "model.npz"
    assert "model in" in run("train", people, "--labels", "push,pull", "-o", model)
    assert load_model(str(model)).labels == ("push", "pull")


@pytest.mark.long
def test_raw_frames_of_a_session_are_worked_out_again(tmp_path):
    """With `--one-tx` the points come from the raw frames: those that the graph had seen, and what one transmitter alone saw."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    simulator = Simulator(load_scene(str(tmp_path / "scene.yaml")))
    player, baseband = Player(simulator.info), Baseband(BasebandConfig(), simulator.info)
    with closing(Logger(player.feed, SessionStore(tmp_path / "session", "anna"))) as logger:
        for k in range(simulator.n_frames):
            frame = simulator.process(k).frame
            player.feed.put("frames", frame.stamp_ns, frame)
            player.put([baseband.process(frame)])
        number = until(lambda: logger.state.waiting)[0]
        logger.label(number, "push").result()
    for name, options in (("seen", ()), ("again", ("--one-tx",))):
        text = run("dataset", "import", tmp_path / "session", tmp_path / name, *options)
        assert "1 samples added" in text
        assert "in 1 of them the gesture is found" in text
    seen, again = (next(iter(read_samples(tmp_path / name))) for name in ("seen", "again"))
    np.testing.assert_array_equal(seen["stamp_ns"], again["stamp_ns"])
    np.testing.assert_allclose(seen["cloud_x"], again["cloud_x"], atol=1e-5)
    np.testing.assert_array_equal(seen["position"], again["position"])
    assert len(unpack_clouds(again, ONE)) == len(again["stamp_ns"])


def test_mistakes_of_an_import_are_named(tmp_path):
    store = SessionStore(tmp_path / "session")
    store.close()
    assert "nothing is labelled; label events first" in run("dataset", "import", tmp_path / "session", tmp_path / "x", wrong=ConfigError)
    logged(tmp_path / "session", [""], ["push"])
    words = ("dataset", "import", tmp_path / "session", tmp_path / "x")
    assert "a session has labels of its own" in run(*words, "--own", "clap", wrong=ConfigError)
    assert "holds no raw frames; leave --one-tx" in run(*words, "--one-tx", wrong=DataError)
    (tmp_path / "y").mkdir()
    (tmp_path / "y" / "subjects.json").write_text("[1]")
    assert "it has to hold names and numbers" in run(*words[:3], tmp_path / "y", wrong=DataError)
    assert "1 samples added" in run(*words[:3], tmp_path / "z")
    assert json.loads((tmp_path / "z" / "subjects.json").read_text()) == {"session": 0}
