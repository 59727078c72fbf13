"""Effects against physics through the whole simulator: range to the fourth, migration, Doppler within a chirp, the mixed product."""

import math

import numpy as np
import pytest
from truths import a_scene, expected_cube, first_cube, point_scene

from radar_core import SPEED_OF_LIGHT, Pose, RadarInfo
from radar_sim import Effects, Fidelity, NoiseConfig, Simulator

INFO = RadarInfo(mount=Pose(z=0.0))
W = INFO.waveform
EXACT = Fidelity(model="exact")


def ranges_of(cube: np.ndarray, chirps: slice) -> float:
    """Range of the strongest echo [m] over some chirps of the first channel, interpolated on a spectrum padded 64 times."""
    n = 64 * W.n_sample
    power = (np.abs(np.fft.fft(cube[0, chirps, 0] * np.hanning(W.n_sample), n)) ** 2).sum(0)
    return float(np.argmax(power)) / 64 * W.range_resolution


def test_signal_to_noise_falls_with_the_fourth_power_of_range():
    """From 1 to 6 m: matched-filter output of noisy frames over k T F B, against (2.4), within 0.2 dB.

    The output's standard deviation is sqrt(2 / SNR), 0.02 dB at the lowest of 43 dB here with 20 frames.
    """
    noise, gain = NoiseConfig(noise_figure=12.0), []
    floor = 50 * 1.380649e-23 * 290 * W.n_sample / W.chirp_duration * 10**1.2
    distances = np.array([1.0, 1.5, 2.3, 3.6, 5.9])
    for distance in distances.tolist():
        scene = point_scene((distance, 0.0, 0.0), rcs=0.1, radar=INFO, effects=Effects(noise=noise))
        clean = first_cube(point_scene((distance, 0.0, 0.0), rcs=0.1, radar=INFO)).astype(np.complex128)
        clean /= np.linalg.norm(clean)
        simulator = Simulator(scene)
        output = np.mean([np.vdot(clean, simulator.process(k).frame.cube) for k in range(20)])
        gain.append(10 * math.log10(abs(output) ** 2 / floor))
    transmitted = 1e-3 * 10**1.2 * 10**2.0 * W.wavelength**2 * 0.1 / (4 * math.pi) ** 3
    wanted = 10 * np.log10(50 * transmitted / distances**4 * np.prod(INFO.cube_shape) / floor)
    np.testing.assert_allclose(gain, wanted, atol=0.2)


@pytest.mark.parametrize("speed", [-4.0, 2.0, 4.0])
def test_migration_moves_a_target_across_bins(speed):
    """From the first eight chirps to the last eight a target moves by speed x time, 0.52 bins at 4 m/s; without the effect by nothing.

    Grid and window leave 2 mm; the effect `doppler_in_chirp` would shift both ends alike.
    """
    first, last = slice(0, 8), slice(-8, None)
    way = speed * (W.n_chirp - 8) * W.slow_interval
    for named, wanted in ((True, way), (False, 0.0)):
        effects = Effects(range_migration=named)
        cube = first_cube(point_scene((3.0, 0.0, 0.0), (speed, 0.0, 0.0), radar=INFO, effects=effects, fidelity=EXACT))
        assert ranges_of(cube, last) - ranges_of(cube, first) == pytest.approx(wanted, abs=0.002)


def test_doppler_within_a_chirp_shifts_the_beat():
    """By 2 v f_c / c: 3.4 mm of range per m/s."""
    cubes = [
        first_cube(point_scene((3.0, 0.0, 0.0), (4.0, 0.0, 0.0), radar=INFO, effects=Effects(doppler_in_chirp=named)))
        for named in (False, True)
    ]
    plain, shifted = (ranges_of(cube, slice(None)) for cube in cubes)
    beat = 2 * 4.0 * W.carrier / SPEED_OF_LIGHT
    assert shifted - plain == pytest.approx(beat / W.slope * SPEED_OF_LIGHT / 2, abs=0.002)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (3.0, 0.5, -0.4)])
def test_reference_is_the_mixed_product(velocity):
    """Through the scene: phases of the reference equal the product of (2.9) and the conjugate of (2.10) to the rounding of complex64."""
    effects = Effects(range_migration=True, doppler_in_chirp=True, squint=True, curvature=True, near_field=True)
    scene = point_scene((2.0, 0.6, -0.3), velocity, radar=INFO, effects=effects, fidelity=Fidelity(model="reference"))
    cube = first_cube(scene).astype(np.complex128)
    # A point moves on a straight line: its parabola is exact, so what remains is 2^-24 of the amplitude, and the phase's own rounding.
    expected = expected_cube(INFO, (2.0, 0.6, -0.3), velocity, 1.0)
    assert np.abs(np.angle(cube * expected.conj())).max() < 1e-6


def test_no_echo_no_signal():
    assert not first_cube(a_scene(INFO)).any()
