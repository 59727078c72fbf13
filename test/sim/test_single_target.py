"""The conventions, each pinned with one simulated point target."""

import dataclasses
import math

import numpy as np
import pytest
from truths import ALL_PHYSICS, a_scene, expected_cube, first_cube, peak, point_scene

from radar_core import Pose, RadarInfo, Waveform
from radar_core.geometry import spherical_to_cartesian
from radar_sim import Effects, Fidelity, NoiseConfig, Point, Simulator

INFO = RadarInfo(mount=Pose(z=0.0))
W = INFO.waveform
PHYSICAL = Effects(**ALL_PHYSICS)


def amplitude(distance: float, rcs: float) -> float:
    """Radar equation (2.4), volts at 50 ohm."""
    transmitted, gain = 1e-3 * 10 ** (12 / 10), 10 ** (10 / 10)
    return math.sqrt(50 * transmitted * gain**2 * W.wavelength**2 * rcs / ((4 * math.pi) ** 3 * distance**4))


@pytest.mark.parametrize("distance", [0.8, 2.5, 5.9])
def test_range(distance):
    """A still target beats at its range; 1/8 bin of padding leaves 7 mm, the carrier's phase and Doppler nothing."""
    found, speed = peak(first_cube(point_scene((distance, 0.0, 0.0), radar=INFO)), INFO)
    assert found == pytest.approx(distance, abs=0.0075)
    assert speed == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("rate", [-3.0, -0.8, 0.7, 3.5])
def test_receding_is_positive_doppler(rate):
    """Range rate, positive when receding; the beat moves by rate * (carrier / slope), 3.4 mm per m/s, to the far side."""
    scene = point_scene((3.0, 0.0, 0.0), (rate, 0.0, 0.0), radar=INFO, effects=Effects(doppler_in_chirp=True))
    found, speed = peak(first_cube(scene), INFO)
    assert speed == pytest.approx(rate, abs=W.speed_resolution / 12)
    middle = 3.0 + rate * W.acquisition_time / 2
    assert found == pytest.approx(middle + rate * W.carrier / W.slope, abs=0.0075)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.3), (0.0, -0.3), (0.35, -0.2)])
def test_left_and_up_are_positive(azimuth, elevation):
    """Each channel turns by the steering vector of the design: left and up are positive. Near field at 4 m is below 2e-3 rad."""
    x, y, z = spherical_to_cartesian(4.0, azimuth, elevation)
    cube = first_cube(point_scene((x, y, z), radar=INFO))
    channels = cube.mean(axis=1).transpose(0, 1, 2).reshape(INFO.array.n_tx * INFO.array.n_rx, -1)
    turn = (channels * channels[0].conj()).sum(-1)
    expected = INFO.array.steering(azimuth, elevation, W.wavelength)
    np.testing.assert_allclose(turn / abs(turn), expected / expected[0], atol=5e-3)


def test_room_directions_with_a_turned_and_tilted_mount():
    """The scene lives in the room: a target straight along a yawed and tilted boresight is at azimuth and elevation zero."""
    mount = Pose(x=0.5, y=-0.3, z=1.4, yaw=0.4, tilt=-0.2)
    info = dataclasses.replace(INFO, mount=mount)
    place = mount.to_room(np.array([3.0, 0.0, 0.0]))
    cube = first_cube(point_scene(tuple(place.tolist()), radar=info))
    np.testing.assert_allclose(cube, first_cube(point_scene((3.0, 0.0, 0.0), radar=INFO)), atol=2e-5 * np.abs(cube).max())


def test_transmitters_take_turns():
    """Chirp l of transmitter t starts (l n_tx + t) chirp_interval after the stamp: the second one sees the target moved on."""
    rate = 1.7
    cube = first_cube(point_scene((3.0, 0.0, 0.0), (rate, 0.0, 0.0), radar=INFO))
    turn = np.angle((cube[1] * cube[0].conj()).sum())  # on the boresight, so that the array itself turns nothing
    assert turn == pytest.approx(2 * math.pi * 2 * rate * W.chirp_interval / W.wavelength, abs=1e-3)


def test_frames_follow_each_other():
    """Frame k starts at k frame_interval, and its stamp says so to the nanosecond; the truth is stamped at the middle."""
    simulator = Simulator(point_scene((2.0, 0.0, 0.0), (1.0, 0.0, 0.0), radar=INFO, effects=Effects(doppler_in_chirp=True)))
    assert simulator.n_frames == 50
    frame, truth = (lambda s: (s.frame, s.truth))(simulator.process(37))
    assert frame.stamp_ns == 37 * 20_000_000
    assert truth.stamp_ns == frame.stamp_ns + W.acquisition_ns // 2
    assert (frame.sequence, truth.sequence, frame.frame_id, truth.frame_id) == (37, 37, "radar", "room")
    frame.check(simulator.info)
    assert peak(frame.cube, INFO)[0] == pytest.approx(2.0 + 0.74 + W.acquisition_time / 2 + W.carrier / W.slope, abs=0.0075)


