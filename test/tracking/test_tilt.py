"""How far a radar is tilted: known points, simulated people on other mounts, notes, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import DataError, PointCloud, Pose, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_lab.alignment.tilt import HEIGHTS, TiltConfig, TiltFinder, tilts_of
from radar_sim import Scene, Simulator
from radar_sim.effects.config import Effects, NoiseConfig
from radar_sim.people import Action, Person, Walk
from radar_sim.scene import Fidelity, SceneRadar

PLACES = ((3.5, 0.8), (2.0, -0.5), (4.2, -0.9), (4.0, 0.9), (1.8, 0.4), (3.0, -0.8))


def cloud_at(mount: Pose, room: np.ndarray, stamp_ns: int = 0, speed: float = 1.0) -> PointCloud:
    """Points of the room, shape (n_points, 3), as the radar sees them."""
    c, s = math.cos(mount.tilt), math.sin(mount.tilt)
    x, y, z = (room - [mount.x, mount.y, mount.z]).T
    own = np.stack([c * x + s * z, y, c * z - s * x], axis=1)
    distance = np.linalg.norm(own, axis=1)
    x, y, z = own.T.astype(np.float32)
    n = len(room)
    return PointCloud(
        stamp_ns, 0, "radar", x=x, y=y, z=z, radial_speed=np.full(n, speed, np.float32), snr=np.full(n, 20.0, np.float32),
        range=distance.astype(np.float32), azimuth=np.arctan2(y, x), elevation=np.arcsin(z / distance).astype(np.float32),
    )  # fmt: skip


@given(
    tilt=st.floats(-1.2, 1.2),
    height=st.floats(0.3, 2.5),
    above=st.floats(0.5, 1.5),
    distance=st.floats(1.5, 8.0),
    azimuth=st.floats(-0.8, 0.8),
)
def test_a_point_at_a_known_height_tells_the_tilt(tilt: float, height: float, above: float, distance: float, azimuth: float) -> None:
    """Of any mount, wherever the point is: exactly, where the point is in front of the radar."""
    mount = Pose(z=height, tilt=tilt)
    room = np.array([[distance * math.cos(azimuth), distance * math.sin(azimuth), above]])
    cloud = cloud_at(mount, room)
    if cloud.x[0] < 0.3:
        return
    np.testing.assert_allclose(tilts_of(cloud, above - height), tilt, atol=2e-5)  # single precision of angles


def test_the_median_of_the_seconds_and_its_deviation() -> None:
    """Heights scattered about the body's; a third of the points from a ceiling fan does not matter."""
    rng, mount = np.random.default_rng(1), Pose(z=1.4, tilt=-0.3)
    finder = TiltFinder(TiltConfig(), RadarInfo(frame_id="radar", mount=replace(mount, tilt=0.0)))
    for k in range(300):
        place = np.column_stack([rng.uniform(2, 4, 6), rng.uniform(-1, 1, 6), HEIGHTS["walk"][0] + 0.3 * rng.standard_normal(6)])
        place[:2, 2] = 2.4 if k % 2 else place[:2, 2]
        finder.process(cloud_at(mount, place, k * 100_000_000))
    found = finder.result()
    assert found.tilt == pytest.approx(-0.3, abs=0.04)
    assert (found.mount.z, found.mount.tilt, found.given, found.seconds) == (1.4, found.tilt, 0.0, 30)
    assert found.std == pytest.approx(HEIGHTS["walk"][1] / found.distance, rel=0.2)  # what bodies differ by outweighs the rest
    assert found.notes() == []


@pytest.mark.parametrize(("height", "tilt"), [(1.2, 0.0), (2.2, -0.45), (0.8, 0.2)])
@pytest.mark.parametrize("activity", ["walk", "arms"])
def test_simulated_people_on_other_mounts(height: float, tilt: float, activity: str) -> None:
    """Two deviations, from a description that says no tilt; and well below what loses people."""
    walks = tuple(Action(walk=Walk(to=place, speed=1.0)) for place in PLACES)
    script = walks if activity == "walk" else tuple(Action(gesture=name) for name in ("push", "pull", "swipe_up", "rotate", "wave"))
    radar = SceneRadar(frame_id="radar", mount=Pose(z=height, tilt=tilt))
    scene = Scene(
        duration=10.0,
        seed=4,
        radars=(replace(radar, waveform=replace(radar.waveform, frame_interval=0.1)),),
        people=(Person(position=(2.5, 0.0), script=script),),
        effects=Effects(noise=NoiseConfig(noise_figure=15.0)),
        fidelity=Fidelity(model="separable"),
    )
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    finder = TiltFinder(TiltConfig(activity=activity), replace(simulator.info, mount=Pose(z=height)))
    for k in range(simulator.n_frames):
        finder.process(baseband.process(simulator.process(k).frame))
    found = finder.result()
    assert abs(found.tilt - tilt) < 2 * found.std < math.radians(8.0)


def test_what_stands_still_or_is_at_the_radar_is_not_looked_at() -> None:
    """Furniture and somebody's hand at the radar change nothing."""
    mount = Pose(z=1.2, tilt=0.1)
    finders = [TiltFinder(TiltConfig(), RadarInfo(frame_id="radar", mount=Pose(z=1.2))) for _ in range(2)]
    for k in range(100):
        body = cloud_at(mount, np.array([[2.5, 0.2, HEIGHTS["walk"][0]]]), k * 100_000_000)
        for finder in finders:
            finder.process(body)
        finders[1].process(cloud_at(mount, np.array([[3.0, 1.0, 2.3]] * 4), k * 100_000_000, speed=0.05))
        finders[1].process(cloud_at(mount, np.array([[0.4, 0.0, 1.5]] * 4), k * 100_000_000))
    assert finders[0].result().tilt == finders[1].result().tilt == pytest.approx(0.1, abs=1e-4)


def test_notes_say_what_to_look_at() -> None:
    """Too near, too short, and points at all heights."""
    rng, mount = np.random.default_rng(2), Pose(z=1.2)
    finder = TiltFinder(TiltConfig(), RadarInfo(frame_id="radar", mount=mount))
    for k in range(60):
        place = np.column_stack([rng.uniform(1.0, 1.2, 3), rng.uniform(-0.5, 0.5, 3), np.full(3, 0.3 + 1.5 * (k // 10 % 2))])
        finder.process(cloud_at(mount, place, k * 100_000_000))
    short, near, unsteady = "somebody moved for 6 s only", "less sure than 5 degrees", "let one person move alone"
    notes = "\n".join(finder.result().notes())
    assert all(text in notes for text in (short, near, unsteady)), notes


def test_what_cannot_be_found_is_refused() -> None:
    """No elevation, nobody who moves, another radar's cloud."""
    flat, empty = (TiltFinder(TiltConfig(), RadarInfo(frame_id="radar", mount=Pose(z=1.2))) for _ in range(2))
    for k in range(100):
        cloud = cloud_at(Pose(z=1.2), np.array([[2.5, 0.2, 0.8]]), k * 100_000_000)
        flat.process(replace(cloud, elevation=np.full(1, np.nan, np.float32), z=np.full(1, np.nan, np.float32)))
        empty.process(replace(cloud, radial_speed=np.zeros(1, np.float32)))
    with pytest.raises(DataError, match=r"radar: the radar measures no elevation.*measure it"):
        flat.result()
    with pytest.raises(DataError, match=r"somebody moves in 0 s only.*at least 5 s"):
        empty.result()
    with pytest.raises(DataError, match="each radar needs its own topics"):
        empty.process(replace(cloud, frame_id="other"))
