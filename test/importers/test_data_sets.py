"""Data sets of gestures as studies read them."""

from __future__ import annotations

from pathlib import Path

import pytest
from originals import write_segments

from benchmarks import gesture_studies as real
from benchmarks.gestures_people import nobody_in


def test_a_data_set_of_several_files_is_read_in_the_order_of_its_people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Labels, people and marks of both files, one after the other; with a limit only the first."""
    (tmp_path / "mtranssee").mkdir()
    write_segments(tmp_path / "mtranssee" / "segments.npz", ("PL", "KO"))
    write_segments(tmp_path / "mtranssee" / "segments_2.npz", ("UP", "CR", "PS"), seed=1)
    monkeypatch.setenv("HANDWAVE_DATA", str(tmp_path))
    real.read.cache_clear()
    try:
        found, few = real.read("mtranssee"), real.read("mtranssee", 2)
        assert found.label.tolist() == ["pull", "knock", "up", "circle", "push"]
        assert found.person.tolist() == [800, 801, 800, 801, 802]
        assert few.label.tolist() == ["pull", "knock"]
        assert len(found.events) == len(found.thirteen) == len(nobody_in("mtranssee")) == 5
    finally:
        real.read.cache_clear()
