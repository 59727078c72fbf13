"""Random and hostile bytes on every parser: refused or read, never a crash, in bounded time and memory."""

import contextlib
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from benchmarks.fuzz import PARSERS, fuzz, fuzz_on, mutate
from radar_core import HandwaveError


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", PARSERS)
def test_hostile_bytes_are_refused_or_read(name):
    """A seeded corpus: inputs of the benchmark by their numbers, and bytes of hypothesis's own choice."""
    parser, key = PARSERS[name], zlib.crc32(name.encode())
    seeds = parser.seeds()

    @seed(28)
    @settings(max_examples=25, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(st.one_of(st.integers(0, 1 << 32), st.binary(max_size=300)))
    def feed(given_):
        with contextlib.suppress(HandwaveError):
            parser.read(mutate(seeds, np.random.default_rng([key, given_])) if isinstance(given_, int) else given_)

    feed()


@pytest.mark.parametrize("name", ["crossing", "mars", "model"])
def test_a_length_in_a_file_allocates_nothing(name):
    """An archive of a few hundred bytes whose header asks for a terabyte, or that is packed a thousandfold."""
    row = fuzz(name, 0.0)
    assert (row["crashes"], row["hangs"]) == (0, 0)
    assert row["peak_mb"] < 20


def test_what_goes_wrong_is_counted():
    """A parser that crashes, one that refuses, one that never ends, one that takes too much."""
    from benchmarks import fuzz as benchmark

    def read(data):
        kind = len(data) % 4
        if kind == 0:
            raise KeyError("oh")
        if kind == 1:
            raise HandwaveError("no")
        if kind == 2:
            bytearray(30_000_000)

    benchmark.PARSERS["bad"] = benchmark.Parser(lambda: [bytes(4)], lambda data: read(data) if data != bytes(4) else None)
    try:
        row = fuzz("bad", 60.0, most=60)
    finally:
        del benchmark.PARSERS["bad"]
    assert row["crashes"] > 0
    assert row["refused"] > 0
    assert row["peak_mb"] > 29
    assert row["crashing"].keys() == {"KeyError: 'oh'"}


@pytest.mark.parametrize("wait", [60.0, 0.05])
def test_what_never_ends_is_a_hang(monkeypatch, wait):
    """It is stopped, and counted; also where both times are up at once, as on a machine that slept."""
    from benchmarks import fuzz as benchmark

    monkeypatch.setattr(benchmark, "_HANG", 0.05)
    monkeypatch.setattr(benchmark, "_WAIT", wait)

    def read(data):
        while data != b"good":
            pass

    monkeypatch.setitem(benchmark.PARSERS, "endless", benchmark.Parser(lambda: [b"good"], read))
    assert fuzz("endless", 60.0, most=5)["hangs"] >= 3


def test_pieces_are_the_same_inputs_as_one_run(tmp_path, monkeypatch):
    """Kept after each piece, taken up by the next run, and begun anew once the seeds are others."""
    from benchmarks import fuzz as benchmark

    seen = []
    monkeypatch.setitem(benchmark.PARSERS, "kept", benchmark.Parser(lambda: [b"good"], seen.append))
    first = fuzz_on("kept", 0.05, tmp_path, piece=0.02)
    on = fuzz_on("kept", 0.1, tmp_path, piece=0.02)
    assert on["next"] == on["inputs"] > first["inputs"] > 0
    assert on["seconds"] >= 0.1
    fed = [data for data in seen if data != b"good"]
    seen.clear()
    fuzz("kept", 60.0, most=on["inputs"])
    assert fed == [data for data in seen if data != b"good"]
    assert fuzz_on("kept", 0.1, tmp_path)["inputs"] == on["inputs"]
    monkeypatch.setitem(benchmark.PARSERS, "kept", benchmark.Parser(lambda: [b"other"], seen.append))
    assert fuzz_on("kept", 0.001, tmp_path)["next"] < on["next"]


def test_a_busy_machine_is_no_hang(monkeypatch):
    """What is late but does not work is not counted by the clock, unless it waits for ever."""
    import time

    from benchmarks import fuzz as benchmark

    monkeypatch.setattr(benchmark, "_HANG", 0.02)
    monkeypatch.setitem(benchmark.PARSERS, "late", benchmark.Parser(lambda: [b"good"], lambda data: time.sleep(0.1)))
    assert fuzz("late", 60.0, most=3)["hangs"] == 0
    monkeypatch.setattr(benchmark, "_WAIT", 0.02)
    assert fuzz("late", 60.0, most=3)["hangs"] == 3
