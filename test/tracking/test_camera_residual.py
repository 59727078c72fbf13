"""Hand tracks against a reference with errors of its own: brought together in time, and the reference's share taken off."""

import json
import math

import numpy as np
import pytest

from radar_core import DataError
from radar_lab.camera.report import budget, collect, draw
from radar_lab.camera.residual import PARTS, HandResiduals, ReferenceSample, ResidualConfig, TrackSample

MS = 1_000_000
EXACT = ResidualConfig(acceleration=0.0)


def reference(ms, place, **more):
    return ReferenceSample(round(ms * MS), np.array(place, np.float64), **more)


def track(ms, place, name="hand", std=0.05):
    return TrackSample(name, round(ms * MS), np.array(place, np.float64), np.eye(3) * std**2)


def test_interpolation_in_closed_form():
    """A quarter of the way: fresh errors shrink to (0.75^2 + 0.25^2), common ones stay, the bend is added."""
    fresh, common = np.diag([1e-4, 2e-4, 3e-4]), np.eye(3) * 4e-4
    parts = np.sqrt([4e-4, 2e-4, 1e-4, 5e-4, 6e-4])
    given = {"covariance": fresh + common, "common": common, "part_std": parts}
    residuals = HandResiduals(ResidualConfig(acceleration=8.0))
    residuals.process(reference(0, (1, 0, 1), **given))
    assert residuals.process(track(10, (1.2, 0.0, 1.0))) == ()
    (found,) = residuals.process(reference(40, (1.4, 0.4, 1.0), **given))
    assert np.allclose(found.reference, (1.1, 0.1, 1.0))
    assert np.allclose(found.residual, (0.1, -0.1, 0.0))
    bend = 0.5 * 0.25 * 0.75 * 0.04**2 * 8.0
    assert np.allclose(found.covariance, 0.625 * fresh + common + np.eye(3) * bend**2 / 3)
    assert np.allclose(found.common, common)
    assert np.allclose(found.part_std**2, [0.625 * 4e-4, 0.625 * 2e-4, 1e-4, 5e-4, 6e-4, bend**2])
    assert len(PARTS) == 6


def test_any_order_of_arrival():
    """References that come before, between and after: the same residuals, each once."""
    rng = np.random.default_rng(0)
    refs = [reference(33 * k, (0.033 * k, 0.0, 1.0)) for k in range(40)]
    tracks = [track(7 + 20 * k, (0.0, 0.0, 1.0)) for k in range(60)]
    results = []
    for delay in (-200, 0, 33, 500):
        both = sorted(refs + tracks, key=lambda s: s.stamp_ns + (delay * MS if isinstance(s, ReferenceSample) else 0) + rng.random())
        residuals = HandResiduals(EXACT)
        found = [item for sample in both for item in residuals.process(sample)]
        results.append([(item.sample.stamp_ns, item.residual[0]) for item in found])
    assert all(result == results[0] for result in results)
    assert len(results[0]) == 60
    assert np.allclose([x for _, x in results[0]], [-1e-9 * stamp for stamp, _ in results[0]], atol=1e-12)


