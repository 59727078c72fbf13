"""Write the tables of docs/research/effects.md: ``python docs/research/make_effects.py [FIGURES.json]``.

The table of effects comes from the code; times and agreement are written anew when FIGURES.json holds what
``python -m benchmarks effects --json`` printed.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.progress import track

from radar_sim.audit import audit, ours, table
from radar_sim.effects.chain import NAMES

PAGE = Path(__file__).with_name("effects.md")


def put(text: str, name: str, part: str) -> str:
    """Replace what stands between the two marks of a name."""
    first, last = f"<!-- {name} -->\n\n", f"<!-- end of {name} -->\n"
    head, found, rest = text.partition(first)
    if not found or last not in rest:
        raise SystemExit(f"{PAGE} has no {first.strip()} ... {last.strip()}; put them where the table belongs")
    return head + first + part + last + rest.partition(last)[2]


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """Make a table; all columns but the first to the right."""
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def parts_of(deviation: dict[str, float]) -> str:
    """Write deviations by what deviates."""
    return ", ".join(f"{name} {value:.2%}" for name, value in deviation.items())


def times(result: dict[str, Any]) -> str:
    """Write times of a frame and what the runs agree on, scene by scene."""
    head = [
        "scene",
        "for",
        "as written",
        "`auto`",
        "all real",
        "everything",
        "`auto` / everything",
        "deviation of `auto`",
        "tolerance",
        "spread",
    ]
    rows = []
    for found in result["scenes"]:
        ms = found["frame_ms"]
        cells = [f"{ms[name]:.2f}" for name in ("written", "auto", "real", "everything")]
        agree = parts_of(found["deviation"])
        spread = parts_of(found["spread"]) if found["spread"] else ""
        ratio = f"{ms['auto'] / ms['everything']:.2f}"
        rows.append([found["label"], found["purpose"], *cells, ratio, agree, f"{found['tolerance']:.0%}", spread])
    seconds = [f"**{result[f'total_s_{name}']:.1f} s**" for name in ("written", "auto", "real", "everything")]
    agreed = f"**{result['scenes_that_agree']} of {result['scenes_audited']} agree**"
    ratio = f"**{result['auto_over_all_without_choosing']:.2f}**"
    return markdown(head, [*rows, ["**all frames**", "", *seconds, ratio, agreed, "", ""]])


def costs(result: dict[str, Any]) -> str:
    """Write what each effect adds to the time of a frame, scene by scene [ms]."""
    scenes = [found for found in result["scenes"] if found["cost_ms"]]
    rows = [[f"`{name}`", *(f"{found['cost_ms'][name]:.2f}" for found in scenes)] for name in NAMES]
    return markdown(["effect", *(found["label"].replace("_", " ") for found in scenes)], rows)


def total(result: dict[str, Any]) -> str:
    """Say what `auto` saves over all scenes."""
    within, audited = result["scenes_within_tolerance"], result["scenes_audited"]
    whole, real, choosing = result["auto_over_all"], result["auto_over_real"], result["auto_choosing_s"]
    return (
        f"`auto_over_all` is **{whole:.2f}** (demanded: at most 0.5), the {choosing:.1f} s of choosing once per scene included; {real:.2f} "
        f"against all that is real. {within} of {audited} are within the tolerance itself, the rest within the spread of another draw of "
        "the noise.\n"
    )


def main() -> None:
    """Write the page."""
    text = PAGE.read_text(encoding="utf-8")
    text = put(text, "audit", table([audit(*one) for one in track(list(ours()), "measuring effects")]))
    if len(sys.argv) > 1:
        result = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8").splitlines()[-1])
        text = put(put(text, "times", times(result)), "costs", costs(result))
        text = put(text, "total", total(result))
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
