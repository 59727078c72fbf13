"""The configuration that mmWave Studio saves beside a recording (.mmwave.json): what the radar transmitted, and how its samples lie."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from radar_core import DataError
from radar_driver.dca1000.ti_config import TiConfig

_LARGEST: Final = 1 << 24  # bytes


def read_studio_config(path: Path) -> tuple[TiConfig, int]:
    """Read a .json of one radar with one profile and chirps that take turns.

    Returns
    -------
    config : TiConfig
        As of a .cfg; the platform is unknown, the order of I and Q is said.
    lanes : int
        2: receivers follow each other; 4: they are interleaved, as xWR12 and xWR14 send them.

    Raises
    ------
    DataError
        Naming file and field that are missing, make no sense, or ask for a mode that is not supported.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise DataError(f"{path}: is too large for a configuration; give the .mmwave.json that lies beside the recording")
        found = json.loads(path.read_text(encoding="utf-8"))
        device = found["mmWaveDevices"][0]
        return _config(path, device)
    except DataError:
        raise
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: cannot be read as JSON ({str(error)[:100]})") from None
    except (KeyError, IndexError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: is no configuration of mmWave Studio ({type(error).__name__}: {str(error)[:60]})") from None


def _config(path: Path, device: dict[str, Any]) -> tuple[TiConfig, int]:
    radio = device["rfConfig"]
    profiles = [_inside(one, "rlProfileCfg_t") for one in radio["rlProfiles"]]
    chirps = [_inside(one, "rlChirpCfg_t") for one in radio["rlChirps"]]
    frame, receivers = radio["rlFrameCfg_t"], _whole(path, radio["rlChanCfg_t"], "rxChannelEn")
    _require(
        path,
        0 < receivers < 16 and (receivers + 1).bit_count() == 1,
        "rxChannelEn must switch on the first receivers: 0x1, 0x3, 0x7 or 0xF",
    )
    output = radio.get("rlAdcOutCfg_t", {}).get("fmt", {})
    _require(path, _whole(path, output, "b2AdcBits", 2) == 2, "b2AdcBits asks for samples of other than 16 bits")
    _require(path, _whole(path, output, "b2AdcOutFmt", 1) in (1, 2), "b2AdcOutFmt asks for real samples, which are not supported")
    first, last = (_whole(path, frame, name) for name in ("chirpStartIdx", "chirpEndIdx"))
    _require(path, 0 <= first <= last < 512, "rlFrameCfg_t uses chirps that there are not")
    used = [_chirp(path, chirps, number) for number in range(first, last + 1)]
    tx = tuple(mask.bit_length() for mask, _ in used)
    _require(path, len(set(tx)) == len(tx), "a transmitter has several chirps in a loop, which is not supported")
    kinds = {number for _, number in used}
    chosen = [one for one in profiles if _whole(path, one, "profileId", 0) in kinds]
    _require(path, len(chosen) == 1 and len(kinds) == 1, "its chirps use several profiles, or one that is not there")
    profile, form = chosen[0], device.get("rawDataCaptureConfig", {}).get("rlDevDataFmtCfg_t", {})
    swapped, split = _whole(path, form, "iqSwapSel", 0), _whole(path, form, "chInterleave", 1)
    _require(path, swapped in (0, 1) and split in (0, 1), "rlDevDataFmtCfg_t has iqSwapSel or chInterleave that are neither 0 nor 1")
    config = TiConfig(
        platform="",
        start_hz=_number(path, profile, "startFreqConst_GHz") * 1e9,
        slope=_number(path, profile, "freqSlopeConst_MHz_usec") * 1e12,
        idle=_number(path, profile, "idleTimeConst_usec", 0.0) * 1e-6,
        adc_start=_number(path, profile, "adcStartTimeConst_usec", 0.0) * 1e-6,
        ramp_end=_number(path, profile, "rampEndTime_usec") * 1e-6,
        n_sample=_whole(path, profile, "numAdcSamples"),
        sample_rate=_number(path, profile, "digOutSampleRate") * 1e3,
        tx=tx,
        n_rx=receivers.bit_count(),
        n_loop=_whole(path, frame, "numLoops"),
        frame_interval=_number(path, frame, "framePeriodicity_msec") * 1e-3,
        n_frame=_whole(path, frame, "numFrames", 0),
        order="q_first" if swapped else "i_first",
    )
    _require(path, config.n_sample >= 1 and config.n_loop >= 1, "numAdcSamples and numLoops must be at least 1")
    _require(path, config.adc_start + config.sampled <= config.ramp_end + 1e-9, "the samples of the profile do not fit into its ramp")
    return config, 2 if split else 4


def _inside(one: dict[str, Any], name: str) -> dict[str, Any]:
    inner: dict[str, Any] = one[name]
    return inner


def _chirp(path: Path, chirps: list[dict[str, Any]], number: int) -> tuple[int, int]:
    """Mask of the transmitters of a chirp, of which one has to send, and its profile."""
    for one in chirps:
        if _whole(path, one, "chirpStartIdx") <= number <= _whole(path, one, "chirpEndIdx"):
            mask = _whole(path, one, "txEnable")
            _require(path, mask > 0 and mask.bit_count() == 1, "txEnable must switch on exactly one transmitter at a time")
            return mask, _whole(path, one, "profileId", 0)
    raise DataError(f"{path}: rlFrameCfg_t uses chirp {number}, which no rlChirpCfg_t describes")


def _whole(path: Path, given: dict[str, Any], name: str, missing: int | None = None) -> int:
    """Read a whole number, also one that is written as text such as 0xF."""
    value = given.get(name, missing)
    try:
        found = int(value, 0) if isinstance(value, str) else value
    except ValueError:
        found = None
    if isinstance(found, bool) or not isinstance(found, int) or not -1 < found < 1 << 20:
        raise DataError(f"{path}: {name} is {str(value)[:40]}, expected a whole number")
    return found


def _number(path: Path, given: dict[str, Any], name: str, low: float = 1e-12) -> float:
    value = given.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value < 1e9:
        raise DataError(f"{path}: {name} is {str(value)[:40]}, expected a positive number")
    return float(value)


def _require(path: Path, good: bool, problem: str) -> None:
    if not good:
        raise DataError(f"{path}: {problem}")
