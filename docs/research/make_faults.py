"""Write the table of docs/research/faults.md from what `python -m benchmarks faults --json --keep FOLDER` kept in FOLDER."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.faults import GROUPS, figures

PAGE = Path(__file__).parent / "faults.md"
BEGIN, END = "<!-- faults -->\n", "<!-- /faults -->\n"


def row(one: dict[str, Any]) -> str:
    """Draw one line of the table."""
    words = one["words"].replace("|", "\\|").replace("<", "&lt;")
    cells = (one["fault"], one["means"], f"`{words}`", one["named"], "yes" if one["survived"] else "**no**")
    return "| " + " | ".join(map(str, (*cells, one["lost_acknowledged"], f"{one['recover_s']:.1f}"))) + " |"


def main(folder: Path) -> None:
    """Put figures and table between the marks of the page."""
    rows = [one for group in GROUPS for one in json.loads((folder / f"faults_{group}.json").read_text(encoding="utf-8"))]
    found = figures(rows)
    lines = [
        f"{found['faults']} faults: `survived_fraction` {found['survived_fraction']:.3f}, `unnamed` {found['unnamed']}, "
        f"`lost_acknowledged` {found['lost_acknowledged']}; recovery after {found['recover_s_median']:.1f} s (median), "
        f"{found['recover_s_worst']:.1f} s (worst).",
        "",
    ]
    for title, key in (("Not survived", "not_survived"), ("Not named once", "not_named_once")):
        if found[key]:
            lines += [f"{title}: {'; '.join(found[key])}.", ""]
    for group in GROUPS:
        heads = ["| fault | by | words | lines | survived | lost | s |", "|---|---|---|---:|---|---:|---:|"]
        lines += [f"### {group.capitalize()}", "", *heads]
        lines += [*(row(one) for one in rows if one["group"] == group), ""]
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.partition(BEGIN)[0], text.partition(END)[2]
    PAGE.write_text(before + BEGIN + "\n".join(lines) + END + after, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
