"""The filter against its textbook form, its own covariance, and the frame rate."""

import numpy as np

from radar_tracking.kalman import mahalanobis2, predict, update

H = np.hstack([np.eye(3), np.zeros((3, 3))])


def start() -> tuple[np.ndarray, np.ndarray]:
    """Some state with a full covariance."""
    a = np.random.default_rng(1).normal(size=(6, 6))
    return np.arange(6.0), a @ a.T + np.eye(6)


def test_update_is_the_textbook_one():
    """Joseph form and solve change rounding, not results (1e-12 relative to entries of order 10)."""
    mean, covariance = start()
    R = np.diag([0.01, 0.02, 0.5])
    z = np.array([0.3, 0.9, 2.5])
    gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
    new_mean, new_covariance = update(mean, covariance, z, R)
    assert np.allclose(new_mean, mean + gain @ (z - H @ mean), atol=1e-11)
    assert np.allclose(new_covariance, (np.eye(6) - gain @ H) @ covariance, atol=1e-11)


def test_prediction_does_not_depend_on_the_frame_rate():
    """One step of 0.2 s and ten of 0.02 s give the same state and the same covariance (rounding: 1e-12)."""
    mean, covariance = start()
    whole = predict(mean, covariance, 0.2, 1.3)
    for _ in range(10):
        mean, covariance = predict(mean, covariance, 0.02, 1.3)
    assert np.allclose(mean, whole[0], atol=1e-12)
    assert np.allclose(covariance, whole[1], atol=1e-12)


def test_stacks_equal_single_states():
    """Many tracks at once are what one after the other gives."""
    mean, covariance = start()
    means, covariances = np.stack([mean, mean + 1]), np.stack([covariance, 2 * covariance])
    z, R = np.ones((2, 3)), np.broadcast_to(np.eye(3), (2, 3, 3))
    both = update(*predict(means, covariances, 0.1, 1.0), z, R)
    for i in range(2):
        one = update(*predict(means[i], covariances[i], 0.1, 1.0), z[i], R[i])
        assert np.allclose(both[0][i], one[0], atol=1e-12)
        assert np.allclose(both[1][i], one[1], atol=1e-12)


def test_errors_agree_with_the_covariance():
    """Normalised squared error of a target that moves as the model says: its mean over 200 runs x 50 late steps is 6 (chi-squared).

    Steps of a run are correlated over about 10, so some 1000 independent samples: standard error sqrt(2 * 6 / 1000) = 0.11; 4 sigma = 0.44.
    """
    rng = np.random.default_rng(4)
    runs, dt, noise, sigma = 200, 0.05, 2.0, 0.1
    truth = np.zeros((runs, 6))
    truth[:, 3:] = rng.normal(0, 1, (runs, 3))
    mean, covariance = np.zeros((runs, 6)), np.tile(np.diag([1e-4] * 3 + [1.0] * 3), (runs, 1, 1))
    mean[:, :3] = rng.normal(0, 1e-2, (runs, 3))
    Q = predict(np.zeros(6), np.zeros((6, 6)), dt, noise)[1]
    root = np.linalg.cholesky(Q)
    nees = []
    for step in range(100):
        truth = predict(truth, np.zeros((runs, 6, 6)), dt, 0.0)[0] + rng.normal(size=(runs, 6)) @ root.T
        mean, covariance = predict(mean, covariance, dt, noise)
        z = truth[:, :3] + rng.normal(0, sigma, (runs, 3))
        mean, covariance = update(mean, covariance, z, np.broadcast_to(sigma**2 * np.eye(3), (runs, 3, 3)))
        if step >= 50:
            e = truth - mean
            nees.append(np.einsum("ni,ni->n", e, np.linalg.solve(covariance, e[..., None])[..., 0]).mean())
    assert abs(np.mean(nees) - 6) < 0.44


def test_mahalanobis_of_a_known_ellipse():
    """Variances 4 and 1: (2, 0) and (0, 1) are one standard deviation away."""
    d2 = mahalanobis2(np.zeros((1, 2)), np.diag([3.5, 0.5])[None], np.array([[2.0, 0.0], [0.0, 1.0], [2.0, 1.0]]), 0.5 * np.eye(2))
    assert np.allclose(d2, [[1.0, 1.0, 2.0]])
