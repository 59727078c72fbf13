"""A scene's animation to Blender and back, and targets from meshes: the same places, the same frames, a total that was named.

What needs Blender is skipped without it: see `test_blender`. The command's own tests need ROS too.
"""

import dataclasses
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radar_core import ConfigError, DataError
from radar_lab.blender_route import BlendFile, export, quaternions, times
from radar_lab.vertex_targets import TOTAL, OwnMeshes, VertexWorld, with_meshes
from radar_sim import Action, Person, Scene, Simulator, load_scene
from radar_sim.effects.config import Effects, OcclusionConfig
from radar_sim.people import Walk

HOW = "needs Blender as a Python module: pip install 'handwave[blender]' with Python 3.11 or 3.13"
THERE = Person(id=4, position=(2.2, 0.4), body="mesh", script=(Action(gesture="push"),))
PAST = Person(id=9, height=1.6, sex="female", position=(3.0, -1.0), body="mesh", script=(Action(walk=Walk(to=(3.0, 1.2))),))
SCENE = Scene(duration=2.0, people=(THERE, PAST), effects=Effects(doppler_in_chirp=True, occlusion=OcclusionConfig()))
SINGLE = 1e-5  # m: wanted; float32 leaves one or two micrometres


def thing(read, name):
    """What has a name in a file that is read, with a number behind it or not."""
    return next(one for one in read.held.objects if one.name.partition(".")[0] == name)


def radar(scene=SCENE):
    return Simulator(scene)


def far(a, b):
    """Largest distance between corresponding points."""
    return np.linalg.norm(a - b, axis=-1).max()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    pytest.importorskip("bpy", reason=HOW)
    path = tmp_path_factory.mktemp("blend") / "scene.blend"
    export(SCENE, times([radar()]), path)
    return path


@pytest.fixture(scope="module")
def source(file):
    with BlendFile(file, SCENE) as read:
        yield read


def test_positions_come_back(source):
    """At the times of the keys: start, middle and end of frames all over the scene."""
    at = times([radar()])[::17]
    for theirs, ours in zip(source.posed(at), OwnMeshes(SCENE).posed(at), strict=True):
        assert far(theirs.vertices, ours.vertices) < SINGLE
        np.testing.assert_array_equal(theirs.faces, ours.faces)
        for name in ("joint", "hand", "centre"):
            assert far(getattr(theirs.pose, name), getattr(ours.pose, name)) < SINGLE
        np.testing.assert_allclose(theirs.pose.rotation, ours.pose.rotation, atol=1e-5)
    assert np.ptp(ours.pose.centre, axis=0)[1] > 0.5  # they walked


