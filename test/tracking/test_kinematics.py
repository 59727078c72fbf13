"""The models against matrix exponentials, numerical integration, and themselves cut into smaller steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from radar_core import ConfigError
from radar_tracking.estimators.kinematics import ConstantAcceleration, ConstantVelocity
from radar_tracking.estimators.multiple import Embedded
from radar_tracking.estimators.turn import CoordinatedTurn

MODELS = [
    ConstantVelocity((1.0, 2.0)),
    ConstantVelocity((1.0, 1.0, 1e-4)),
    ConstantAcceleration((3.0, 2.0)),
    ConstantAcceleration((1.0, 1.0, 1e-4)),
    CoordinatedTurn((1.0, 1.0), 0.3),
    CoordinatedTurn((0.5, 0.5, 1e-4), 0.8),
    Embedded(ConstantVelocity((1.0, 1.0)), (0, 1, 2, 3), (0, 0, 0, 0, 0.7)),
]


def van_loan(A: np.ndarray, G: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition matrix and process noise of dx = A x dt + noise of density G (Van Loan 1978)."""
    n = len(A)
    block = expm(np.block([[-A, G], [np.zeros((n, n)), A.T]]) * dt)
    F = block[n:, n:].T
    return F, F @ block[:n, n:]


def chain(model: ConstantVelocity | ConstantAcceleration) -> tuple[np.ndarray, np.ndarray]:
    """Continuous-time matrices of a chain of integrators."""
    d, n = model.dimensions, model.n_states
    A = np.diag(np.ones(n - d), d)
    G = np.zeros((n, n))
    G[-d:, -d:] = np.diag(model.density)
    return A, G


@pytest.mark.parametrize("model", MODELS[:4])
@pytest.mark.parametrize("dt", [0.0, 0.02, 0.7, 10.0])
def test_chains_are_the_matrix_exponential(model, dt):
    """Van Loan's integral, to rounding relative to the largest entry."""
    F, Q = van_loan(*chain(model), dt)
    mean = np.arange(model.n_states, dtype=float)[None]
    assert np.allclose(model.jacobian(mean, dt)[0], F, rtol=1e-12, atol=1e-12)
    assert np.allclose(model.noise(mean, dt)[0], Q, rtol=1e-11, atol=1e-12 * max(1.0, np.abs(Q).max()))
    assert np.allclose(model.move(mean, dt)[0], F @ mean[0], rtol=1e-12)


def turning(model: CoordinatedTurn, rate: float) -> np.ndarray:
    """The motion at a fixed turn rate as a linear system in (position, velocity)."""
    d = model.dimensions
    A = np.zeros((2 * d, 2 * d))
    A[:d, d:] = np.eye(d)
    A[d, d + 1], A[d + 1, d] = -rate, rate
    return A


@pytest.mark.parametrize("model", MODELS[4:6])
@pytest.mark.parametrize("rate", [0.0, 1e-9, 1e-4, -0.3, 2.0, -12.0])
@pytest.mark.parametrize("dt", [0.02, 0.5, 3.0])
def test_a_turn_is_the_matrix_exponential(model, rate, dt):
    """At a known turn rate the motion is linear: state, transition and acceleration noise are Van Loan's."""
    d = model.dimensions
    A = turning(model, rate)
    G = np.zeros((2 * d, 2 * d))
    G[d:, d:] = np.diag(model.density)
    F, Q = van_loan(A, G, dt)
    mean = np.array([[1.0, -2.0, 0.5][:d] + [1.5, 0.7, -0.2][:d] + [rate]])
    assert np.allclose(model.move(mean, dt)[0, :-1], F @ mean[0, :-1], atol=1e-12)
    assert np.allclose(model.jacobian(mean, dt)[0, :-1, :-1], F, atol=1e-12)
    quiet = CoordinatedTurn(model.density, 0.0)
    assert np.allclose(quiet.noise(mean, dt)[0, :-1, :-1], Q, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 1e-7, 0.3, -1.5, 2.5, 9.0])
@pytest.mark.parametrize("dt", [0.02, 0.7, 3.0])
def test_turn_noise_is_the_linearised_motion_integrated(rate, dt):
    """Seen from a frame that turns along, the linearised motion has constant matrices; Van Loan's integral of it is the truth."""
    model = CoordinatedTurn((0.0, 0.0), 0.6)
    vx, vy = 1.2, -0.4
    # states: position and velocity errors in the turning frame, then the turn rate's
    A = np.array([[0, rate, 1, 0, 0], [-rate, 0, 0, 1, 0], [0, 0, 0, 0, -vy], [0, 0, 0, 0, vx], [0, 0, 0, 0, 0.0]])
    G = np.diag([0, 0, 0, 0, 0.6])
    F, Q = van_loan(A, G, dt)
    c, s = np.cos(rate * dt), np.sin(rate * dt)
    turn = np.kron(np.eye(2), [[c, -s], [s, c]])
    back = np.zeros((5, 5))
    back[:4, :4], back[4, 4] = turn, 1.0
    mean = np.array([[0.3, 0.1, vx, vy, rate]])
    assert np.allclose(model.jacobian(mean, dt)[0], back @ F, rtol=1e-10, atol=1e-11)
    assert np.allclose(model.noise(mean, dt)[0], back @ Q @ back.T, rtol=1e-9, atol=1e-11 * max(1.0, np.abs(Q).max()))


