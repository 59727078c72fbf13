"""Against references of fifty digits (mpmath): where numbers cancel, underflow or grow, how many digits are left is stated and held."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf
from oracles import tracking as oracle

from radar_core import AntennaArray, RadarInfo, Waveform
from radar_core.geometry import cartesian_to_spherical
from radar_core.linalg import solve_spd
from radar_dsp.thresholds import ca_factor
from radar_gestures.classifiers.perceptron import GestureModel
from radar_lab.training.calibration import log_loss, soften
from radar_sim.propagation.base import Physics, Sampling
from radar_sim.propagation.reference import Reference
from radar_sim.scatterers import THING, Echoes, Motion
from radar_tracking.estimators import from_polar
from radar_tracking.estimators.kernels import correct, nis_and_log_det
from radar_tracking.estimators.multiple import _Chain, mixture, reweigh
from radar_tracking.estimators.turn import arc, bend, lag, turn_moments
from radar_tracking.metrics import chi_square_band

EPS = np.finfo(np.float64).eps
calm = settings(max_examples=60, deadline=None)


@pytest.fixture(autouse=True)
def fifty_digits():
    """And the old number of digits afterwards."""
    with mp.workdps(50):
        yield


def big(array: np.ndarray) -> mpmath.matrix:
    """The very numbers of an array, as a matrix."""
    rows = np.atleast_2d(np.asarray(array, np.float64))
    return mpmath.matrix([[mpf(float(x)) for x in row] for row in rows])


def small(matrix: mpmath.matrix) -> np.ndarray:
    """Rounded once."""
    return np.array([[float(matrix[i, j]) for j in range(matrix.cols)] for i in range(matrix.rows)])


coordinate = st.floats(-1e300, 1e300).filter(lambda x: x == 0 or abs(x) > 1e-300)


@calm
@given(coordinate, coordinate, coordinate)
def test_ranges_and_angles_of_any_place(x, y, z):
    """Squares of 1e300 m and of 1e-300 m would overflow and vanish; `hypot` keeps them: 4 units in the last place."""
    x, y, z = x + 0.0, y + 0.0, z + 0.0  # at zero a sign decides between two angles, of which none means anything
    r, azimuth, elevation = cartesian_to_spherical(np.array([x, y, z]))
    flat = mpmath.sqrt(mpf(x) ** 2 + mpf(y) ** 2)
    expected = (mpmath.sqrt(flat**2 + mpf(z) ** 2), mpmath.atan2(mpf(y), mpf(x)), mpmath.atan2(mpf(z), flat))
    for found, exact in zip((r, azimuth, elevation), expected, strict=True):
        assert abs(mpf(float(found)) - exact) <= 4 * EPS * abs(exact) + mpf("1e-320")


@pytest.mark.parametrize("n", [2, 4, 6])
@pytest.mark.parametrize("units", [0.0, 6.0, 12.0])
def test_solving_hilbert_s_matrices(n, units):
    """The classic of bad condition, up to 1.5e7, rows in units 10^±units apart: an error of condition times rounding, in any unit."""
    hilbert = np.array([[1 / (i + j + 1) for j in range(n)] for i in range(n)])
    scale = 10 ** np.linspace(-units, units, n)
    matrix, rhs = hilbert * np.outer(scale, scale), scale[:, None] * np.arange(1, n + 1)[:, None]
    exact = small(mpmath.lu_solve(big(matrix), big(rhs)))
    balance = 1 / np.sqrt(np.diagonal(hilbert))
    condition = np.linalg.cond(hilbert * np.outer(balance, balance))
    found = solve_spd(matrix, rhs) * scale[:, None]  # in one unit
    assert np.abs(found - exact * scale[:, None]).max() < 10 * n * condition * EPS * np.abs(exact * scale[:, None]).max()


def kalman(mean, P, residual, H, R):
    """Textbook update in fifty digits: mean, covariance, NIS, log determinant."""
    P, H, y = big(P), big(H), big(residual[:, None])
    S = H * P * H.T + big(R)
    inverse = S**-1
    K = P * H.T * inverse
    updated = (mpmath.eye(len(mean)) - K * H) * P
    nis = (y.T * inverse * y)[0]
    return small(big(mean[:, None]) + K * y)[:, 0], small(updated), float(nis), float(mpmath.log(mpmath.det(S)))


@calm
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([0.0, 3.0, 6.0]), sure=st.sampled_from([1.0, 1e-4, 1e-8]))
def test_kalman_updates(seed, spread, sure):
    """Joseph's form by solving, compiled and in numpy: metres beside microradians, measurements far surer than the prediction.

    The covariance shrinks by ``sure``^2 to 1e-16 of itself, where P - K H P has no digit left; Joseph's keeps each entry, measured against
    the geometric mean of its diagonal entries, to 1e-16 / ``sure`` of it, times a hundred for four states of random matrices.
    """
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-spread, spread, 4)
    root = rng.normal(size=(4, 4))
    P = (root @ root.T + 0.1 * np.eye(4)) * np.outer(scale, scale)
    H = np.eye(2, 4)
    R = sure**2 * np.diag(np.diagonal(P)[:2])
    mean, residual = rng.normal(size=4) * scale, rng.normal(size=2) * scale[:2]
    expected = kalman(mean, P, residual, H, R)
    args = (mean[None], P[None], residual[None], H[None], R[None], np.ones((1, 2), bool))
    for found in (correct(*args), oracle.correct(*args)):
        size = np.sqrt(np.diagonal(expected[1]))
        assert np.abs((found.covariance[0] - expected[1]) / np.outer(size, size)).max() < 100 * EPS / sure
        assert np.abs((found.mean[0] - expected[0]) / scale).max() < 1e-12
        assert found.nis[0] == pytest.approx(expected[2], rel=1e-11)
        assert found.log_det[0] == pytest.approx(expected[3], abs=1e-11)


@pytest.mark.parametrize("size", [1e-150, 1e-80, 1.0, 1e80, 1e150])
def test_logarithms_of_determinants_that_underflow(size):
    """A product of three such variances is no float; the sum of their logarithms is, to 12 digits."""
    S = size * np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
    residual = math.sqrt(size) * np.array([1.0, -2.0, 0.5])
    nis, log_det = nis_and_log_det(residual[None], S[None])
    assert log_det[0] == pytest.approx(float(mpmath.log(mpmath.det(big(S)))), rel=1e-12, abs=1e-12)
    y = big(residual[:, None])
    assert nis[0] == pytest.approx(float((y.T * big(S) ** -1 * y)[0]), rel=1e-12)


@pytest.mark.parametrize("prior", [0.5, 1e-10, 1e-300])
@pytest.mark.parametrize("apart", [0.0, 1.0, 700.0, 1e5, -1e5])
@pytest.mark.parametrize("level", [0.0, -1e6, 1e6])
def test_probabilities_of_modes_down_to_1e_300(prior, apart, level):
    """Likelihoods of exp(-1e6) are zero as floats and exp(1e6) infinite: weights and their sum come right from logarithms."""
    weight = np.array([[prior, 1.0 - prior]])
    score = np.array([[level + apart, level]])
    least = 1e-6
    parts = [mpf(prior) * mpmath.exp(mpf(level + apart)), (1 - mpf(prior)) * mpmath.exp(mpf(level))]
    raised = [max(part / sum(parts), mpf(least)) for part in parts]
    found, total = reweigh(weight, score, least)
    for k in range(2):
        # the logarithm of the weight is exact to rounding of numbers as large as the scores: 1e6 eps
        assert found[0, k] == pytest.approx(float(raised[k] / sum(raised)), rel=1e-9, abs=1e-15)
    assert total[0] == pytest.approx(float(mpmath.log(sum(parts))), rel=1e-14, abs=1e-12)
    assert (found > 0).all()


@pytest.mark.parametrize("dt", [0.0, 1e-12, 1e-3, 1.0, 1e3, 1e9])
def test_a_chain_s_probabilities(dt):
    """The exponential of the generator: rows sum to one, nothing is negative, digits are kept where it is nearly the unit matrix."""
    times = (0.5, 2.0, 30.0)
    generator = mpmath.matrix(3)
    for i in range(3):
        for j in range(3):
            generator[i, j] = -1 / mpf(times[i]) if i == j else 1 / mpf(times[i]) / 2
    found = _Chain(times, 3).transition(dt)
    if dt <= 1e3:
        np.testing.assert_allclose(found, small(mpmath.expm(generator * mpf(dt))), rtol=1e-12, atol=1e-15)
    else:
        np.testing.assert_allclose(found, np.tile(np.array(times) / sum(times), (3, 1)), rtol=1e-12)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-15)
    assert (found >= 0).all()


@pytest.mark.parametrize("apart", [1e-9, 1.0, 1e6])
def test_mixtures_far_from_the_origin(apart):
    """Two modes ``apart`` from each other, 1e9 m away: the spread between them is of differences, not of squares of 1e9."""
    mean = np.array([[[1e9, -1e9], [1e9 + apart, -1e9]]])
    covariance = np.tile(1e-4 * np.eye(2), (1, 2, 1, 1))
    share = np.array([[[0.25, 0.75]]])
    step = float(mean[0, 1, 0] - mean[0, 0, 0])  # as float64 resolves it: 1e-7 m
    found = mixture(mean, covariance, share)
    assert found[1][0, 0, 0, 0] == pytest.approx(1e-4 + 0.25 * 0.75 * step**2, rel=1e-12)
    assert found[1][0, 0, 1, 1] == pytest.approx(1e-4, rel=1e-12)


ANGLES = [0.0, 1e-300, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 1.999, 2.001, 3.14159, 10.0, 1e3]


@pytest.mark.parametrize("angle", [sign * a for a in ANGLES for sign in (1, -1)])
def test_integrals_along_an_arc(angle):
    """(sin a - a) / a^3 has no digit left at 1e-5 as it stands; series and closed forms keep 12 wherever they meet (at 2 rad).

    Turns of 1e3 rad lose three digits to the sine's argument.
    """
    a, loss = mpf(angle), max(1.0, abs(angle))
    with mp.workdps(1000 if abs(angle) < 1e-9 else 60):
        exact_lag = (mpmath.sin(a) - a) / a**3 if a else mpf(-1) / 6
        exact_bend = (1 - 1j * a - mpmath.exp(-1j * a)) / a**2 if a else mpmath.mpc(0.5)
        way = (mpmath.exp(1j * a) - 1) / (1j * a) if a else mpmath.mpc(1)
    assert float(lag(np.array(angle))) == pytest.approx(float(exact_lag), rel=1e-12 * loss)
    assert abs(complex(bend(np.array(angle))) - complex(exact_bend)) < 1e-13 * loss
    turned, carried = arc(np.array(angle), 1.0)
    assert abs(complex(turned) - complex(mpmath.exp(1j * a))) < 1e-13 * loss
    assert abs(complex(carried) - complex(way)) < 1e-13 * loss


@pytest.mark.parametrize("angle", [0.0, 1e-8, 0.3, 1.999, 2.001, 7.0])
def test_moments_of_turn_noise(angle):
    """Against the integrals themselves, by quadrature: 1e-11 of the largest entry, and positive semidefinite to that."""
    dt, a = mpf("0.5"), mpf(angle)

    def effect(s):
        way = (
            [s**2 * (a * s - mpmath.sin(a * s)) / (a * s) ** 2, s**2 * (1 - mpmath.cos(a * s)) / (a * s) ** 2] if a and s else [0, s**2 / 2]
        )
        return [way[0] * dt**2, way[1] * dt**2, 0, s * dt, 1]

    found = turn_moments(np.array([angle]), 0.5)[0]
    exact = np.array(
        [[float(dt * mpmath.quad(lambda s, i=i, j=j: effect(s)[i] * effect(s)[j], [0, 1])) for j in range(5)] for i in range(5)]
    )
    np.testing.assert_allclose(found, exact, atol=1e-11)
    assert np.linalg.eigvalsh(found).min() > -1e-15


@pytest.mark.parametrize("std", [1e-9, 1e-6, 1e-3, 0.1, 0.8])
def test_covariances_of_converted_measurements(std):
    """Noise of 1e-9 rad: means of cosines differ from one by 5e-19, and still every entry has nine digits.

    The reference is the covariance of the place given the measurement by its definition, E[x x'] - E[x] E[x]', plus the offset squared.
    """
    r, azimuth, spread_r = 5.0, 0.7, 0.03
    found = from_polar(r, azimuth, range_std=spread_r, azimuth_std=std)
    v, s2, rr, az = mpf(std) ** 2, mpf(spread_r) ** 2, mpf(r), mpf(azimuth)
    shrink = mpmath.exp(-v / 2)
    cos2, sin2 = (1 + mpmath.exp(-2 * v)) / 2, (1 - mpmath.exp(-2 * v)) / 2
    along = (rr**2 + s2) * cos2 - (rr * shrink) ** 2
    across = (rr**2 + s2) * sin2
    place = rr / shrink
    along += (place - rr * shrink) ** 2
    c, s = mpmath.cos(az), mpmath.sin(az)
    exact = np.array(
        [
            [float(along * c**2 + across * s**2), float((along - across) * s * c)],
            [float((along - across) * s * c), float(along * s**2 + across * c**2)],
        ]
    )
    # off the diagonal the rotation subtracts what is nearly equal: absolute there
    np.testing.assert_allclose(found.covariance[0], exact, rtol=1e-9, atol=1e-12 * float(along + across))
    np.testing.assert_allclose(found.position[0], [float(place * c), float(place * s)], rtol=1e-14)
    # the direction across is worth the most care: nothing of the range's error may leak into it
    turn = np.array([-math.sin(azimuth), math.cos(azimuth)])
    assert turn @ found.covariance[0] @ turn == pytest.approx(float(across), rel=1e-6 if std > 1e-8 else 0.1, abs=0.0)


@pytest.mark.parametrize("false_alarm", [1e-2, 1e-6, 1e-12])
@pytest.mark.parametrize("n", [1, 8, 64])
@pytest.mark.parametrize("cells", [4.0, 24.0, 24.7])
def test_thresholds_of_averages(false_alarm, n, cells):
    """The factor put into the tail of the F distribution gives the probability that was asked for, to eight digits, down to 1e-12."""
    factor = float(ca_factor(false_alarm, np.array([cells]), n)[0])
    x = mpf(cells) / (mpf(cells) + mpf(factor))
    tail = mpmath.betainc(n * mpf(cells), n, 0, x, regularized=True)
    assert float(tail) == pytest.approx(false_alarm, rel=1e-8, abs=0.0)


@pytest.mark.parametrize("dof", [1, 7, 1000])
def test_bands_of_chi_square(dof):
    """Both ends, put into the distribution, give the tail that was asked for."""
    low, high = chi_square_band(float(dof), 0.999)
    assert float(mpmath.gammainc(mpf(dof) / 2, 0, mpf(float(low)) * dof / 2, regularized=True)) == pytest.approx(0.0005, rel=1e-7)
    assert float(mpmath.gammainc(mpf(dof) / 2, mpf(float(high)) * dof / 2, mpmath.inf, regularized=True)) == pytest.approx(0.0005, rel=1e-7)


@pytest.mark.parametrize("size", [1e-8, 1.0, 30.0, 800.0, 1e30])
def test_softmax_of_any_scores(size):
    """exp(800) is no float; differences of scores are: probabilities to 12 digits, those below 1e-308 zero, the sum one."""
    weights = (np.array([[1.0, 0.5, -1.0]], np.float32) * np.float32(size),)
    model = GestureModel(np.zeros(1), np.ones(1), weights, (np.zeros(3),), labels=("a", "b", "c"), names=("x",))
    scores = [mpf(float(w)) for w in weights[0][0]]
    parts = [mpmath.exp(s - max(scores)) for s in scores]
    for found in (model.probabilities(np.ones(1)), model.probabilities_numpy(np.ones((1, 1)))[0]):
        for k in range(3):
            assert found[k] == pytest.approx(float(parts[k] / sum(parts)), rel=1e-12 * max(1.0, min(size, 1e3)), abs=1e-300)
        assert found.sum() == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("p", [0.0, 5e-324, 1e-300, 1e-13, 0.3])
@pytest.mark.parametrize("temperature", [0.05, 1.0, 20.0])
def test_softened_probabilities_that_underflow(p, temperature):
    """Zero has no logarithm: below 1e-12 all count as 1e-12, and the loss of such a label is that of 1e-12."""
    found = soften(np.array([p, 1 - p]), temperature)
    parts = [mpmath.power(max(mpf(q), mpf("1e-12")), 1 / mpf(temperature)) for q in (p, 1 - p)]
    np.testing.assert_allclose(found, [float(part / sum(parts)) for part in parts], rtol=1e-11, atol=1e-300)
    assert log_loss(np.array([[p, 1 - p]]), np.array([0])) == pytest.approx(-math.log(max(p, 1e-12)), rel=1e-12)


@pytest.mark.parametrize(("distance", "speed"), [(0.1, 0.0), (3.0, -2.0), (500.0, 900.0), (5e3, 0.0)])
def test_phases_of_echoes(distance, speed):
    """Two and a half million turns of a phase: float64 keeps 1e-9 of one; the model's formula in fifty digits is the judge."""
    info = RadarInfo(
        waveform=Waveform(n_tx=1, n_chirp=3, n_sample=4, frame_interval=0.1), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),))
    )
    w = info.waveform
    sampling = Sampling(info, np.zeros((1, 2)), np.zeros((1, 2)))
    motion = Motion(np.array([[distance, 0.0, 0.0]]), np.array([[speed, 0.0, 0.0]]), np.zeros((1, 3)))
    number = np.full(1, THING, np.int32)
    cube = Reference(Physics.all(), sampling).sums(Echoes(motion, motion, np.array([1.0 + 0j]), number, number))
    c = mpf(299_792_458)
    for chirp in range(3):
        for s in range(4):
            fast = mpf(s) * mpf(w.chirp_duration) / 4
            time = chirp * mpf(w.chirp_interval) + fast - mpf(w.acquisition_time) / 2
            delay = 2 * (mpf(distance) + mpf(speed) * time) / c
            turns = (mpf(w.carrier) - mpf(w.bandwidth) / 2) * delay + mpf(w.slope) * delay * (fast - delay / 2)
            assert abs(np.angle(complex(cube[0, chirp, 0, s]) / complex(mpmath.exp(2j * mpmath.pi * (turns % 1))))) < 2e-8