def test_frames_of_facets_are_those_of_our_own_meshes(source):
    """A micrometre is 2.5 mrad of phase at 60 GHz; many facets: within 2e-3 of the frame's rms, and the same truth."""
    ours = radar()
    (theirs,) = with_meshes([ours], source)
    for k in (0, ours.n_frames // 2, ours.n_frames - 1):
        a, b = theirs.process(k), ours.process(k)
        assert np.linalg.norm(a.frame.cube - b.frame.cube) < 2e-3 * np.linalg.norm(b.frame.cube)
        assert far(a.truth.hand_position, b.truth.hand_position) < SINGLE
        np.testing.assert_allclose(a.truth.hand_velocity, b.truth.hand_velocity, atol=2e-3)
        np.testing.assert_array_equal(a.truth.gesture, b.truth.gesture)


@pytest.mark.long
@pytest.mark.parametrize("name", ["short", "demo"])
def test_scenes_of_ours_come_back(name, tmp_path):
    """Echoes alone, all over the scene: most frames within 1e-3 of their rms, none beyond 5e-3; found: 8e-4 and 4.1e-3, places 2.4 um."""
    pytest.importorskip("bpy", reason=HOW)
    scene = load_scene(name)
    people = tuple(dataclasses.replace(person, body="mesh") for person in scene.people)
    scene = dataclasses.replace(scene, people=people, effects=dataclasses.replace(scene.effects, noise=None, coupling=None))
    ours, own, errors = radar(scene), OwnMeshes(scene), []
    at = times([ours])
    export(scene, at, tmp_path / "scene.blend")
    with BlendFile(tmp_path / "scene.blend", scene) as read:
        (theirs,) = with_meshes([ours], read)
        for k in range(0, ours.n_frames, 25):
            a, b = theirs.process(k).frame.cube, ours.process(k).frame.cube
            errors.append(np.linalg.norm(a - b) / np.linalg.norm(b))
            for one, other in zip(read.posed(at[3 * k : 3 * k + 3]), own.posed(at[3 * k : 3 * k + 3]), strict=True):
                assert far(one.vertices, other.vertices) < 0.5 * SINGLE
    assert np.median(errors) < 1e-3
    assert max(errors) < 5e-3


def test_between_keys_blender_goes_straight(source):
    """Half-way from the end of a frame to the start of the next, within a millimetre of our own curve."""
    w = radar().info.waveform
    at = np.array([0.5 * (20 * w.frame_interval + w.acquisition_time + 21 * w.frame_interval)])
    for theirs, ours in zip(source.posed(at), OwnMeshes(SCENE).posed(at), strict=True):
        assert far(theirs.vertices, ours.vertices) < 1e-3


def test_our_own_meshes_give_our_own_frames():
    """Without Blender in between: the same scatterers, to rounding."""
    (theirs,), ours = with_meshes([radar()], OwnMeshes(SCENE)), radar()
    a, b = theirs.process(30), ours.process(30)
    np.testing.assert_allclose(a.frame.cube, b.frame.cube, atol=1e-6 * np.abs(b.frame.cube).max())


def scatterers(people, rcs="constant", total=TOTAL):
    """What of people alone echoes in the middle of a scene."""
    scene = dataclasses.replace(SCENE, people=people)
    world = VertexWorld(scene, scene.radars[0], OwnMeshes(scene), rcs, total)
    return world.scatterers(0.5, 0.01, world.poses(0.5, 0.01))


@pytest.mark.parametrize("total", [TOTAL, 1.5])
def test_constant_cross_sections_sum_to_the_total(total):
    """Every visible vertex the same, whichever way it looks; about half of all are visible."""
    seen = scatterers((THERE,), total=total)
    assert seen.rcs.sum() == pytest.approx(total)
    assert np.ptp(seen.rcs) == 0
    assert not seen.normal.any()
    n = OwnMeshes(dataclasses.replace(SCENE, people=(THERE,))).posed(np.zeros(1))[0].vertices.shape[1]
    assert 0.3 < len(seen) / n < 0.7
    assert seen.towards(np.zeros(3)).sum() == pytest.approx(total)


def test_what_others_hide_is_missing():
    """One right behind another: fewer vertices, each with as much as if nobody stood there."""
    behind = Person(id=5, position=(3.5, 0.6), body="mesh")
    alone, both = scatterers((behind,)), scatterers((THERE, behind))
    rest = both.rcs[both.owner == 1]
    assert both.rcs[both.owner == 0].sum() == pytest.approx(TOTAL)
    assert 0 < rest.sum() < 0.8 * TOTAL
    np.testing.assert_allclose(rest, alone.rcs[0])


def test_the_total_is_about_that_of_facets():
    """Of somebody who faces the radar."""
    person = Person(position=(2.3, 0.2), body="mesh")
    scene = dataclasses.replace(SCENE, people=(person,))
    truth = Simulator(scene).process(0).truth
    assert truth.scatterer_rcs.sum() == pytest.approx(TOTAL, rel=0.15)


def test_quaternions_turn_as_their_rotations_do():
    """Of all sizes of turns, half turns too; no two neighbours in time lie on opposite sides."""
    turns = Rotation.from_rotvec(np.random.default_rng(3).normal(size=(200, 3)) * np.linspace(0.0, 3.2, 200)[:, None])
    half = Rotation.from_rotvec(np.pi * np.eye(3))
    for wanted in (turns, half):
        found = quaternions(wanted.as_matrix()[:, None])[:, 0]
        np.testing.assert_allclose(Rotation.from_quat(found[:, [1, 2, 3, 0]]).as_matrix(), wanted.as_matrix(), atol=1e-12)
        assert ((found[1:] * found[:-1]).sum(1) >= 0).all()


def test_a_changed_file_changes_targets_and_truth(file, tmp_path):
    """Somebody moved one person in Blender, by their armature; the other stays."""
    bpy = pytest.importorskip("bpy", reason=HOW)
    changed, shift, at = tmp_path / "changed.blend", np.array([0.3, -0.2, 0.1]), np.array([0.5])
    with BlendFile(file, SCENE) as read:
        before = read.posed(at)
        thing(read, "bones_4").location = shift
        bpy.data.libraries.write(str(changed), {read.held})
    with BlendFile(changed, SCENE) as read:
        after = read.posed(at)
    for index, moved in ((0, shift), (1, np.zeros(3))):
        assert far(after[index].vertices, before[index].vertices + moved) < SINGLE
        assert far(after[index].pose.hand, before[index].pose.hand + moved) < SINGLE


def test_another_mesh_will_do(file, tmp_path):
    """Somebody put a tetrahedron of their own where a person was: it echoes from its facets, and the truth is the armature's."""
    bpy = pytest.importorskip("bpy", reason=HOW)
    changed, corners = tmp_path / "other.blend", np.array([[2.0, 0.0, 0.5], [3.0, 0.0, 0.5], [2.5, 1.0, 0.5], [2.5, 0.4, 1.5]])
    with BlendFile(file, SCENE) as read:
        thing(read, "person_4").name = "before"
        mesh = bpy.data.meshes.new("own")
        mesh.from_pydata(corners.tolist(), [], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
        read.held.collection.objects.link(bpy.data.objects.new("person_4", mesh))
        bpy.data.libraries.write(str(changed), {read.held})
        before = read.posed(np.zeros(1))[0].pose.hand
    with BlendFile(changed, SCENE) as read:
        after = read.posed(np.zeros(1))[0]
        (theirs,) = with_meshes([radar()], read)
        owners = theirs.process(0).truth.scatterer_owner
    assert far(after.vertices[0], corners) < SINGLE
    assert len(after.faces) == 4
    assert far(after.pose.hand, before) < SINGLE
    assert 1 <= (owners == 0).sum() <= 3 < (owners == 1).sum()


def test_files_that_will_not_do(file, tmp_path):
    """Not there, no Blender file, somebody else's people; nothing of them stays in Blender's memory."""
    bpy = pytest.importorskip("bpy", reason=HOW)
    before = [len(getattr(bpy.data, kind)) for kind in ("scenes", "objects", "meshes", "armatures", "actions", "shape_keys")]
    (tmp_path / "text.blend").write_text("nothing")
    for path in (tmp_path / "none.blend", tmp_path / "text.blend"):
        with pytest.raises(DataError, match="Blender cannot read it"):
            BlendFile(path, SCENE)
    with pytest.raises(DataError, match="it has no person_7, bones_7; keep the names"):
        BlendFile(file, dataclasses.replace(SCENE, people=(Person(id=7),)))
    with BlendFile(file, SCENE) as read:
        read.posed(np.zeros(1))
    assert [len(getattr(bpy.data, kind)) for kind in ("scenes", "objects", "meshes", "armatures", "actions", "shape_keys")] == before


def test_without_blender_the_message_names_the_extra(monkeypatch, tmp_path):
    """One line, and nothing is written; `test_commands` sees the same of the command."""
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(
        ConfigError, match=r"pip install 'handwave\[blender\]', with Python 3\.11 or 3\.13; handwave simulate does without$"
    ):
        export(SCENE, np.zeros(1), tmp_path / "scene.blend")
    assert not list(tmp_path.iterdir())


def invoke(*words):
    pytest.importorskip("rclpy", reason="the command writes a ROS recording")
    from typer.testing import CliRunner

    from radar_app.cli import app

    return CliRunner().invoke(app, ["lab", "blender", *map(str, words)])


@pytest.mark.long
def test_the_command_there_and_back(tmp_path):
    """A bag and its animation; then another bag of that animation."""
    pytest.importorskip("bpy", reason=HOW)
    done = invoke("short", "-o", tmp_path / "bag", "--seconds", 0.1)
    assert done.exit_code == 0, done.output
    from radar_ros.bags import contents

    again = invoke("short", "-o", tmp_path / "other", "--seconds", 0.1, "--from", tmp_path / "bag.blend", "--rcs", "constant")
    assert again.exit_code == 0, again.output
    assert contents(tmp_path / "bag")["/radar/frame"] == contents(tmp_path / "other")["/radar/frame"] == 5
    assert (tmp_path / "other" / "scene.yaml").exists()
