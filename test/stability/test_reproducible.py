"""The same input gives the same output, bit for bit: in other runs, with other numbers of threads, with other orders of hashing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1] / "dsp")]
from echoes import amplitude_for, echo, frame, noise
from run_digest import MODELS, digest, run, scene_of

from radar_core import RadarInfo
from radar_dsp import Baseband, BasebandConfig, DoaConfig, SpectrumConfig
from radar_sim import Simulator

INFO = RadarInfo()
FRAMES = 125


def elsewhere(threads: int, seed: int) -> dict[str, str]:
    """Digests of the whole chain in a process of its own."""
    pools = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), str(threads))
    found = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("run_digest.py")), "scipy", str(FRAMES)],
        env={**os.environ, **pools, "PYTHONHASHSEED": str(seed)},
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
    )
    return json.loads(found.stdout)


@pytest.mark.long
def test_other_processes_threads_and_hashes_give_the_same_bits():
    """From the scene to clouds, tracks, gestures and the hand, here and in two processes: digests of every number are equal.

    Products of matrices are cut differently among threads, and sets are walked in another order: neither may be seen.
    """
    here = run("scipy", FRAMES)
    assert "'gestures': 0" not in here["sizes"]
    assert elsewhere(1, 1) == here
    assert elsewhere(4, 2) == here


@pytest.mark.long
def test_what_is_compiled_now_and_what_comes_from_the_cache_give_the_same_bits(tmp_path):
    """The first run of an installation compiles, all others load: a function that is called must be the same one in both.

    Where products and sums may be fused, a function that is inlined rounds differently from one that is called.
    """
    found = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, str(Path(__file__).with_name("compiled_digest.py"))],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
            timeout=240,
        )
        found.append(json.loads(done.stdout))
    assert found[0] == found[1]
    assert len(set(found[0].values())) == 3


def test_a_frame_does_not_depend_on_the_frames_before():
    """Random access: frame 40 after 39 others, alone, and backwards."""
    for model in MODELS:
        forward, backward = Simulator(scene_of(model)), Simulator(scene_of(model))
        a = [digest(forward.process(k).frame.cube) for k in (38, 39, 40)]
        b = [digest(backward.process(k).frame.cube) for k in (40, 39, 38)]
        assert a == b[::-1]


def test_a_cloud_does_not_depend_on_the_frames_before():
    """No state but counters: the same frame twice, with another between, gives the same bits with every method of directions."""
    rng = np.random.default_rng(0)
    one = frame(INFO, noise(INFO, rng), echo(INFO, 2.0, 1.0, 0.2, 0.1, amplitude_for(30, INFO)))
    other = frame(INFO, noise(INFO, rng), echo(INFO, 4.0, -2.0, -0.4, 0.0, amplitude_for(40, INFO)))
    for method in ("dml", "dml2", "capon"):
        baseband = Baseband(BasebandConfig(doa=DoaConfig(method=method)), INFO)
        clouds = [baseband.process(given) for given in (one, other, one)]
        for name in ("x", "y", "z", "range", "azimuth", "radial_speed", "snr", "noise", "azimuth_std"):
            np.testing.assert_array_equal(getattr(clouds[0], name), getattr(clouds[2], name))


@pytest.mark.parametrize("settings", [{"fft": "numpy"}, {"fft": "fftw"}])
def test_other_transforms_agree_within_float32(settings):
    """FFTW plans by what it measures and differs in the last bits; echoes well above the threshold are the same to 1e-4 of a cell."""
    rng = np.random.default_rng(1)
    parts = [echo(INFO, 1.0 + 0.8 * k, 0.5 * k - 1, 0.15 * k - 0.4, 0.05 * k, amplitude_for(30, INFO)) for k in range(5)]
    given = frame(INFO, noise(INFO, rng), *parts)
    plain, other = (
        Baseband(BasebandConfig(grouping="peak", min_snr=18.0, spectrum=SpectrumConfig(**s)), INFO).process(given) for s in ({}, settings)
    )
    assert len(plain) == len(other) >= 5
    np.testing.assert_allclose(other.range, plain.range, atol=1e-5)
    np.testing.assert_allclose(other.radial_speed, plain.radial_speed, atol=1e-5)
    np.testing.assert_allclose(other.azimuth, plain.azimuth, atol=1e-4)
    np.testing.assert_allclose(other.snr, plain.snr, atol=1e-3)


@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
def test_compiled_and_plain_loops_agree_within_float32(method):
    """numba and numpy sum in another order: the same cells, places to 1e-4 m, angles to 1e-3 rad."""
    rng = np.random.default_rng(2)
    parts = [echo(INFO, 1.0 + 0.8 * k, 0.5 * k - 1, 0.15 * k - 0.4, 0.05 * k, amplitude_for(30, INFO)) for k in range(5)]
    given = frame(INFO, noise(INFO, rng), *parts)
    a, b = (
        Baseband(BasebandConfig(grouping="peak", min_snr=18.0, doa=DoaConfig(method=method), backend=backend), INFO).process(given)
        for backend in ("numba", "numpy")
    )
    assert len(a) == len(b) >= 5
    np.testing.assert_allclose(b.range, a.range, atol=1e-4)
    np.testing.assert_allclose(b.azimuth, a.azimuth, atol=1e-3)
