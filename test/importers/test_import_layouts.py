"""Public sets of raw frames by their published layouts, made here: no original was at hand."""

import numpy as np
import pytest
from originals import items

from radar_core import ConfigError, DataError
from radar_lab.importers import open_original
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording

SETUP = {"slope": 60e12, "sample_rate": 6e6, "chirp_interval": 70e-6}  # what CubeLearn's page does not say


def cubelearn(folder, n_frame=2, seed=0):
    """Counts of (part, frame, chirp, channel, sample), as the page says."""
    counts = np.random.default_rng(seed).integers(-2000, 2000, (2, n_frame, 128, 12, 256)).astype(np.float64)
    np.save(folder / "3_7_12.npy", counts)
    return folder / "3_7_12.npy", counts


def eth(folder, n_take=3, seed=0):
    """Counts of (recording, frame, chirp, sample, receiver), in the folders of a person and a gesture."""
    counts = np.random.default_rng(seed).integers(0, 4096, (n_take, 16, 96, 16, 3)).astype(np.uint16)
    inner = folder / "person_04" / "swipe"
    inner.mkdir(parents=True)
    np.save(inner / "data.npy", counts)
    return inner / "data.npy", counts


def test_cubelearn_frames_come_back(tmp_path):
    """To the bit, the row of eight channels first, the four above its middle after it; the file's name says who and what."""
    path, counts = cubelearn(tmp_path)
    report = import_recording("cubelearn", path, tmp_path / "bag", **SETUP)
    frames = items(tmp_path / "bag")
    assert report.messages["/radar/frame"] == 2
    assert report.labels == {"7": 1}
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.cube.swapaxes(0, 1).reshape(128, 12, 256), counts[0, k] + 1j * counts[1, k])
    assert np.diff([frame.stamp_ns for frame in frames]).tolist() == [100_000_000]
    info = open_recording(tmp_path / "bag").info
    half = info.waveform.wavelength / 2
    row = [(k, 0) for k in range(8)]
    np.testing.assert_allclose(info.array.virtual / half, [*row, *((k, 1) for k in range(2, 6))], atol=1e-9)
    assert info.waveform.bandwidth == pytest.approx(60e12 * 256 / 6e6)


def test_eth_recordings_follow_each_other(tmp_path):
    """Three gestures of 16 frames, a second between them, of one person; one of them alone with the option take."""
    path, _ = eth(tmp_path)
    report = import_recording("bgt60_eth", path, tmp_path / "bag")
    frames = items(tmp_path / "bag")
    assert report.labels == {"swipe": 3}
    assert [frame.sequence for frame in frames] == list(range(48))
    steps = np.diff([frame.stamp_ns for frame in frames]) * 1e-9
    np.testing.assert_allclose(np.delete(steps, [15, 31]), 1 / 13.5)
    np.testing.assert_allclose(steps[[15, 31]], 1 / 13.5 + 1.0)
    second = list(open_original("bgt60_eth", path, take=1).items)
    np.testing.assert_array_equal([frame.cube for frame in second], [frame.cube for frame in frames[16:32]])
    segments = open_original("bgt60_eth", path, take=1)
    list(segments.items)
    assert [(one.label, one.subject) for one in segments.tally.segments] == [("swipe", 4)]


def test_sides_can_be_changed(tmp_path):
    """The receivers' places, and the sign of the ranges' frequencies."""
    path, _ = eth(tmp_path, 1)
    plain = open_original("bgt60_eth", path).info.array
    turned = open_original("bgt60_eth", path, mirrored=True, upside_down=True).info.array
    np.testing.assert_allclose(turned.virtual, -plain.virtual)
    path, counts = cubelearn(tmp_path, 1)
    frame = next(open_original("cubelearn", path, conjugate=True, **SETUP).items)
    np.testing.assert_array_equal(frame.cube[0, :, 0], counts[0, 0, :, 0] - 1j * counts[1, 0, :, 0])


def test_what_is_not_published_has_to_be_said(tmp_path):
    path, _ = cubelearn(tmp_path, 1)
    with pytest.raises(ConfigError, match=r"does not say sample_rate, chirp_interval; .* -o sample_rate=\.\.\. -o chirp_interval="):
        open_original("cubelearn", path, slope=60e12)


SPOILT = [
    (
        "cubelearn",
        np.zeros((2, 1, 128, 8, 256)),
        r"shape \(2, 1, 128, 8, 256\), expected real samples with axes \(iq 2, frame any, chirp 128, c",
    ),
    ("cubelearn", np.zeros((1, 128, 12, 256), complex), "is complex128 of shape"),
    ("cubelearn", np.zeros((2, 0, 128, 12, 256)), "expected real samples"),
    ("bgt60_eth", np.zeros((1, 16, 96, 32, 3), np.int16), r"axes \(take any, frame any, chirp 96, sample 16, rx 3\)"),
    ("bgt60_eth", np.zeros((0, 16, 96, 16, 3), np.int16), "expected real samples"),
    ("bgt60_eth", np.full((1, 1, 96, 16, 3), np.nan), "samples has 4608 non-finite values"),
    ("bgt60_eth", np.array(["a"]), "is no array of numbers"),
]


@pytest.mark.parametrize(("kind", "data", "message"), SPOILT, ids=[f"{kind} {message[:20]}" for kind, _, message in SPOILT])
def test_other_arrays_are_refused(tmp_path, kind, data, message):
    """By file, with what was expected; no bag is left."""
    np.save(tmp_path / "a.npy", data)
    with pytest.raises(DataError, match=f"a.npy: .*{message}"):
        import_recording(kind, tmp_path / "a.npy", tmp_path / "bag", **(SETUP if kind == "cubelearn" else {}))
    assert not (tmp_path / "bag").exists()


def test_a_nan_and_a_file_that_was_cut_off(tmp_path):
    path, counts = cubelearn(tmp_path)
    counts[1, 1, 5, 3, 7] = np.nan
    np.save(path, counts)
    with pytest.raises(DataError, match=r"3_7_12\.npy: samples has 1 non-finite"):
        import_recording("cubelearn", path, tmp_path / "bag", **SETUP)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(DataError, match=r"cannot be read as \.npy"):
        import_recording("cubelearn", path, tmp_path / "bag", **SETUP)
    with pytest.raises(DataError, match="has 3 recordings, from 0 on, and no number 3"):
        open_original("bgt60_eth", eth(tmp_path)[0], take=3)
    assert not (tmp_path / "bag").exists()
