"""What `handwave demo` says at its end: three sentences, then the figures."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

_GOSPA_PARTS = {"localisation": "localisation", "missed": "missed", "false_tracks": "false tracks"}
_BUSY = 0.05  # share of frames left out from which a machine counts as too busy
_WORDS = (
    "MOTA: share of the people in all frames who were tracked, less ghosts and mix-ups; 100 % is perfect",
    "GOSPA: distance between people and their tracks, in which a person too many or too few counts 0.7 m; 0 m is perfect",
)


def missing_of(report: dict[str, Any]) -> list[str]:
    """Say what should have been seen and was not; empty: something was seen."""
    if not report["frames"]:
        return ["no frame came: the simulated radar never began"]
    if not report["received"]:
        return [f"{report['frames']} frames came, but no tracks: the messages of baseband and tracking say why (--verbose)"]
    if report.get("stalled"):
        return [f"after {report['frames']} frames no more came, although the scene was not over: the driver hangs (--verbose)"]
    if "people" not in report:
        return ["tracks came, but the evaluation node wrote no report: nothing tells how good they were"]
    people = [person["tracked_fraction"] for person in report["people"].values() if person["tracked_fraction"] is not None]
    if people and not any(people):
        return [f"of {_count(len(people), 'person', 'people')} in view nobody was found: try a longer --duration, or another scene"]
    return []


def sentences(report: dict[str, Any]) -> list[str]:
    """Say in three sentences who was seen, which gestures were named, and how the machine kept up."""
    return [_people(report), _gestures(report), _pace(report)]


def _people(report: dict[str, Any]) -> str:
    people = report.get("people", {})
    seen = {name: person["tracked_fraction"] for name, person in people.items() if person["tracked_fraction"] is not None}
    if not seen:
        return "Nobody was in view."
    found = sum(share > 0 for share in seen.values())
    each = ", ".join(f"person {name} for {share:.0%} of the time in view" for name, share in seen.items())
    return f"{found} of {_count(len(seen), 'person was', 'people were')} seen: {each}."


def _gestures(report: dict[str, Any]) -> str:
    gestures = report.get("gestures")
    if not gestures or not gestures["total"]:
        return "Nobody made a gesture."
    false = gestures["false_gestures"]
    more = f", and {_count(false, 'was', 'were')} named that nobody made" if false else ""
    text = f"{gestures['hits']} of {_count(gestures['total'], 'gesture was', 'gestures were')} named right"
    return f"{text}, {gestures['wrong']} wrong, {gestures['misses']} missed{more}."


def _pace(report: dict[str, Any]) -> str:
    if report.get("latency_ms_median") is None:
        return "No frame went all the way to tracks."
    dropped = report["dropped_fraction"] or 0.0
    fast = f"People's places came {report['latency_ms_median']:.0f} ms after the radar's frame (median)"
    if dropped < _BUSY:
        return f"{fast}, and the machine kept up: {1 - dropped:.1%} of {report['frames']} frames were used."
    return f"{fast}, but the machine did not keep up: {dropped:.0%} of {report['frames']} frames were left out."


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def show_report(report: dict[str, Any], console: Console) -> None:
    """Print three sentences, the table of what was recognised, and the figures of the run."""
    for what in report.get("missing", []):
        console.print(f"Missing: {what}", style="red", highlight=False, soft_wrap=True)
    for sentence in sentences(report):
        console.print(sentence, highlight=False)
    table = Table("time [s]", "person", "performed", "recognised", "", title="gestures: performed and recognised")
    outcomes = report.get("gestures", {}).get("outcomes", [])
    first = outcomes[0]["time_s"] if outcomes else 0.0
    for row in outcomes:
        verdict = "[green]right" if row["performed"] == row["recognised"] else "[red]wrong"
        time_s = f"{row['time_s'] - first:+.1f}"
        table.add_row(time_s, str(row["person"]), row["performed"], row["recognised"] or "-", verdict)
    if outcomes:
        console.print(table)
    figures = Table(title="figures", show_header=False)
    for name, value in _figures(report):
        figures.add_row(name, value)
    console.print(figures)
    for line in _WORDS:
        console.print(line, highlight=False)


def _number(value: Any, form: str, unit: str = "") -> str:
    """Format a figure; "-" where nothing is known of it."""
    return "-" if value is None else f"{value:{form}}{unit}"


def _figures(report: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, person in report.get("people", {}).items():
        seen, switches = _number(person["tracked_fraction"], ".0%"), person["identity_switches"]
        text = f"tracked {seen} of the time in view, {switches} identity switches, "
        rows.append((f"person {name}", text + f"position {_number(person['position_rms_m'], '.2f', ' m')} rms"))
    gestures, hand = report.get("gestures", {}), report.get("hand", {})
    if gestures:
        share = f" ({gestures['hits'] / gestures['total']:.0%})" if gestures["total"] else ""
        text = f"{gestures['hits']} of {gestures['total']} right{share}, {gestures['wrong']} wrong, {gestures['misses']} missed, "
        rows.append(("gestures", text + f"{gestures['false_gestures']} false"))
    followed = _number(hand.get("tracked_fraction"), ".0%")
    rows.append(("hand", f"{_number(hand.get('rms_m'), '.2f', ' m')} rms, followed {followed} of its drawing"))
    ghosts = f"{report.get('ghost_track_frames', '-')} of {report.get('track_frames', '-')} track-frames"
    rows.append(("ghosts", f"{ghosts} on nobody (gate {_number(report.get('gate_m'), '.1f', ' m')})"))
    gospa = report.get("gospa", {})
    parts = ", ".join(f"{text} {_number(gospa.get(key), '.3f')}" for key, text in _GOSPA_PARTS.items())
    rows.append(("MOTA", _number(report.get("mota"), ".1%")))
    rows.append(("GOSPA", f"{_number(gospa.get('mean_m'), '.2f', ' m')} mean; parts in m²: {parts}"))
    median, p99 = _number(report.get("latency_ms_median"), ".1f"), _number(report.get("latency_ms_p99"), ".1f")
    rows.append(("frame to tracks", f"{median} ms median, {p99} ms 99th percentile"))
    rows.append(("dropped", f"{_number(report.get('dropped_fraction'), '.2%')} of {report.get('frames')} frames"))
    rows.append(("processor", ", ".join(f"{name} {used:.0f} %" for name, used in report.get("cpu_percent", {}).items())))
    if report.get("interrupted"):
        rows.append(("interrupted", "these are the figures until then"))
    rows.append(("crashes", ", ".join(report.get("crashes", [])) or "none"))
    rows.append(("recording", str(report.get("bag"))))
    return rows
