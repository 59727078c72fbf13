"""Public recordings, in their originals' formats, as clouds, frames and truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from radar_core import ConfigError, DataError
from radar_core.config import describe, load
from radar_lab.importers.a121 import A121Options, read_a121
from radar_lab.importers.crossing import CrossingOptions, read_crossing
from radar_lab.importers.dca1000 import Dca1000BinOptions, Dca1000Options, read_dca1000, read_dca1000_bin
from radar_lab.importers.mars import MarsOptions, read_mars
from radar_lab.importers.npy import Bgt60Options, NpyOptions, read_bgt60, read_npy
from radar_lab.importers.openradar import OpenRadarOptions, read_openradar
from radar_lab.importers.radhar import RadharOptions, read_radhar
from radar_lab.importers.recording import Recording
from radar_lab.importers.segments import MHOMEGES, MTRANSSEE, SegmentOptions, read_segments


@dataclass(frozen=True)
class Kind:
    """One kind of recording: what it is, its options, and what reads it."""

    doc: str  # one sentence for users
    options: type[Any]  # configuration class; its knobs are the options
    read: Callable[[Path, Any], Recording]  # takes the path and the options, gives a `Recording`

    def help(self) -> list[str]:
        """One line per option: name, default, unit and meaning."""
        knobs = [(name, field.default, field.metadata) for name, field, _ in describe(self.options)]
        return [f"{name} = {default!r}{' ' if meta['unit'] else ''}{meta['unit']}: {meta['doc']}" for name, default, meta in knobs]


KINDS: Mapping[str, Kind] = {
    "crossing": Kind("dense clouds of walkers (.npz)", CrossingOptions, read_crossing),
    "mhomeges": Kind("arm gestures, mHomeGes (.npz, or .csv file or folder)", SegmentOptions, partial(read_segments, labels=MHOMEGES)),
    "mtranssee": Kind("arm gestures, mTransSee (.npz, or .csv file or folder)", SegmentOptions, partial(read_segments, labels=MTRANSSEE)),
    "mars": Kind("exercises with the joints' truth, MARS (.npz, or radar_data_*.csv with its kinect_data_*.csv)", MarsOptions, read_mars),
    "radhar": Kind("one person who walks or exercises, RadHAR (.npz, or .txt of one recording)", RadharOptions, read_radhar),
    "dca1000": Kind("network capture of a DCA1000 (.pcap) with the radar's .cfg", Dca1000Options, read_dca1000),
    "dca1000_bin": Kind(
        "samples that a DCA1000's tools recorded (.bin file, or folder of one recording) with the .cfg", Dca1000BinOptions, read_dca1000_bin
    ),
    "npy": Kind("raw frames of any radar (.npy) with its waveform and array", NpyOptions, read_npy),
    "bgt60": Kind("folder of Infineon's recorder for the BGT60TR13C", Bgt60Options, read_bgt60),
    "a121": Kind("sweeps of an A121 (.h5 of the maker's tools)", A121Options, read_a121),
    "openradar": Kind("raw frames of OpenRadar (.npy)", OpenRadarOptions, read_openradar),
}
"""What can be imported."""


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
