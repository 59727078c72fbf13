"""Write the pages of docs/reference that the code says itself: messages, topics, parameters and commands.

    python docs/make_reference.py            # writes them
    python docs/make_reference.py --check    # says which are out of date, status 1

Nodes are made, never run: discovery is off and nothing is sent. The same code gives the same pages.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"
os.environ["HANDWAVE_MQTT_PASSWORD"] = ""

import rclpy
import typer
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from radar_app.graph import NODES
from radar_driver import boards

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
NOTE = "<!-- Made by docs/make_reference.py from the code; edit the code instead. -->"
STANDARD = ("use_sim_time", "start_type_description_service")
SHARED = ("reliable", "stale_after")
OPEN = 1e300  # limits beyond this are none
DEFAULTS = {("driver", "autostart"): "true", ("recorder", "bag"): "(needed)"}  # of parameters that are set here so that a node can be made


def cell(text: str) -> str:
    """Text that fits into one cell of a table."""
    return " ".join(text.split()).replace("|", r"\|").replace("<", "&lt;").replace("*", r"\*")


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Rows as a table in Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines)


# messages


def parsed(text: str) -> Iterator[tuple[str, str, str]]:
    """Type, name and comment of each line of a definition; a comment alone has no type; ``---`` is a type by itself."""
    for line in text.splitlines():
        code, _, comment = line.partition("#")
        words = code.split(None, 1)
        if words[:1] == ["---"]:
            yield "---", "", ""
        elif words:
            yield words[0], words[1].strip(), comment.strip()
        elif comment.strip():
            yield "", "", comment.strip()


def definition(path: Path) -> str:
    """One message or service as a section."""
    lines = list(parsed(path.read_text(encoding="utf-8")))
    start = next((i for i, line in enumerate(lines) if line[0]), len(lines))
    parts = [f"## {path.stem}", " ".join(comment for *_, comment in lines[:start])]
    rows: list[tuple[str, ...]] = []
    for kind, name, comment in lines[start:]:
        if kind == "---":
            parts += [table(("request", "type", "meaning"), rows)]
            rows = []
        elif kind:
            rows.append((f"`{re.sub(' *= *', ' = ', name)}`", f"`{kind}`", cell(comment)))
        elif rows and rows[-1][1]:
            rows.append(("", "", cell(comment)))
        elif rows:
            rows[-1] = ("", "", f"{rows[-1][2]} {cell(comment)}")
    parts.append(table(("answer" if path.suffix == ".srv" else "field", "type", "meaning"), rows))
    return "\n\n".join(parts)


def messages() -> str:
    """All messages and services."""
    files = [*sorted((ROOT / "msg").glob("*.msg")), *sorted((ROOT / "srv").glob("*.srv"))]
    head = (
        "# Messages and services\n\nThe package is `handwave`: `from handwave.msg import TrackArray`. Lengths are metres, angles radians, "
        "times seconds.\nWhat is not measured is NaN. Empty cells on the left hold remarks about the fields around them."
    )
    return "\n\n".join([head, *map(definition, files)])


# nodes


def node(name: str, **parameters: Any) -> Any:
    """Make a node with some parameters."""
    given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    arguments = ["--ros-args", "--log-level", "fatal", *given]
    return importlib.import_module(NODES[name].module).make_node(cli_args=arguments, use_global_arguments=False)


def made(folder: str) -> Iterator[tuple[str, Any]]:
    """Every node, once; the driver with each kind of source, whose name follows a colon. The recorder may write into the folder."""
    from radar_ros.home.broker import Link

    Link.start = lambda self: None  # type: ignore[method-assign]  # nothing is sent anywhere
    for name in NODES:
        if name == "driver":
            ours = {module.name for module in pkgutil.iter_modules(boards.__path__)} - {
                "sim",
                "bag",
            }  # other people's are not of this project
            for source in ("sim", "bag", *sorted(ours)):
                yield f"driver:{source}", node("driver", source=source, autostart="false")
        else:
            yield name, node(name, **({"bag": f"{folder}/bag"} if name == "recorder" else {}))


def limits(found: Any) -> str:
    """Range of a parameter, or its choices."""
    for span in (*found.floating_point_range, *found.integer_range):
        low, high = (f"{value:g}" if abs(value) < min(OPEN, 2**61 if isinstance(value, int) else OPEN) else "" for value in
                     (span.from_value, span.to_value))  # fmt: skip
        return f"{low} to {high}" if low and high else f"from {low}" if low else f"to {high}" if high else ""
    return found.additional_constraints.removeprefix("one of ").replace("'", "`")


def shown(value: Any) -> str:
    """Value of a parameter as a person writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, str):
        return value or "(empty)"
    if value is None:
        return "(none)"
    if isinstance(value, (int, Path)):
        return str(value)
    return "[" + ", ".join(map(shown, value)) + "]"