@pytest.mark.parametrize("model", MODELS)
def test_the_jacobian_is_the_derivative(model):
    """Central differences: error of second order, 1e-8 at steps of 1e-5 for states of order one."""
    mean = np.random.default_rng(2).normal(size=(4, model.n_states))
    F = np.broadcast_to(model.jacobian(mean, 0.4), (4, model.n_states, model.n_states))
    for j in range(model.n_states):
        h = np.zeros(model.n_states)
        h[j] = 1e-5
        slope = (model.move(mean + h, 0.4) - model.move(mean - h, 0.4)) / 2e-5
        assert np.allclose(F[:, :, j], slope, atol=1e-8)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(MODELS),
    st.floats(0, 2),
    st.floats(0, 2),
    st.lists(st.floats(-2, 2), min_size=9, max_size=9),
)
def test_two_steps_are_one(model, dt1, dt2, state):
    """State, transition and noise of dt1 and then dt2 are those of dt1 + dt2 (rounding of entries up to 100)."""
    if isinstance(model, Embedded):
        return  # draws what it lacks anew at every step: see below
    mean = np.array([state[: model.n_states]])
    middle, end = model.move(mean, dt1), model.move(mean, dt1 + dt2)
    F1, F2 = model.jacobian(mean, dt1)[0], model.jacobian(middle, dt2)[0]
    Q1, Q2 = model.noise(mean, dt1)[0], model.noise(middle, dt2)[0]
    assert np.allclose(model.move(middle, dt2), end, atol=1e-11)
    assert np.allclose(F2 @ F1, model.jacobian(mean, dt1 + dt2)[0], atol=1e-10)
    Q = model.noise(mean, dt1 + dt2)[0]
    assert np.allclose(F2 @ Q1 @ F2.T + Q2, Q, atol=1e-11 * max(1.0, np.abs(Q).max()))
    assert np.linalg.eigvalsh(Q).min() > -1e-13 * max(1.0, np.abs(Q).max())


def test_a_circle():
    """A quarter turn at 1 rad/s and 2 m/s: radius 2 m, starting along x, ends at (2, 2) m moving along y."""
    model = CoordinatedTurn((1.0, 1.0, 0.1), 0.1)
    moved = model.move(np.array([[0.0, 0.0, 1.0, 2.0, 0.0, 0.5, 1.0]]), np.pi / 2)
    assert np.allclose(moved, [[2.0, 2.0, 1.0 + 0.25 * np.pi, 0.0, 2.0, 0.5, 1.0]], atol=1e-12)


def test_batch_equals_single():
    """Row by row, bit for bit."""
    mean = np.random.default_rng(3).normal(size=(7, 7))
    model = MODELS[5]
    for i in range(7):
        one = mean[i : i + 1]
        assert np.array_equal(model.move(mean, 0.3)[i], model.move(one, 0.3)[0])
        assert np.array_equal(model.jacobian(mean, 0.3)[i], model.jacobian(one, 0.3)[0])
        assert np.allclose(model.noise(mean, 0.3)[i], model.noise(one, 0.3)[0], rtol=1e-14, atol=1e-16)


def test_an_embedded_model_draws_what_it_lacks():
    """The states it has move as ever; the others are zero with the prior's variance, without correlation, after any step."""
    inner, model = ConstantVelocity((1.0, 1.0)), Embedded(ConstantVelocity((1.0, 1.0)), (0, 1, 2, 3), (9.0, 9.0, 9.0, 9.0, 0.7))
    mean = np.array([[1.0, 2.0, 3.0, 4.0, 5.0]])
    assert np.allclose(model.move(mean, 0.5), [[2.5, 4.0, 3.0, 4.0, 0.0]])
    full = model.jacobian(mean, 0.5)[0] @ np.ones((5, 5)) @ model.jacobian(mean, 0.5)[0].T + model.noise(mean, 0.5)[0]
    small = inner.jacobian(mean, 0.5)[0] @ np.ones((4, 4)) @ inner.jacobian(mean, 0.5)[0].T + inner.noise(mean, 0.5)[0]
    assert np.allclose(full[:4, :4], small)
    assert np.allclose(full[4], [0, 0, 0, 0, 0.49])
    assert model.dimensions == 2


@pytest.mark.parametrize(
    "make",
    [
        lambda: ConstantVelocity((1.0,)),
        lambda: ConstantAcceleration((1.0, -1.0)),
        lambda: ConstantVelocity((1.0, float("nan"))),
        lambda: CoordinatedTurn((1.0, 2.0), 0.1),
        lambda: CoordinatedTurn((1.0, 1.0), -0.1),
    ],
)
def test_impossible_noise_is_refused(make):
    """With an error that says what to give."""
    with pytest.raises(ConfigError):
        make()
