"""The real captures of a DCA1000, where they are there."""

import os
from collections import Counter
from pathlib import Path

import pytest

from radar_lab.importers.pcap import read_datagrams


def recordings(*parts):
    """A file of the real recordings, or skip."""
    folder = Path(os.environ.get("HANDWAVE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
    path = folder.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"the recording {'/'.join(parts)} is not in {folder}; HANDWAVE_DATA names the folder with the recordings")
    return path


def captured_replies():
    """What a real board answered."""
    return [d.payload for d in read_datagrams(recordings("dca1000", "test_cmd.pcap"), Counter())]


def captured_samples():
    """The data packets of a real board: one frame of 16 chirps, one receiver, 256 samples."""
    return [d.payload for d in read_datagrams(recordings("dca1000", "test_one_frame.pcap"), Counter()) if d.port == 4098]