def knobs(made_node: Any) -> dict[str, tuple[str, ...]]:
    """Rows of a node's own parameters by name."""
    rows = {}
    for name in made_node._parameters:
        if name in STANDARD or name.startswith("qos_overrides."):
            continue
        found = made_node.describe_parameter(name)
        value = made_node.get_parameter(name).value
        default = DEFAULTS.get((made_node.get_name(), name), shown(value))
        run_time = "" if found.read_only else "yes"
        rows[name] = (f"`{name}`", f"`{cell(default)}`", cell(limits(found)), run_time, cell(found.description))
    return rows


def parameters(found: Mapping[str, dict[str, tuple[str, ...]]]) -> str:
    """All parameters of all nodes."""
    head = ("parameter", "default", "range", "while it runs", "meaning")
    common = found["tracking"]
    driver = {name: row for name, row in found["driver:sim"].items() if all(name in rows for key, rows in found.items() if ":" in key)}
    parts = [
        "# Parameters of the nodes",
        "Set one with `handwave up --param node.parameter=value`, or a file of them with `--config node=FILE`. Where *while it runs* says "
        "`yes`, `ros2 param set` changes it in a running graph; others are read at the start. Units stand in brackets after the meaning.",
        "Lists of lists, and settings that are empty by default, are set in YAML files only. The code's configuration classes name them.",
        "## Every node",
        table(head, [common[name] for name in SHARED]),
    ]
    for name, rows in found.items():
        own = {key: row for key, row in rows.items() if key not in SHARED}
        if name == "driver:sim":
            parts += ["## driver", table(head, [row for key, row in driver.items() if key not in SHARED and key != "source"])]
            source = driver["source"]
            parts.append(f"`source` (default `sim`): {source[4]}. The parameters of each source:")
        if ":" in name:
            own = {key: row for key, row in own.items() if key not in driver}
            if not own:
                continue
            name = f"driver with source {name.partition(':')[2]}"
        parts += [f"{'###' if 'source' in name else '##'} {name}", table(head, list(own.values())) if own else "None of its own."]
    return "\n\n".join(parts)


def profile(found: Any) -> str:
    """Quality of service in words."""
    words = ["reliable" if found.reliability == ReliabilityPolicy.RELIABLE else "best effort", f"last {found.depth}"]
    return ", ".join([*words, *(["latched"] if found.durability == DurabilityPolicy.TRANSIENT_LOCAL else [])])


def kind_of(message: type) -> str:
    """Type of a message or service as ROS writes it."""
    package, kind, *_ = message.__module__.split(".")
    return f"{package}/{kind}/{message.__name__}"


Ends = dict[str, tuple[str, dict[str, list[str]], dict[str, list[str]]]]


def connections(ends: Ends, name: str, made_node: Any) -> None:
    """Add the topics of a node: type, who publishes with which quality of service, who reads with which."""
    latched = {each.topic_name for each in made_node.subscriptions if each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL}
    publishers = () if name == "bridge" else made_node.publishers  # what it publishes depends on the packages that are installed
    for side, endpoints in ((1, publishers), (2, () if name == "recorder" else made_node.subscriptions)):
        for each in endpoints:
            if side == 2 and each.topic_name in latched and each.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL:
                continue  # the second reader of a latched topic, for publishers that do not latch
            topic = each.topic_name if each.topic_name in ("/diagnostics", "/tf", "/tf_static") else each.topic_name.removeprefix("/")
            if topic in ("parameter_events", "rosout", "clock"):
                continue
            entry = ends.setdefault(topic, (kind_of(each.msg_type), {}, {}))
            who = entry[side].setdefault(profile(each.qos_profile), [])
            if name not in who:
                who.append(name)


def topics(ends: Ends, services: list[tuple[str, ...]]) -> str:
    """All topics and services."""

    def side(found: dict[str, list[str]]) -> str:
        return "; ".join(f"{', '.join(names) if len(names) < 12 else 'every node'} ({how})" for how, names in found.items()) or "-"

    rows = [(f"`{topic}`", f"`{kind}`", side(out), side(into)) for topic, (kind, out, into) in sorted(ends.items())]
    return "\n\n".join(
        [
            "# Topics and services",
            "Names are relative to the namespace of a graph, but for those that begin with a slash. In brackets: reliability, how many "
            "messages wait, and *latched* (transient local) where late readers get the last message too.",
            "Streams are offered reliably and read with best effort: the newest frame wins when a computer is too slow, and a recorder "
            "still misses nothing. With the parameter `reliable: true` the stages read them reliably too.",
            "`cloud2` reads the topic that its parameter `topic` names, `fusion` the namespaces in `radars` (here `left` and `right`). "
            "The driver publishes what its board gives: frames, points or tracks. `board/...` is what a board finds itself beside its "
            "points, and `radar/pose` a measured mount. The recorder reads everything; `visualisation` reads `radar/points` too while "
            "somebody listens to `tracks/points2`. What `bridge` publishes stands with [ROS](../how-to/ros.md).",
            table(("topic", "type", "published by", "read by"), rows),
            "## Services",
            table(("service", "type", "node"), services),
        ]
    )


