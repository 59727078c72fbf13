"""Parts of the study of waveforms: what they measure, scenes, and when two people count as told apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import waveforms
from benchmarks.waveforms import WAVEFORMS, Seen, both_tracked, figures, gestures, motion, two
from radar_core import Quality
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator
from radar_sim.motions.script import Timeline


def test_range_cells_and_how_far_one_sees():
    """4 GHz: 3.75 cm; all sweeps see as far, and all waveforms but the fast one take the same time."""
    cells = [one.range_resolution for one in WAVEFORMS.values()]
    np.testing.assert_allclose(cells, [np.inf, np.inf, 0.5996, 0.1499, 0.07495, 0.03747], rtol=1e-3)
    np.testing.assert_allclose([one.max_range for name, one in WAVEFORMS.items() if "GHz" in name], 9.593, rtol=1e-3)
    assert {one.acquisition_time for name, one in WAVEFORMS.items() if name != "CW, 200 Hz"} == {WAVEFORMS["CW"].acquisition_time}
    assert len({one.max_speed for one in WAVEFORMS.values()}) == 1


@pytest.mark.long
@pytest.mark.parametrize("number", [101, 102])
def test_two_people_stand_as_far_apart_as_is_said(number):
    scene = two(number, WAVEFORMS["1 GHz"])
    simulator = Simulator(scene)
    truth = simulator.process(simulator.n_frames - 1).truth
    step = truth.position[1, :2] - truth.position[0, :2]
    assert np.hypot(*step) == pytest.approx(np.hypot(0.4, 0.45), abs=0.08)  # bodies sway
    near, far = np.hypot(*truth.position[:, :2].T)
    assert far - near == pytest.approx(0.4, abs=0.08)


def test_all_gestures_are_over_before_the_scene_is():
    scene = gestures(101, WAVEFORMS["CW"])
    assert Timeline(scene.people[0], scene.seed, (0.0, 0.0)).end < scene.duration


def test_one_track_is_not_two_people(monkeypatch):
    """Everybody needs a track of their own, and no frame before the first second counts."""
    place = np.array([[2.0, 0.0, 1.0], [2.4, 0.3, 1.0]])

    def given(tracks, stamp):
        people = tuple(SimpleNamespace(position=np.array(one)) for one in tracks)
        return SimpleNamespace(stamp_ns=round(stamp * 1e9)), SimpleNamespace(people=people)

    frames = [given(place, 0.5), given(place, 1.5), given(place[:1], 1.6), given([[2.2, 0.15, 1.0]], 1.7), given([*place, [5, 0, 1]], 1.8)]
    monkeypatch.setattr(waveforms, "tracked", lambda clouds, radar: frames)
    truths = [SimpleNamespace(position=place)] * len(frames)
    assert both_tracked([], truths, None) == 0.5


@pytest.mark.long
def test_a_tone_says_how_fast_and_where_but_not_how_far():
    """Some frames of a scene: clouds without ranges, errors of what moves."""
    scene = gestures(101, WAVEFORMS["CW"])
    simulator, seen = Simulator(scene), Seen()
    baseband = Baseband(BasebandConfig(), simulator.info)
    made = [simulator.process(number) for number in range(60, 200, 4)]
    clouds = [baseband.process(one.frame) for one in made]
    assert all(np.isnan(cloud.range).all() and cloud.quality == Quality.GOOD for cloud in clouds)
    motion(clouds, [one.truth for one in made], scene.radars[0], seen)
    seen.times_ms, seen.points = [0.1], [len(clouds[0])]
    found = figures(WAVEFORMS["CW"], seen)
    assert found["motion_found"] > 0.5
    assert found["rate_rms_m_s"] < 0.5
    assert found["azimuth_rms_deg"] < 5.0
    assert found["range_cell_m"] is None
    assert found["hand_median_m"] is None
    assert found["two_people_share"] is None
