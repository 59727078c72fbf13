"""The configuration file of TI's mmWave demos (.cfg): what the radar transmitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, DataError, Pose, RadarInfo, Waveform

_ELEMENT: Final = {1: (0.0, 0.0), 2: (2.0, 1.0), 3: (4.0, 0.0)}
"""(y, z) in half wavelengths of the evaluation boards' transmitters: TX2 sits half a wavelength above the line of TX1 and TX3."""
_TWO_TX: Final = {1: (0.0, 0.0), 2: (4.0, 0.0)}  # the same of the xWR16xx, which has two
_ARGUMENTS: Final = {"profileCfg": 14, "frameCfg": 7, "chirpCfg": 8, "channelCfg": 3, "adcCfg": 2}
_OPTIONAL: Final = {"lvdsStreamCfg": 4, "adcbufCfg": 4}
_FULL_SCALE: Final = 32767.0  # samples are counts of 16 bits


@dataclass(frozen=True)
class TiConfig:
    """What a .cfg says about the frames.

    Attributes
    ----------
    platform : str
        E.g. xWR18xx; empty when the file does not say.
    start_hz, slope, sample_rate : float
        Where the ramp begins [Hz], how it rises [Hz/s], and samples per second [Hz].
    idle, adc_start, ramp_end, frame_interval : float
        Times within a chirp, and from one frame to the next [s].
    n_sample, n_rx, n_loop : int
        Samples per chirp, receivers that are on, chirps per transmitter.
    tx : tuple of int
        Transmitters (from 1) in the order of the chirps.
    n_frame : int
        Frames until the sensor stops by itself; 0: never.
    streams : bool
        Whether the raw samples leave through the LVDS lanes (lvdsStreamCfg).
    order : str
        Component that comes first in a sample: ``i_first`` or ``q_first`` (sampleSwap of adcbufCfg); empty when the file does not say.
    """

    platform: str
    start_hz: float
    slope: float
    idle: float
    adc_start: float
    ramp_end: float
    n_sample: int
    sample_rate: float
    tx: tuple[int, ...]
    n_rx: int
    n_loop: int
    frame_interval: float
    n_frame: int = 0
    streams: bool = False
    order: str = ""

    @property
    def sampled(self) -> float:
        """Sampled duration of a chirp [s]."""
        return self.n_sample / self.sample_rate

    @property
    def carrier(self) -> float:
        """Frequency in the middle of the samples [Hz]."""
        return self.start_hz + self.slope * (self.adc_start + self.sampled / 2)


def read_ti_config(path: Path) -> TiConfig:
    """Read a .cfg file.

    A `DataError` names file and line of a command that is missing or makes no sense, or of a mode that is not supported (real samples,
    several transmitters at once, subframes).
    """
    platform, commands = _commands(path)
    for name in _ARGUMENTS:
        if name not in commands:
            raise DataError(f"{path}: lacks the command {name}; give the file that configured the radar")
    line, channel = commands["channelCfg"][-1]
    _require(path, line, channel[0] > 0, "channelCfg switches no receiver on")
    _require(path, line, (int(channel[0]) + 1).bit_count() == 1, "channelCfg must switch on the first receivers: a mask of 1, 3, 7 or 15")
    line, adc = commands["adcCfg"][-1]
    _require(path, line, adc[0] == 2, "adcCfg asks for samples of other than 16 bits; use adcCfg 2 1")
    _require(path, line, adc[1] in (1, 2), "adcCfg asks for real samples, which are not supported; record with adcCfg 2 1")
    line, frame = commands["frameCfg"][-1]
    _require(path, line, 0 <= frame[0] <= frame[1] < 512 and frame[2] >= 1 and frame[4] > 0, "frameCfg makes no sense")
    tx = tuple(_transmitter(path, commands["chirpCfg"], chirp) for chirp in range(int(frame[0]), int(frame[1]) + 1))
    _require(path, line, len(set(tx)) == len(tx), "a transmitter has several chirps in a loop, which is not supported")
    stream, buffer = commands.get("lvdsStreamCfg", []), commands.get("adcbufCfg", [])
    line, profile = commands["profileCfg"][0]
    _require(path, line, min(profile[1], profile[4], profile[7], profile[9], profile[10]) > 0, "profileCfg needs positive values")
    config = TiConfig(
        platform=platform,
        start_hz=profile[1] * 1e9,
        slope=profile[7] * 1e12,
        idle=profile[2] * 1e-6,
        adc_start=profile[3] * 1e-6,
        ramp_end=profile[4] * 1e-6,
        n_sample=int(profile[9]),
        sample_rate=profile[10] * 1e3,
        tx=tx,
        n_rx=int(channel[0]).bit_count(),
        n_loop=int(frame[2]),
        frame_interval=frame[4] * 1e-3,
        n_frame=int(frame[3]),
        streams=bool(stream) and stream[-1][1][1:4] == [0, 1, 0],  # no headers, raw samples, nothing else
        order=("q_first" if buffer[-1][1][-3] else "i_first") if buffer else "",
    )
    _require(path, line, config.adc_start + config.sampled <= config.ramp_end + 1e-9, "the samples of profileCfg do not fit into its ramp")
    return config