@pytest.mark.parametrize("model", ["separable", "nufft", "blocks", "exact", "reference"])
@pytest.mark.parametrize(("distance", "rcs"), [(1.0, 0.03), (4.0, 0.4)])
def test_amplitude_obeys_the_radar_equation(model, distance, rcs):
    """Volts at 50 ohm by (2.4); complex64 keeps 7 digits, the aperture of 14 mm changes 1/r^2 by less than 1e-4 at 1 m."""
    cube = first_cube(point_scene((distance, 0.0, 0.0), rcs=rcs, radar=INFO, fidelity=Fidelity(model=model)))
    np.testing.assert_allclose(np.abs(cube), amplitude(distance, rcs), rtol=2e-4)


def test_thermal_noise_is_ktfb():
    """Mean power of 65,536 complex samples is k T F B within five standard deviations (2 %), and white across chirps and samples."""
    scene = a_scene(INFO, effects=Effects(noise=NoiseConfig(noise_figure=13.0)))
    simulator = Simulator(scene)
    cubes = np.stack([simulator.process(k).frame.cube for k in range(2)]).astype(np.complex128)
    wanted = 1.380649e-23 * 290 * (W.n_sample / W.chirp_duration) * 10**1.3 * 50
    assert np.mean(np.abs(cubes) ** 2) == pytest.approx(wanted, rel=0.02)
    assert np.mean(cubes.real**2) == pytest.approx(wanted / 2, rel=0.03)
    assert abs(np.mean(cubes**2)) < 0.02 * wanted  # circular
    assert abs(np.mean(cubes[..., 1:] * cubes[..., :-1].conj())) < 0.02 * wanted
    assert abs(np.mean(cubes[0] * cubes[1].conj())) < 0.03 * wanted  # frames are independent


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (2.0, 1.0, -0.5)])
def test_exact_model_is_the_formula(velocity):
    """The exact model against the phase written out for every sample and channel; complex64 rounds at 1e-7, chords of the path at 1e-5."""
    position = (1.4, 0.6, -0.3)
    cube = first_cube(point_scene(position, velocity, radar=INFO, effects=PHYSICAL, fidelity=Fidelity(model="exact")))
    expected = expected_cube(INFO, position, velocity, 1.0)
    middle = np.asarray(position) + np.asarray(velocity) * W.acquisition_time / 2
    turned = cube / np.abs(cube)
    np.testing.assert_allclose(turned, expected, atol=5e-4)
    assert np.abs(cube).mean() == pytest.approx(amplitude(float(np.linalg.norm(middle)), 0.1), rel=1e-2)


def rms_error(cube: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt((np.abs(cube - reference) ** 2).sum() / (np.abs(reference) ** 2).sum()))


def test_models_agree_where_they_should():
    """Without physics all models are one; with everything, what the cheapest leaves out shows, and blocks bring most of it back."""
    still, moving = ((3.0, 0.4, 0.2), (0.0, 0.0, 0.0)), ((3.0, 0.4, 0.2), (2.0, 0.5, 0.0))

    def cube(target, effects, model, **more):
        return first_cube(point_scene(*target, radar=INFO, effects=effects, fidelity=Fidelity(model=model, **more)))

    for target in (still, moving):
        truth = cube(target, Effects(), "reference")
        for model in ("separable", "nufft", "exact"):
            assert rms_error(cube(target, Effects(), model), truth) < 1e-3
        truth = cube(target, PHYSICAL, "reference")
        errors = [rms_error(cube(target, PHYSICAL, "blocks", blocks=n, order=1), truth) for n in (1, 4, 16)]
        assert rms_error(cube(target, PHYSICAL, "exact"), truth) < 1e-3
        # Squint: 7.8 mm of aperture over a 0.1 m bin turns by up to +-0.1 rad at the band edges; near field: y^2 / (lambda r), 0.02 rad.
        assert rms_error(cube(target, Effects(), "separable"), truth) < (0.08 if target is still else 0.4)
        assert errors[2] <= errors[1] * 1.1 <= errors[0] * 1.21
        assert errors[1] < 0.02


def test_other_waveforms_and_arrays():
    """Nothing is tied to the default radar: three transmitters, two receivers, odd sizes."""
    info = RadarInfo(
        mount=Pose(z=0.0),
        waveform=Waveform(n_tx=3, n_chirp=31, n_sample=50, carrier=60e9, bandwidth=2e9, frame_interval=0.05),
        array=dataclasses.replace(INFO.array, tx=((0.0, 0.0), (0.004, 0.0), (0.0, 0.004)), rx=((0.0, 0.0), (0.002, 0.0))),
    )
    cube = first_cube(point_scene((2.0, 0.3, 0.1), (0.5, 0.0, 0.0), radar=info))
    expected = expected_cube(info, (2.0, 0.3, 0.1), (0.5, 0.0, 0.0), float(np.abs(cube).mean()))
    assert cube.shape == (3, 31, 2, 50)
    assert rms_error(cube, expected) < 0.15


def test_targets_add():
    """Two targets give the sum of their echoes."""
    one, two = ((2.0, 0.5, 0.0), (1.0, 0.0, 0.0)), ((3.5, -0.5, 0.3), (-1.5, 0.2, 0.0))
    points = tuple(Point(position=p, velocity=v) for p, v in (one, two))
    both = first_cube(a_scene(INFO, points=points))
    parts = [first_cube(point_scene(p, v, radar=INFO)) for p, v in (one, two)]
    np.testing.assert_allclose(both, parts[0] + parts[1], atol=1e-5 * np.abs(both).max())
