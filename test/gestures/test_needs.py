"""What a model needs of a radar: by its settings, against radars that give it and radars that do not, each lack by itself."""

from __future__ import annotations

import dataclasses

import pytest

from radar_core import AntennaArray, ConfigError, RadarInfo
from radar_core.config import load, load_file, plain
from radar_core.paths import find_config
from radar_driver.tinyrad.config import TinyRadConfig
from radar_gestures.classifiers.model import AUTO, load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FeatureConfig
from radar_gestures.needs import Needs, lacks, needs, warning
from radar_gestures.stage import GestureConfig
from radar_lab.pipeline import Pipeline, PipelineConfig

DESIGN = RadarInfo()
ROW = AntennaArray(tx=((0.0, 0.0), (0.0038, 0.0)), rx=((0.0, 0.0), (0.0019, 0.0)))
COLUMN = AntennaArray(tx=((0.0, 0.0), (0.0, 0.0038)), rx=((0.0, 0.0), (0.0, 0.0019)))


def waved(**knobs):
    """The design's radar with another waveform."""
    return dataclasses.replace(DESIGN, waveform=dataclasses.replace(DESIGN.waveform, **knobs))


def test_the_shipped_model_suits_the_radar_it_was_made_for():
    assert lacks(needs(load_model()), DESIGN) == ()
    assert Pipeline(DESIGN).warning == ""


@pytest.mark.parametrize(
    ("info", "word"),
    [
        (waved(frame_interval=0.1), "clouds come every 0.1 s"),
        (waved(n_chirp=8), "Doppler cell"),
        (waved(chirp_pause=5e-4, n_chirp=32, frame_interval=0.05), "speeds are told up to"),
        (dataclasses.replace(DESIGN, array=ROW), "no elevation"),
        (dataclasses.replace(DESIGN, array=COLUMN), "no azimuth"),
    ],
)
def test_each_lack_is_told_by_itself(info, word):
    (sentence,) = lacks(needs(load_model()), info)
    assert word in sentence


def test_needs_follow_the_settings():
    """The preset for ten clouds a second, with the gate of a coarse radar, suits such a radar; the default model does not."""
    slow = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))
    coarse = waved(frame_interval=0.1, n_chirp=8)
    gate = FeatureConfig(gate=coarse.waveform.speed_resolution)
    shipped = load_model()
    assert isinstance(shipped, GestureModel)
    model = dataclasses.replace(shipped, settings={"events": plain(slow.events), "features": plain(gate)})
    assert lacks(needs(model), coarse) == ()
    assert len(lacks(needs(shipped), coarse)) == 2


def test_angles_that_no_feature_uses_are_not_needed():
    wanted = Needs(1.0, 1.0, 0.1, azimuth=False, elevation=False)
    assert lacks(wanted, RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (0.0, 0.0)), rx=((0.0, 0.0),)))) == ()


def test_settings_that_are_none_are_refused():
    shipped = load_model()
    assert isinstance(shipped, GestureModel)
    with pytest.raises(ConfigError, match="events of the gesture model"):
        needs(dataclasses.replace(shipped, settings={"events": {"threshold": "fast"}}))


def test_a_pipeline_says_so_in_one_line():
    info, named = dataclasses.replace(DESIGN, array=ROW), load(PipelineConfig, {"gestures": {"model": "gestures"}})
    assert Pipeline(info, named).warning == warning(lacks(needs(load_model()), info), "gestures")
    assert "gestures was made for another radar: the radar tells no elevation" in Pipeline(info, named).warning


def test_both_models_of_ours_ask_for_what_the_networks_need():
    """These learned from all boards, so nobody is told of what the thirteen features alone would need."""
    assert needs(load_model(AUTO)) == needs(load_model("stream"))
    poor = (DESIGN, dataclasses.replace(DESIGN, array=ROW), waved(n_chirp=8), TinyRadConfig(calibrate=False).info())
    for info in poor:
        assert Pipeline(info).warning == warning(lacks(needs(load_model("stream")), info), AUTO)
