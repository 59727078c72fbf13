"""Recordings of an A121 given by path: what `python -m benchmarks one_channel --real` says of them."""

import numpy as np
import pytest
from test_import_a121 import record, subsweep

from benchmarks.one_channel import run
from benchmarks.report import AbsentError

pytest.importorskip("h5py")


def sitting(rate, seconds=25):
    """Frames (frame, sweep, point), 20 a second, of a chest that goes 4 mm to and fro in the middle of the distances, in noise."""
    rng = np.random.default_rng(2)
    time = np.arange(20 * seconds)[:, None] / 20 + np.arange(8) / 2000
    turn = np.exp(4j * np.pi / 0.005 * 0.002 * np.sin(2 * np.pi * rate * time))
    shape = np.exp(-((np.arange(20) - 10) ** 2) / 2)
    noise = rng.normal(0, 10, (len(time), 8, 20, 2)) @ [1, 1j]
    return 1000 * turn[..., None] * shape + 400 * np.ones(20) + noise


def test_a_breath_is_counted_and_a_broken_file_is_named(tmp_path, monkeypatch):
    """Fifteen breaths a minute, at the chest's distance; an empty room says nobody; the other files are still read."""
    far = [subsweep(96, 20, 24)]
    record(tmp_path / "a-sitting.h5", sitting(0.25).round(), subsweeps=far)
    record(
        tmp_path / "b-empty.h5",
        (sitting(0.0) * 0 + np.random.default_rng(1).normal(0, 10, (500, 8, 20, 2)) @ [1, 1j]).round(),
        subsweeps=far,
    )
    (tmp_path / "c-broken.h5").write_bytes(b"nothing")
    monkeypatch.setenv("HANDWAVE_A121", str(tmp_path))
    chest, empty, broken = run(quick=True, real=True)["recordings"]
    assert chest["breaths_a_minute"] == pytest.approx(15, abs=1)
    assert chest["distance_m"] == pytest.approx((96 + 10 * 24) * 0.00251, abs=0.06)
    assert chest["present"] > 0.5
    assert (empty["present"], empty["breaths_a_minute"], empty["gestures"]) == (0.0, None, {})
    assert "c-broken.h5: cannot be read as .h5" in broken["refused"]
    monkeypatch.setenv("HANDWAVE_A121", str(tmp_path / "nowhere"))
    with pytest.raises(AbsentError, match="HANDWAVE_A121"):
        run(quick=True, real=True)
