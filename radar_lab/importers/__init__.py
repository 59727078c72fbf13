"""Public recordings, in their originals' formats, as clouds, frames and truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from radar_core import ConfigError, DataError
from radar_core.config import describe, load
from radar_lab.importers.a121 import A121Options, read_a121
from radar_lab.importers.crossing import CrossingOptions, read_crossing
from radar_lab.importers.dca1000 import Dca1000BinOptions, Dca1000Options, read_dca1000, read_dca1000_bin
from radar_lab.importers.layouts import LayoutOptions, read_layout
from radar_lab.importers.mars import MarsOptions, read_mars
from radar_lab.importers.npy import Bgt60Options, NpyOptions, read_bgt60, read_npy
from radar_lab.importers.radhar import RadharOptions, read_radhar
from radar_lab.importers.recording import Recording
from radar_lab.importers.segments import MHOMEGES, MTRANSSEE, SegmentOptions, read_segments


@dataclass(frozen=True)
class Kind:
    """One kind of recording: the whole of what is known about it, its options, and what reads it."""

    doc: str  # one sentence for users
    options: type[Any]  # configuration class; its knobs are the options
    read: Callable[[Path, Any], Recording]  # takes the path and the options, gives a `Recording`
    axes: str  # of the file
    units: str  # of the file
    frame_time: str  # from one frame to the next, and where stamps come from
    truth: str  # what is known of what really happened
    licence: str
    good_for: str  # as frozen data

    def help(self) -> list[str]:
        """One line per option: name, default, unit and meaning."""
        knobs = [(name, field.default, field.metadata) for name, field, _ in describe(self.options)]
        return [f"{name} = {default!r}{' ' if meta['unit'] else ''}{meta['unit']}: {meta['doc']}" for name, default, meta in knobs]

    def facts(self) -> list[tuple[str, str]]:
        """Name and value of everything that is known of it, in the order in which a page shows it."""
        names = ("axes", "units", "frame_time", "truth", "licence", "good_for")
        return [(name.replace("_", " "), getattr(self, name)) for name in names]


_POINTS: Final = {
    "axes": "rows of points: frame, points in frame, right, forward, up, range rate, intensity; one segment follows the other",
    "units": "m, m/s (.npz: mm, mm/s), intensity as amplitude",
    "frame_time": "0.1 s by the option frame_interval; the files count frames and have no times",
    "truth": "label and person of each segment; distance from the radar in .npz",
    "licence": "MIT",
}
_OWN: Final = {"truth": "what you know", "licence": "yours"}
KINDS: Final[Mapping[str, Kind]] = {
    "crossing": Kind(
        "dense clouds of walkers (.npz)",
        CrossingOptions,
        read_crossing,
        axes="points of all frames: right, forward, up (from 0.7 m below the radar), range, azimuth, elevation, range rate, power; offset",
        units="m, rad, m/s, dB",
        frame_time="33.4 ms: the line through frame numbers and a logger's times",
        truth="one walker, or two who cross once; nobody's place",
        licence="MIT",
        good_for="swaps and ghosts of trackers on dense clouds",
    ),
    "mhomeges": Kind(
        "arm gestures, mHomeGes (.npz, or .csv file or folder)",
        SegmentOptions,
        partial(read_segments, labels=MHOMEGES),
        **_POINTS,
        good_for="events and names of arm gestures; false alarms in daily life (daily_random.npz)",
    ),
    "mtranssee": Kind(
        "arm gestures, mTransSee (.npz, or .csv file or folder)",
        SegmentOptions,
        partial(read_segments, labels=MTRANSSEE),
        **_POINTS,
        good_for="arm gestures of people and rooms that a model was not trained on",
    ),
    "mars": Kind(
        "exercises with the joints' truth, MARS (.npz, or radar_data_*.csv with its kinect_data_*.csv)",
        MarsOptions,
        read_mars,
        axes="points of all frames: right, forward, up, range rate, intensity; joints of each frame: right, forward, up",
        units="m, m/s, intensity as amplitude",
        frame_time="0.1 s by the option frame_interval; no times in the files",
        truth="25 joints of a Kinect for each frame, both hands among them; one person",
        licence="MIT",
        good_for="places of body and hands, against a camera",
    ),
    "radhar": Kind(
        "one person who walks or exercises, RadHAR (.npz, or .txt of one recording)",
        RadharOptions,
        read_radhar,
        axes="points: forward, left, up, range rate, intensity",
        units="m, m/s, dB (.npz: mm, mm/s, hundredths of dB)",
        frame_time="33 ms; stamps as the computer took them, 2 and 58 ms apart, or regular",
        truth="exactly one person; what they do",
        licence="BSD-3-Clause",
        good_for="how many people are counted; stamps that come in pairs",
    ),
    "dca1000": Kind(
        "network capture of a DCA1000 (.pcap) with the radar's .cfg",
        Dca1000Options,
        read_dca1000,
        axes="packets with number and place; in a frame: chirp, transmitter, receiver, sample, in pairs of Q and I",
        units="counts of 16 bits",
        frame_time="frameCfg of the .cfg; the first packet's time",
        truth="none",
        licence="yours; mmwave-capture-std's capture: BSD-3-Clause-Clear",
        good_for="the packets' reader, on bytes of a real board",
    ),
    "dca1000_bin": Kind(
        "samples that a DCA1000's tools recorded (.bin file, or folder of one recording) with the .cfg",
        Dca1000BinOptions,
        read_dca1000_bin,
        axes="chirp, transmitter, receiver, sample, in pairs of Q and I, or as the .mmwave.json says",
        units="counts of 16 bits",
        frame_time="frameCfg of the .cfg, or the .mmwave.json; stamps are made",
        **_OWN,
        good_for="your own room",
    ),
    "npy": Kind(
        "raw frames of any radar (.npy) with its waveform and array",
        NpyOptions,
        read_npy,
        axes="as the option axes says",
        units="any, real or complex",
        frame_time="the waveform's frame_interval; stamps are made",
        **_OWN,
        good_for="your own room",
    ),
    "bgt60": Kind(
        "folder of Infineon's recorder for the BGT60TR13C",
        Bgt60Options,
        read_bgt60,
        axes="frame, receiver, chirp, sample (real)",
        units="share of the converter's range",
        frame_time="config.json; stamps are made",
        **_OWN,
        good_for="your own room",
    ),
    "bgt60_eth": Kind(
        "hand gestures near the radar, ETH's BGT60 set (.npy of one person and gesture)",
        LayoutOptions,
        partial(read_layout, name="bgt60_eth"),
        axes="recording (50, of person_00 700), frame (16), chirp (96), sample (16, real), receiver (3)",
        units="counts of the converter",
        frame_time="74 ms (13.5 a second); stamps are made",
        truth="person and gesture, by the folders' names",
        licence="not on the page that was read: see the set's",
        good_for="gestures within 0.3 m of a BGT60TR13C",
    ),
    "cubelearn": Kind(
        "hand gestures, arm gestures or activities, CubeLearn (.npy of one)",
        LayoutOptions,
        partial(read_layout, name="cubelearn"),
        axes="real and imaginary part, frame (10 or 20), chirp (128), channel (12: a row of 8, 4 above), sample (256)",
        units="counts of the converter",
        frame_time="0.1 s; stamps are made. Slope, sample rate and chirp interval are not on the set's page: options",
        truth="person and number of the gesture or activity, by the file's name",
        licence="its code Apache-2.0; none is named for the data",
        good_for="raw frames of gestures before an IWR6843",
    ),
    "a121": Kind(
        "sweeps of an A121 (.h5 of the maker's tools)",
        A121Options,
        read_a121,
        axes="frame, sweep, distance; one channel of I and Q",
        units="counts of 16 bits; distances in steps of 2.5 mm",
        frame_time="the board's ticks",
        truth="what you know",
        licence="yours; the recordings in the maker's tests: BSD-3-Clause-Clear",
        good_for="presence, breath and gestures of one channel",
    ),
    "openradar": Kind(
        "raw frames of OpenRadar (.npy)",
        LayoutOptions,
        partial(read_layout, name="openradar"),
        axes="frame (may be missing), chirp, channel, sample (complex)",
        units="counts of 16 bits, stored as unsigned",
        frame_time="50 ms by the option frame_interval; stamps are made",
        truth="a mover at range bin 60, Doppler bin +7",
        licence="Apache-2.0",
        good_for="range and Doppler of a mover, in bins",
    ),
}
"""What can be imported: the registry of recordings."""


def listing() -> str:
    """Say in a few lines for each kind what it is and what is known of it."""
    lines: list[str] = []
    for name, kind in KINDS.items():
        lines += [f"{name}: {kind.doc}", *(f"    {fact}: {value}" for fact, value in kind.facts())]
        lines += [f"    -o {line}" for line in kind.help()]
    return "\n".join(lines)


def open_original(kind: str, source: Path, **options: Any) -> Recording:
    """Open a recording in its original format, without writing anything.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    source : Path
        File, or folder where the kind has several files.
    **options : Any
        Knobs of the kind's options.

    Raises
    ------
    ConfigError, DataError
        When there is no such kind or option; when the file is missing or its content is not what the kind says, naming file and field.
    """
    if kind not in KINDS:
        raise ConfigError(f"there is no kind of recording called {kind!r}; choose one of {', '.join(KINDS)}")
    source = Path(source)
    config = load(KINDS[kind].options, options, f"options of {kind}")
    if not source.exists():
        raise DataError(f"{source}: there is no such file or folder; check the path")
    return KINDS[kind].read(source, config)
