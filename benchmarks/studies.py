"""The studies whose figures docs quote: the command of each, and why one has no stored result yet.

The result of a study is NAME.json in docs/research/figures: what its command printed. The NAME.json in the folder ``made`` there says by
which code it was made. `figures` makes them, `quotes` compares pages with them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.__main__ import PARTS
from benchmarks.report import checkout

TRADEOFF: Final = "handwave lab tradeoff"  # its result is a folder; stored is one file with what STAGE.json holds for each stage
LONG: Final = "not run since results are stored: takes minutes to hours of processor time"
GRAPH: Final = "not run since results are stored: measures the live graph, for which no other work may run beside it"
RECORDED: Final = "not run since results are stored: wants recordings, which HANDWAVE_DATA names"


@dataclass(frozen=True)
class Study:
    """What is run for one stored result."""

    command: str  # what follows ``python -m benchmarks``, without --json and --keep; or `TRADEOFF`
    absent: str = ""  # why no result is stored yet; empty: one is
    keep: str = ""  # folder of finished parts, whose names tell the code they depend on; empty: a folder for each state of all the code

    @property
    def module(self) -> str:
        """What the command runs: all that it imports decides about the result."""
        return "benchmarks.tradeoff.run" if self.command == TRADEOFF else f"benchmarks.{self.command.split()[0]}"

    @property
    def shown(self) -> str:
        """The command as a person types it."""
        return f"{TRADEOFF} -o FOLDER" if self.command == TRADEOFF else f"python -m benchmarks {self.command} --json"


STUDIES: Final[Mapping[str, Study]] = {
    "approaches": Study("approaches --parts cases", keep="approaches"),
    "approaches_ways": Study("approaches --parts ways", keep="approaches"),
    "board_gestures": Study("board_gestures"),
    "boards": Study("boards"),
    "budget": Study("budget"),
    "calibrate_array": Study("calibrate_array"),
    "calibrate_pair": Study("calibrate_pair", keep="calibrate_pair"),
    "calibrate_tilt": Study("calibrate_tilt", keep="calibrate_tilt"),
    "chain": Study("chain"),
    "doctor": Study("doctor"),
    "dsp": Study("dsp"),
    "effects": Study("effects"),
    "faults": Study("faults"),
    "fuzz": Study("fuzz", LONG),
    "gesture_comparison": Study("gesture_comparison"),
    "gesture_crowds": Study("gesture_crowds", keep="gesture_streams"),
    "gesture_fusion": Study("gesture_fusion"),
    "gesture_knobs": Study("gesture_knobs"),
    "gesture_ladder": Study("gesture_ladder", keep="gesture_ladder"),
    "gesture_model": Study("gesture_model"),
    "gesture_motion": Study("gesture_motion", LONG, keep="gesture_motion"),
    "gesture_motion_usual": Study("gesture_motion --parts told,usual", LONG, keep="gesture_motion"),
    "gesture_networks": Study("gesture_networks", keep="gesture_tables"),
    "gesture_rooms": Study("gesture_rooms", LONG, keep="rooms"),
    "gesture_rooms_first": Study("gesture_rooms --seeds first", keep="rooms"),
    "gesture_streams": Study("gesture_streams", keep="gesture_streams"),
    "gesture_tables": Study("gesture_tables", keep="gesture_tables"),
    "gesture_worlds": Study("gesture_worlds"),
    "gestures_daily": Study("gestures_daily", keep="gestures_daily"),
    "gestures_end_to_end_mhomeges": Study("gestures_end_to_end --parts mhomeges", keep="gestures_end_to_end"),
    "gestures_end_to_end_mtranssee": Study("gestures_end_to_end --parts mtranssee", keep="gestures_end_to_end"),
    "gestures_enrolled": Study("gestures_enrolled", keep="gestures_enrolled"),
    "gestures_people": Study("gestures_people", keep="gestures_people"),
    "gestures_people_random": Study("gestures_people --parts random", LONG, keep="gestures_people"),
    "gestures_real": Study("gestures --real", keep="gestures_real"),
    "gestures_shipped": Study("gestures_shipped"),
    "gestures_speed": Study("gestures_speed"),
    "gestures_transfer": Study("gestures_transfer", keep="gestures_transfer"),
    "graph": Study("graph"),
    "graph_costs": Study("graph_costs"),
    "hand": Study("hand", keep="hand"),
    "hand_losses": Study("hand_losses", keep="hand"),
    "hand_mars": Study("hand_mars"),
    "hand_noise": Study("hand_noise", keep="hand"),
    "hand_velocity": Study("hand_velocity", keep="hand"),
    "living": Study("living", keep="living"),
    "load_steps": Study("load_steps"),
    "machines": Study("machines"),
    "motion_speeds": Study("motion_speeds"),
    "one_channel": Study("one_channel"),
    "one_channel_real": Study("one_channel --real", RECORDED),
    "people_real": Study("people_real", RECORDED),
    "people_real_develop": Study("people_real --kind develop --parts default,group_clustering"),
    "person_odds": Study("person_odds", RECORDED, keep="rooms"),
    "probe": Study("probe"),
    "ptp": Study("ptp"),
    "recorded_echoes": Study("recorded_echoes"),
    "recordings": Study("recordings"),
    "rooms": Study("rooms", LONG, keep="rooms"),
    "rooms_first": Study("rooms --seeds first", keep="rooms"),
    "simulator": Study("simulator"),
    "small": Study("small"),
    "soak": Study("soak --hours 1"),
    "stage_reports": Study("stage_reports"),
    "stream_choices": Study("stream_choices", LONG, keep="stream_model"),
    "stream_model": Study("stream_model", keep="stream_model"),
    "suite_first": Study("suite --seeds first", keep="suite"),
    "tracking": Study("tracking", LONG, keep="tracking"),
    "tracking_arms": Study("tracking --parts arms", keep="tracking"),
    "tradeoff": Study(TRADEOFF, f"{LONG}; config/tradeoff holds values that were rounded for the page", keep="tradeoff"),
    "vertex_rcs": Study("vertex_rcs"),
    "view": Study("view"),
    "vital_sitters": Study("vital --parts sitters"),
    "vital_sitting": Study("vital --parts sitting"),
    "waveforms": Study("waveforms"),
    "zones_latency": Study("zones --parts latency", keep="rooms"),
    "zones_nights": Study("zones --parts nights", keep="rooms"),
    "zones_rooms": Study("zones --parts rooms", keep="rooms"),
    "zones_stale": Study("zones --parts stale", GRAPH),
}
"""By name."""

_MENTION: Final = re.compile(r"-m benchmarks ([a-z_]+)|handwave (?:lab )?(tradeoff) (?:-o report|--stage)")


def folder() -> Path:
    """Give the folder of the stored results."""
    return checkout("docs", "research", "figures")


def pages() -> list[Path]:
    """Find the pages that may quote figures: the README, and all of docs."""
    return [checkout("README.md"), *sorted(checkout("docs").rglob("*.md"))]


def parts(name: str) -> tuple[str, ...]:
    """Name the studies of a benchmark's section in docs/research/benchmarks.md: itself, or those that it contains."""
    return (name,) if name in STUDIES else tuple(part for part in PARTS.get(name, ()) if part in STUDIES)


def of_command(benchmark: str) -> tuple[str, ...]:
    """Name the studies that a page means by ``python -m benchmarks BENCHMARK``; none: the table lacks one."""
    means = {benchmark, *PARTS.get(benchmark, ())}
    return tuple(name for name, study in STUDIES.items() if study.module.removesuffix(".run").split(".")[-1] in means)


def mentioned(text: str) -> Iterator[str]:
    """Yield the benchmarks whose command a page gives."""
    yield from dict.fromkeys(one or other for one, other in _MENTION.findall(text))
