"""What effects mean for a scene: sizes, what they change, and `effects: auto`."""

import dataclasses
import math

import numpy as np
import pytest
from truths import a_scene, first_cube, point_scene

from radar_core import ConfigError, Pose, RadarInfo, Waveform
from radar_sim import Effects, InterferenceConfig, NoiseConfig, Person, PhaseNoiseConfig, Scene, SceneRadar, Simulator, Wall
from radar_sim.audit import explain
from radar_sim.auto import CANDIDATES, choose_effects
from radar_sim.effects.chain import NAMES
from radar_sim.probe import Probe

INFO = RadarInfo(mount=Pose(z=0.0))
STILL, SLOW, FAST = (0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (3.0, 1.0, 0.0)


def auto(scene: Scene, **more) -> Scene:
    return choose_effects(dataclasses.replace(scene, effects=Effects(auto=True), **more), Simulator).scene


def on(scene: Scene) -> set[str]:
    return {name for name in NAMES if getattr(scene.effects, name)}


def test_candidates_are_effects():
    assert set(CANDIDATES) < set(NAMES)


def test_explain_says_what_is_on_what_it_changes_and_warns_about_what_is_missing():
    """A fast target with noise named: noise is on and of the size that k T F B says; migration is missing."""
    scene = point_scene((2.5, 0.0, 0.0), FAST, radar=INFO, effects=Effects(noise=NoiseConfig(noise_figure=15.0)))
    reports = {report.name: report for report in explain(scene, repeat=1).effects}
    assert list(reports) == list(NAMES)
    assert all(report.size for report in reports.values())
    assert [name for name, report in reports.items() if report.on] == ["noise"]
    echo = np.abs(first_cube(dataclasses.replace(scene, effects=Effects()))).mean()
    w = INFO.waveform
    noise = math.sqrt(50 * 1.380649e-23 * 290 * w.n_sample / w.chirp_duration * 10**1.5)
    assert reports["noise"].change == pytest.approx(noise / echo, rel=0.5)  # the target recedes: the echo halves over the second
    assert "range_migration" in reports["range_migration"].name
    assert "(tolerance 0.02)" in reports["range_migration"].warning
    assert "bins" in reports["range_migration"].size
    assert not reports["noise"].warning
    assert all(report.size and math.isfinite(report.change) and report.cost_ms >= 0.0 for report in reports.values())


@pytest.mark.parametrize(
    ("scene", "wanted", "unwanted"),
    [
        (
            point_scene((2.5, 0.0, 0.0), STILL, radar=INFO),
            set(),
            {"range_migration", "curvature", "doppler_in_chirp", "occlusion", "multipath"},
        ),
        (point_scene((2.5, 0.0, 0.0), FAST, radar=INFO), {"range_migration"}, {"occlusion"}),
        (point_scene((2.5, 1.5, 0.0), STILL, radar=INFO), {"pattern", "squint"}, {"range_migration"}),
        (point_scene((5.5, 0.0, 0.0), STILL, rcs=1e-4, radar=INFO), {"noise", "coupling"}, set()),
        (a_scene(people=(Person(id=1, position=(2.0, 0.0)), Person(id=2, position=(3.0, 0.0)))), {"occlusion"}, {"range_migration"}),
        (
            a_scene(people=(Person(position=(2.0, 0.0)),), walls=(Wall(start=(0.5, -1.0), end=(5.0, -1.0), mirror=0.9),)),
            {"multipath"},
            {"range_migration"},
        ),
    ],
    ids=["still", "fast", "aside", "weak", "behind", "mirror"],
)
def test_auto_chooses_what_the_scene_calls_for(scene, wanted, unwanted):
    """What changes the samples by more than the tolerance is named, what does not is left out."""
    chosen = on(auto(scene))
    assert wanted <= chosen
    assert not unwanted & chosen
    assert chosen <= set(CANDIDATES)


def test_auto_follows_the_tolerance_and_says_why():
    """A wider tolerance names less; what the scene names stays; each candidate has a line that says what was decided."""
    scene = point_scene((2.5, 0.8, 0.2), (0.5, 0.3, 0.0), radar=INFO)
    sets = [on(auto(scene, tolerance=tolerance)) for tolerance in (1e-4, 0.02, 1.0)]
    assert sets[2] < sets[1] < sets[0]
    named = dataclasses.replace(scene, effects=Effects(auto=True, interference=InterferenceConfig(), squint=True), tolerance=1.0)
    choice = choose_effects(named, Simulator)
    assert {"interference", "squint"} <= on(choice.scene)
    assert len(choice.reasons) == len(CANDIDATES)
    assert any(line == "squint: on, the scene names it" for line in choice.reasons)
    assert any("off, it changes the samples by" in line and "(tolerance 1)" in line for line in choice.reasons)


def test_simulators_of_auto_scenes_are_those_of_what_was_chosen():
    """`effects: auto` is settled before the first frame; the simulator's scene says what was chosen."""
    scene = dataclasses.replace(point_scene((2.5, 0.5, 0.0), FAST, radar=INFO), effects=Effects(auto=True))
    simulator = Simulator(scene)
    assert not simulator.scene.effects.auto
    assert simulator.scene == choose_effects(scene, Simulator).scene
    np.testing.assert_array_equal(simulator.process(3).frame.cube, Simulator(simulator.scene).process(3).frame.cube)


def test_nothing_there():
    """Without echoes every relative change of what adds samples is infinite, of the rest zero; nothing fails, even without a frame."""
    reports = {r.name: r for r in explain(a_scene(INFO), repeat=1).effects}
    assert reports["noise"].change == math.inf
    assert reports["range_migration"].change == 0.0
    assert len(explain(a_scene(INFO, duration=0.0), repeat=1).effects) == len(NAMES)


def test_other_modulations_do_without_what_they_cannot_have():
    """Phase noise and interference are FMCW's: for a tone they change nothing, unless the scene names them, which is refused."""
    radar = SceneRadar(waveform=Waveform(modulation="cw"), mount=Pose(z=0.0))
    scene = dataclasses.replace(point_scene((2.5, 0.0, 0.0), FAST), radars=(radar,))
    reports = {r.name: r for r in explain(scene, repeat=1).effects}
    assert reports["phase_noise"].change == reports["interference"].change == 0.0
    assert "phase_noise" not in on(auto(scene))
    with pytest.raises(ConfigError, match="cw"):
        Probe(dataclasses.replace(scene, effects=Effects(phase_noise=PhaseNoiseConfig())), Simulator).change("phase_noise")
