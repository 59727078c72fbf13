"""Table 4.2 on samples made by hand: every row has accuracy, size and time, with and without PyTorch."""

import numpy as np
import pytest
from test_gesture_tables import samples

from benchmarks import gesture_networks
from radar_core import GESTURES, ConfigError
from radar_lab.datasets.readings import Cubes
from radar_lab.training.validation import Validation

SHAPES = {"maps": (3, 65, 50), "cubes": (5, 50, 50)}


class Judged:
    """Maps and cubes of two detections, and what untrained networks say: all right on maps, nine labels of ten on cubes."""

    def inputs(self, name):
        """Return the input of a network."""
        given = samples(0.05)
        cube = np.zeros((len(given.label), *SHAPES[name]), np.float32)
        cube[:, :, :2, 0] = 1.0
        return Cubes(cube, given.label, given.person, given.missed)

    def validate(self, name, config):
        """Take the fourth label for the fifth on cubes."""
        given = samples(0.05)
        said = np.where((given.label == 3) & (name == "cubes"), 4, given.label)
        return Validation("subjects", GESTURES, np.eye(10)[said], given.label, given.person, 5)


class WithoutTorch(Judged):
    """Nothing trains."""

    def validate(self, name, config):
        """Say so."""
        raise ConfigError("needs PyTorch")


@pytest.mark.long
def test_the_table_has_features_and_both_networks():
    """Accuracy, bytes, FLOP and time of each; of 330 performed, 30 gave no event, of which 3 were random movements."""
    pytest.importorskip("torch", reason="needs PyTorch (pip install 'handwave[train]')")
    found = gesture_networks.table_4_2(samples(0.05, missed=3), Judged(), quick=True)
    table, rows = found["networks"], found["choices"]
    assert list(table) == ["features", "maps", "cubes"]
    assert [table[name]["accuracy"] for name in table] == pytest.approx([1.0, 1.0, 0.9])
    assert [table[name]["recognised"] for name in table] == pytest.approx([303 / 330, 303 / 330, 273 / 330])
    assert all(row["performed"] == 330 for row in table.values())
    assert [table[name]["flop"] for name in table] == [1552, 18_226_542, 15_408_428]  # test_cnn counts those of maps by hand
    assert 1e6 < table["cubes"]["bytes"] < table["maps"]["bytes"] < 2e6
    assert [row["accuracy"]["value"] for row in rows] == pytest.approx([1.0, 1.0, 0.9])
    assert all(row["time_ms"]["median"] > 0 for row in rows)
    assert np.trace(found["confusion_networks"]["cubes"]["confusion"]) == 270


@pytest.mark.long
def test_without_pytorch_the_perceptron_stands_alone():
    """And it is said why."""
    found = gesture_networks.table_4_2(samples(0.05), WithoutTorch(), quick=True)
    assert list(found["networks"]) == ["features"]
    assert found["networks"]["features"]["accuracy"] == 1.0
    assert found["networks_left_out"] == "needs PyTorch"
    assert found["confusion_networks"] == {}
    assert len(found["choices"]) == 1