def test_gaps_are_not_bridged():
    """Between references 0.2 s apart there is none, but at their own stamps there is; before the first and after the last there is none."""
    residuals = HandResiduals(ResidualConfig(max_gap=0.15, wait=0.5))
    for ms in (0, 50, 100, 200, 300, 350):
        residuals.process(track(ms, (0, 0, 0)))
    found = [item.sample.stamp_ns // MS for ms in (60, 100, 300, 340) for item in residuals.process(reference(ms, (0, 0, 0)))]
    assert found == [100, 300]
    residuals.process(track(900, (0, 0, 0)))
    assert residuals.unmatched == 4, "0, 50 and 200; and 350, which has waited for more than 0.5 s"
    residuals.finish()
    assert residuals.unmatched == 5


def test_samples_in_the_wrong_order_are_refused():
    """Each source by itself; after a reset the recording may start again."""
    residuals = HandResiduals()
    residuals.process(track(20, (0, 0, 0)))
    residuals.process(track(10, (0, 0, 0), "other"))
    residuals.process(reference(5, (0, 0, 0)))
    with pytest.raises(DataError, match="track 'hand' is not newer"):
        residuals.process(track(20, (0, 0, 0)))
    with pytest.raises(DataError, match="the reference is not newer"):
        residuals.process(reference(4, (0, 0, 0)))
    residuals.reset()
    residuals.process(reference(4, (0, 0, 0)))


def session(rng, radar=0.03, fresh=0.01, common=0.02, seconds=30.0, lag=0.0, bias=0.0):
    """A hand on a circle; a radar whose errors hang together for 0.2 s; a reference that is wrong by a constant, and anew each time.

    Returns the series, and the true rms of the radar's errors.
    """
    covariance = np.eye(3) * (fresh**2 + common**2)
    given = {
        "covariance": covariance,
        "common": np.eye(3) * common**2,
        "part_std": np.array([fresh * math.sqrt(3), 0, 0, 0, common * math.sqrt(3)]),
    }
    offset = rng.normal(0.0, common, 3)

    def hand(t):
        return np.array([1.5, 0.25 * math.cos(3 * t), 1.2 + 0.25 * math.sin(3 * t)])

    samples = [reference(1e3 * t, hand(t) + offset + rng.normal(0.0, fresh, 3), **given) for t in np.arange(0.0, seconds, 0.033)]
    error, keep, errors = rng.normal(0.0, radar, 3), math.exp(-0.02 / 0.2), []
    for t in np.arange(0.05, seconds - 0.1, 0.02):
        error = keep * error + math.sqrt(1 - keep**2) * rng.normal(0.0, radar, 3)
        samples.append(track(1e3 * t, hand(t - lag) + error + bias))
        errors.append(error + bias + hand(t - lag) - hand(t))
    residuals = HandResiduals(ResidualConfig(acceleration=2.0))
    found = [item for sample in sorted(samples, key=lambda s: s.stamp_ns) for item in residuals.process(sample)]
    return collect(found)["hand"], math.sqrt(float((np.array(errors) ** 2).sum(-1).mean()))


SETTINGS = ResidualConfig(resamples=300)


def test_the_references_errors_are_taken_off():
    """Acceptance: 40 sessions; the radar's own rms lies in the 95 % interval in at least 34 of them (99.7 % of the binomial's mass).

    The interval bounds what all errors of the reference that are drawn once can do, so that it holds more often than 95 %.
    """
    rng = np.random.default_rng(4)
    inside, middle, total, true = 0, [], [], []
    for _ in range(40):
        series, radar = session(rng, seconds=6.0)
        found = budget(series, SETTINGS)
        inside += found["rms_radar_low_m"] <= radar <= found["rms_radar_high_m"]
        middle.append((found["rms_radar_m"] or 0.0) ** 2)
        total.append(found["rms_total_m"] ** 2)
        true.append(radar**2)
        assert found["rms_reference_m"] == pytest.approx(math.sqrt(3 * (0.02**2 + 0.01**2 * 2 / 3)), rel=0.03)
    assert inside >= 34
    # Means of 40: the reference's constant error alone scatters the mean square by sqrt(2 / 3) of its 0.0012, 1.6e-4 after 40 sessions.
    assert np.mean(middle) == pytest.approx(np.mean(true), abs=3 * 1.6e-4)
    assert np.mean(total) - np.mean(true) > 9e-4, "without taking it off one would be wrong"


def test_a_perfect_radar_is_not_measured_by_a_bad_reference():
    """Where the reference is worse than the residual says, there is only an upper bound."""
    series, _ = session(np.random.default_rng(1), radar=0.0005, fresh=0.02, common=0.0, seconds=8.0)
    series = type(series)(**{**vars(series), "covariance": series.covariance * 1.3})
    found = budget(series, SETTINGS)
    assert found["rms_radar_m"] is None
    assert found["rms_radar_low_m"] == 0.0
    assert found["rms_radar_high_m"] < 0.02


def test_figures_of_a_session():
    """Bias, parts, lag and consistency are those that were put in; everything is plain JSON."""
    series, _ = session(np.random.default_rng(2), radar=0.02, common=0.0, lag=0.05, bias=0.04, seconds=20.0)
    found = budget(series, SETTINGS)
    # Of 20 s at a correlation time of 0.2 s 50 errors are independent: 0.02 / sqrt(50) = 3 mm for each mean, 4 ms for the lag at 0.75 m/s.
    assert np.allclose(found["bias_m"], 0.04, atol=0.012)
    assert found["lag_s"] == pytest.approx(0.05, abs=0.015)
    assert found["reference_m"]["pixel"] == pytest.approx(0.01 * math.sqrt(3 * 2 / 3), rel=0.03)
    assert found["p95_m"] < found["max_m"]
    assert json.loads(json.dumps(found))["samples"] == len(series.time)
    still, _ = session(np.random.default_rng(2), radar=0.05, common=0.0, fresh=0.01, seconds=20.0)
    # 1000 samples of which 50 are independent (0.2 s, both ways): the 99.9 % band of their 150 squares is 0.66 to 1.42.
    assert 0.66 < budget(still, SETTINGS)["nees"] < 1.42


def test_singular_covariances_are_said():
    """The simulator's truth has no error and a track may claim none: NEES is None, the rest stands."""
    residuals = HandResiduals(EXACT)
    samples = [s for k in range(20) for s in (reference(20 * k, (0, 0, k)), track(20 * k, (0.1, 0, k), std=0.0))]
    series = collect(item for sample in samples for item in residuals.process(sample))["hand"]
    found = budget(series, SETTINGS)
    assert found["nees"] is None
    assert found["rms_total_m"] == pytest.approx(0.1)
    assert found["rms_radar_m"] == pytest.approx(0.1)


def test_several_tracks_and_their_figure(tmp_path):
    """Two trackers against one reference, as in the thesis: a series each, and one picture that is the same file each time."""
    residuals = HandResiduals(EXACT)
    samples = [reference(33 * k, (1.0, 0.01 * k, 1.0), covariance=np.eye(3) * 1e-4) for k in range(60)]
    samples += [track(20 * k, (1.0, 0.006 * k, 1.0 + off), name) for name, off in (("hand", 0.02), ("kf/hand", 0.1)) for k in range(90)]
    series = collect(item for sample in sorted(samples, key=lambda s: s.stamp_ns) for item in residuals.process(sample))
    assert set(series) == {"hand", "kf/hand"}
    draw(series, "camera", tmp_path / "deep" / "hand.png")
    first = (tmp_path / "deep" / "hand.png").read_bytes()
    assert first[:4] == b"\x89PNG"
    draw(series, "camera", tmp_path / "deep" / "hand.png")
    assert (tmp_path / "deep" / "hand.png").read_bytes() == first
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        draw(series, "camera", tmp_path / "file" / "hand.png")


def test_nothing_is_told_as_nothing():
    """No residual: an error that says what to compare."""
    assert collect([]) == {}
    residuals = HandResiduals(EXACT)
    residuals.process(reference(0, (0, 0, 0)))
    (one,) = residuals.process(track(0, (0, 0, 0.1)))
    series = collect([one])["hand"]
    found = budget(series, SETTINGS)
    assert found["lag_s"] is None
    assert found["rms_radar_high_m"] > 0.1, "one moment says little"
    empty = type(series)(**{name: value[:0] for name, value in vars(series).items()})
    with pytest.raises(DataError, match="never overlap in time"):
        budget(empty, SETTINGS)