def cli_lines(path: Path) -> list[tuple[int, str]]:
    """Commands of a .cfg file as the sensor's CLI gets them: numbers of their lines (from 1), and text without comments and blanks.

    A `DataError` says that the file cannot be read.
    """
    lines = ((number, line.strip()) for number, line in enumerate(_text(path).splitlines(), 1))
    return [(number, line) for number, line in lines if line and not line.startswith("%")]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as a configuration ({error})") from None


def _require(path: Path, line: int, good: bool, problem: str) -> None:
    if not good:
        raise DataError(f"{path}:{line}: {problem}")


def _commands(path: Path) -> tuple[str, dict[str, list[tuple[int, list[float]]]]]:
    """Platform of the heading, and for every command its lines and arguments."""
    platform = ""
    commands: dict[str, list[tuple[int, list[float]]]] = {}
    for number, line in enumerate(_text(path).splitlines(), 1):
        if line.startswith("%"):
            if line.lstrip("% ").startswith("Platform:"):
                platform = line.partition(":")[2].strip()
            continue
        name, *words = line.split() or [""]
        wanted = _ARGUMENTS.get(name) or _OPTIONAL.get(name)
        if wanted:
            try:
                arguments = [float(word) for word in words]
            except ValueError:
                arguments = [math.nan]
            _require(path, number, all(map(math.isfinite, arguments)), f"{name} has an argument that is no number")
            if len(arguments) < wanted:
                raise DataError(f"{path}:{number}: {name} has {len(arguments)} arguments, expected {wanted}")
            commands.setdefault(name, []).append((number, arguments))
    return platform, commands


def _transmitter(path: Path, chirps: Sequence[tuple[int, list[float]]], chirp: int) -> int:
    """Which transmitter sends a chirp of the loop, from 1."""
    for line, arguments in chirps:
        if arguments[0] <= chirp <= arguments[1]:
            mask = int(arguments[7])
            _require(path, line, mask.bit_count() == 1, "chirpCfg must switch on exactly one transmitter at a time")
            return mask.bit_length()
    raise DataError(f"{path}: frameCfg uses chirp {chirp}, which no chirpCfg describes")


def radar_info(
    ti: TiConfig, tx: Sequence[int] = (), shape: tuple[int, int, int] = (0, 0, 0), *, frame_id: str = "radar", mount: Pose | None = None
) -> RadarInfo:
    """Describe the radar that a .cfg sets up; the waveform is what is sampled of each ramp.

    Parameters
    ----------
    ti : TiConfig
        From `read_ti_config`.
    tx : sequence of int
        Transmitters (from 1) in the order of their chirps; empty: as configured. A `DataError` says that the board has no such one.
    shape : tuple of int, length 3
        Receivers, chirps per transmitter, samples per chirp; 0: as configured. A `ConfigError` says that these last longer than a chirp.
    frame_id, mount : str, Pose or None
        Name of the sensor frame and where it stands; None: the default.
    """
    tx = tuple(tx) or ti.tx
    n_rx, n_chirp, n_sample = shape[0] or ti.n_rx, shape[1] or ti.n_loop, shape[2] or ti.n_sample
    sampled = n_sample / ti.sample_rate
    interval = ti.idle + ti.ramp_end
    if sampled > interval:
        raise ConfigError(f"n_sample = {n_sample} take {sampled * 1e6:.1f} us, longer than a chirp of the .cfg ({interval * 1e6:.1f} us)")
    waveform = Waveform(
        carrier=ti.start_hz + ti.slope * (ti.adc_start + sampled / 2),
        bandwidth=ti.slope * sampled,
        chirp_duration=sampled,
        chirp_pause=interval - sampled,
        frame_interval=ti.frame_interval,
        n_tx=len(tx),
        n_chirp=n_chirp,
        n_sample=n_sample,
    )
    array = board_array(ti.platform, tx, n_rx, waveform.carrier)
    return RadarInfo(frame_id=frame_id, waveform=waveform, array=array, mount=mount or Pose(), full_scale=_FULL_SCALE)


def board_array(platform: str, tx: Sequence[int], n_rx: int, carrier: float) -> AntennaArray:
    """Antennas of an evaluation board, with half a wavelength of ``carrier`` [Hz] between elements.

    Along the board's line the phase rises for targets on the right (TI's x), so the elements run to the left (our y); TX2 lies higher.
    ``tx`` are transmitters (from 1) in the order of the chirps, ``n_rx`` receivers, from the first. A `DataError` says that the board, e.g.
    xWR18xx, has no such transmitter.
    """
    half = SPEED_OF_LIGHT / carrier / 2
    known = _TWO_TX if platform.lower() == "xwr16xx" else _ELEMENT
    unknown = [t for t in tx if t not in known]
    if unknown:
        raise DataError(f"{platform or 'the board'} has no transmitter {unknown[0]}; it has {', '.join(map(str, known))}")
    return AntennaArray(tx=tuple((known[t][0] * half, known[t][1] * half) for t in tx), rx=tuple((k * half, 0.0) for k in range(n_rx)))