def nodes() -> tuple[str, str]:
    """Parameters and topics, from one round through all nodes."""
    rclpy.init(args=["--ros-args", "--log-level", "fatal"])
    found: dict[str, dict[str, tuple[str, ...]]] = {}
    ends: Ends = {}
    services: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, each in made(folder):
            found[name] = knobs(each)
            connections(ends, name.partition(":")[0], each)
            for service in each.services:
                if kind_of(service.srv_type).startswith(("handwave/", "std_srvs/")):
                    services.append((f"`{service.srv_name.removeprefix('/')}`", f"`{kind_of(service.srv_type)}`", name))
            each.destroy_node()
        rclpy.shutdown()
    return parameters(found), topics(ends, services)


# commands


def unsaid(default: Any) -> bool:
    """Whether a default says nothing to a reader."""
    return default is None or default is False or callable(default) or "Sentinel" in repr(default) or default in ("", [], ())


def command_rows(command: Any) -> list[tuple[str, ...]]:
    """Arguments and options of a command."""
    rows = []
    for given in command.params:
        if given.name == "help":
            continue
        argument = given.param_type_name == "argument"
        words = given.name.upper() if argument else ", ".join([*given.opts, *given.secondary_opts])
        default = "" if unsaid(given.default) else f"`{cell(shown(given.default))}`"
        rows.append((f"`{words}`", default or ("required" if given.required else ""), cell(given.help or "")))
    return rows


def command_parts(command: Any, name: str) -> Iterator[str]:
    """Sections of a command and those below it."""
    if hasattr(command, "commands"):
        if " " in name:
            yield f"## {name}"
            yield (command.help or "").strip()
        for child in sorted(command.commands):
            if not command.commands[child].hidden:
                yield from command_parts(command.commands[child], f"{name} {child}")
        return
    yield f"{'###' if name.count(' ') > 1 else '##'} {name}"
    yield re.sub(r"\n[ ]+", "\n", (command.help or "").strip())
    if rows := command_rows(command):
        yield table(("option or argument", "default", "meaning"), rows)


def commands() -> str:
    """Every subcommand."""
    from radar_app.cli import app

    head = "# Commands\n\n`handwave --help` says the same in a terminal, and each command has `--help`."
    return "\n\n".join([head, *(part for part in command_parts(typer.main.get_command(app), "handwave") if part)])


def formats() -> str:
    """List what `handwave import` reads."""
    from radar_core.config import describe
    from radar_lab.importers import KINDS

    parts = ["# Formats that can be imported", "`handwave import KIND FILE --out BAG -o option=value`; each kind with its options."]
    overview = [(f"[`{name}`](#{name})", *map(cell, (kind.doc, kind.truth, kind.licence, kind.good_for))) for name, kind in KINDS.items()]
    parts.append(table(("kind", "what it is", "truth", "licence", "good for, as data that stays as it is"), overview))
    for name, kind in KINDS.items():
        rows = []
        for option, field, _ in describe(kind.options):
            unit = f" [{field.metadata['unit']}]" if field.metadata["unit"] else ""
            rows.append((f"`{option}`", f"`{cell(shown(field.default))}`", cell(field.metadata["doc"] + unit)))
        facts = [(fact, cell(value)) for fact, value in kind.facts()]
        parts += [f"## {name}", f"{kind.doc[0].upper()}{kind.doc[1:]}.", table(("known", "of this kind"), facts)]
        parts += [table(("option", "default", "meaning"), rows)]
    return "\n\n".join(parts)


def pages() -> dict[Path, str]:
    """All pages by path."""
    about_parameters, about_topics = nodes()
    texts = {"messages": messages(), "topics": about_topics, "parameters": about_parameters, "commands": commands(), "formats": formats()}
    made_pages = {}
    for name, text in texts.items():
        title, rest = text.strip().split("\n", 1)  # the title stands first: it is what MkDocs calls the page
        made_pages[HERE / "reference" / f"{name}.md"] = f"{title}\n\n{NOTE}\n{rest}\n"
    return made_pages


def main() -> int:
    """Write the pages, or say which are out of date."""
    old = []
    for path, text in pages().items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            old.append(str(path.relative_to(ROOT)))
            if "--check" not in sys.argv:
                path.write_text(text, encoding="utf-8")
    if "--check" in sys.argv and old:
        print(f"{', '.join(old)}: not what the code says; run python docs/make_reference.py")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
