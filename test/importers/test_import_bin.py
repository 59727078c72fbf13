"""Recordings of a DCA1000's tools: samples without heads."""

import numpy as np
import pytest
from originals import CFG, encode, items

from radar_core import ConfigError, DataError
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording

SHAPE = (2, 4, 4, 64)  # 8192 bytes a frame


@pytest.fixture
def recorded(tmp_path):
    """Five frames of echoes in noise, and the .cfg beside where the files go."""
    rng = np.random.default_rng(4)
    echo = 500 * np.exp(2j * np.pi * 9 / 64 * np.arange(64))
    counts = np.round(echo + rng.normal(0, 40, (5, *SHAPE)) + 1j * rng.normal(0, 40, (5, *SHAPE)))
    (tmp_path / "radar.cfg").write_text(CFG.format(n_sample=64, n_chirp=4))
    return tmp_path, counts, b"".join(encode(c) for c in counts)


def test_a_file_gives_the_cubes(recorded):
    """Sample by sample; times as the .cfg says."""
    folder, counts, stream = recorded
    (folder / "adc_data.bin").write_bytes(stream)
    report = import_recording("dca1000_bin", folder / "adc_data.bin", folder / "bag")
    frames = items(folder / "bag")
    np.testing.assert_array_equal([f.cube for f in frames], counts)
    assert np.diff([f.stamp_ns for f in frames]).tolist() == [100_000_000] * 4
    assert [len(f.missing) for f in frames] == [0] * 5
    assert len(report.warnings) == 1
    assert "carries no times" in report.warnings[0]
    assert open_recording(folder / "bag").info.full_scale == 32767


def test_parts_are_put_together_in_the_order_of_their_numbers(recorded):
    """Ten parts and more, cut anywhere: 10 comes after 9; the end of the last one is no whole frame."""
    folder, counts, stream = recorded
    parts = folder / "parts"
    parts.mkdir()
    (folder / "radar.cfg").rename(parts / "radar.cfg")
    edges = np.linspace(0, len(stream) - 1000, 13).astype(int)
    for k in range(12):
        (parts / f"adc_data_Raw_{k}.bin").write_bytes(stream[edges[k] : edges[k + 1]])
    report = import_recording("dca1000_bin", parts, folder / "bag")
    np.testing.assert_array_equal([f.cube for f in items(folder / "bag")], counts[:4])
    assert report.dropped == {"frames that are cut off by the end of the file": 1}
    (parts / "other_0.bin").write_bytes(b"")
    with pytest.raises(DataError, match=r"of one recording, .* found: adc_data_Raw, other"):
        import_recording("dca1000_bin", parts, folder / "bag2")


def test_holes_are_marked(recorded):
    """A recorder fills lost packets with zeros: their chirps are missing, and a frame of little else is left out."""
    folder, _, stream = recorded
    holed = bytearray(stream)
    holed[8192 + 2912 : 8192 + 4368] = bytes(1456)  # chirps 2, 3 and 4 of frame 1
    holed[3 * 8192 : 4 * 8192 - 2000] = bytes(8192 - 2000)
    (folder / "x.bin").write_bytes(holed)
    report = import_recording("dca1000_bin", folder / "x.bin", folder / "bag")
    frames = items(folder / "bag")
    assert [f.sequence for f in frames] == [0, 1, 2, 4]
    assert [f.missing.tolist() for f in frames] == [[], [2, 3, 4], [], []]
    assert report.dropped == {"frames of which too little arrived": 1}
    assert any("have holes of zeros" in w for w in report.warnings)
    import_recording("dca1000_bin", folder / "x.bin", folder / "all", holes=False)
    assert [f.sequence for f in items(folder / "all")] == list(range(5))


def test_swapped_components_are_warned_of(recorded):
    """mmWave Studio writes I first."""
    folder, _, stream = recorded
    (folder / "x.bin").write_bytes(stream)
    report = import_recording("dca1000_bin", folder / "x.bin", folder / "bag", order="i_first")
    assert sum("try order=q_first" in w for w in report.warnings) == 1


def test_what_cannot_be_read(recorded):
    """Too short; no .cfg; an empty folder; an impossible number of receivers."""
    folder, _, stream = recorded
    (folder / "x.bin").write_bytes(stream[:8000])
    with pytest.raises(DataError, match=r"2 x 4 x 4 x 64 .* = 8192 bytes a frame, but there are 8000 bytes"):
        import_recording("dca1000_bin", folder / "x.bin", folder / "bag")
    with pytest.raises(ConfigError, match="1, 2 or 4 receivers"):
        import_recording("dca1000_bin", folder / "x.bin", folder / "bag", n_rx=3)
    (folder / "empty").mkdir()
    with pytest.raises(DataError, match="found: none"):
        import_recording("dca1000_bin", folder / "empty", folder / "bag", config=str(folder / "radar.cfg"))
    (folder / "radar.cfg").unlink()
    with pytest.raises(ConfigError, match=r"0 \.cfg files lie beside it"):
        import_recording("dca1000_bin", folder / "x.bin", folder / "bag")
    assert not (folder / "bag").exists()
