"""mmWave Studio's recordings: a .bin whose .mmwave.json says how the radar was set up and how its samples lie."""

import json

import numpy as np
import pytest
from originals import CFG, encode, items

from radar_core import ConfigError, DataError
from radar_driver.dca1000.studio_config import read_studio_config
from radar_driver.dca1000.ti_config import read_ti_config
from radar_lab.importers import open_original
from radar_ros.importing import import_recording

SHAPE = (2, 4, 4, 64)


def studio(swapped=0, split=1, **changes):
    """What Studio saves for the radar of `originals.CFG`; ``changes``: fields of the profile, the frame, and so on, by name."""
    profile = {
        "profileId": 0,
        "startFreqConst_GHz": 77.0,
        "idleTimeConst_usec": 429.0,
        "adcStartTimeConst_usec": 7.0,
        "rampEndTime_usec": 57.14,
    }
    profile |= {"freqSlopeConst_MHz_usec": 70.0, "numAdcSamples": 64, "digOutSampleRate": 5209.0}
    chirp = {"profileId": 0}
    chirps = [{**chirp, "chirpStartIdx": k, "chirpEndIdx": k, "txEnable": mask} for k, mask in enumerate(("0x1", "0x4"))]
    frame = {"chirpStartIdx": 0, "chirpEndIdx": 1, "numLoops": 4, "numFrames": 0, "framePeriodicity_msec": 100.0}
    for place in (profile, frame):
        place |= {name: value for name, value in changes.items() if name in place}
    chirps[1] |= {name: value for name, value in changes.items() if name in ("txEnable", "profileId")}
    radio = {
        "rlChanCfg_t": {"rxChannelEn": changes.get("rxChannelEn", "0xF"), "txChannelEn": "0x7"},
        "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": changes.get("b2AdcOutFmt", 1)}},
        "rlProfiles": [{"rlProfileCfg_t": profile}],
        "rlChirps": [{"rlChirpCfg_t": one} for one in chirps],
        "rlFrameCfg_t": frame,
    }
    form = {"rlDevDataFmtCfg_t": {"iqSwapSel": swapped, "chInterleave": split}}
    return {"mmWaveDevices": [{"rfConfig": radio, "rawDataCaptureConfig": form}]}


def write(path, **more):
    path.write_text(json.dumps(studio(**more)))
    return path


def test_it_says_what_a_cfg_says(tmp_path):
    """The same radar by both; the platform is not in it, the order of I and Q is."""
    (tmp_path / "a.cfg").write_text(CFG.format(n_sample=64, n_chirp=4))
    by_cfg = read_ti_config(tmp_path / "a.cfg")
    by_json, lanes = read_studio_config(write(tmp_path / "a.mmwave.json"))
    for name in ("start_hz", "slope", "idle", "adc_start", "ramp_end", "n_sample", "sample_rate", "tx", "n_rx", "n_loop", "frame_interval"):
        assert getattr(by_json, name) == pytest.approx(getattr(by_cfg, name)), name
    assert (by_json.order, lanes) == ("i_first", 2)
    assert (read_studio_config(write(tmp_path / "b.mmwave.json", swapped=1))[0].order) == "q_first"


@pytest.mark.parametrize(("swapped", "order"), [(0, "i_first"), (1, "q_first")])
def test_a_recording_gives_the_cubes(tmp_path, swapped, order):
    """Sample by sample, without any option; in either order of I and Q."""
    rng = np.random.default_rng(6)
    echo = 500 * np.exp(2j * np.pi * 9 / 64 * np.arange(64))
    counts = np.round(echo + rng.normal(0, 40, (3, *SHAPE)) + 1j * rng.normal(0, 40, (3, *SHAPE)))
    words = counts if order == "q_first" else counts.imag + 1j * counts.real
    (tmp_path / "adc_data.bin").write_bytes(b"".join(encode(c) for c in words))
    write(tmp_path / "setup.mmwave.json", swapped=swapped)
    report = import_recording("dca1000_bin", tmp_path / "adc_data.bin", tmp_path / "bag")
    np.testing.assert_array_equal([f.cube for f in items(tmp_path / "bag")], counts)
    assert len(report.warnings) == 1


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"rxChannelEn": "0x5"}, "must switch on the first receivers"),
        ({"rxChannelEn": "many"}, "rxChannelEn is many, expected a whole number"),
        ({"b2AdcOutFmt": 0}, "real samples, which are not supported"),
        ({"txEnable": "0x5"}, "exactly one transmitter at a time"),
        ({"txEnable": "0x1"}, "a transmitter has several chirps"),
        ({"chirpEndIdx": 2}, "uses chirp 2, which no rlChirpCfg_t describes"),
        ({"profileId": 1}, "several profiles"),
        ({"digOutSampleRate": 0.0}, "digOutSampleRate is 0.0, expected a positive number"),
        ({"numAdcSamples": 4000}, "do not fit into its ramp"),
        ({"split": 7}, "neither 0 nor 1"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, more, message):
    """File and field."""
    with pytest.raises(DataError, match=message):
        read_studio_config(write(tmp_path / "x.mmwave.json", **more))


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"mmWaveDevices": [3]}', "[" * 5000, '{"mmWaveDevices": [{"rfConfig": {"rlProfiles": 1}}]}']
)
def test_no_such_configuration(tmp_path, text):
    """One line."""
    path = tmp_path / "x.mmwave.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"x\.mmwave\.json: (cannot be read as JSON|is no configuration of mmWave Studio)"):
        read_studio_config(path)


def test_which_of_several(tmp_path):
    """Two beside the recording: say which."""
    for name in ("a", "b"):
        write(tmp_path / f"{name}.mmwave.json")
    (tmp_path / "x.bin").write_bytes(bytes(8192))
    with pytest.raises(ConfigError, match=r"2 \.mmwave\.json files lie beside it"):
        open_original("dca1000_bin", tmp_path / "x.bin")
