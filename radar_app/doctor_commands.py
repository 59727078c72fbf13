"""`handwave doctor`: an executable tuning guide."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, cast

import typer

from radar_app.parameters import Configs, Domain, Json, Namespace, Params, parse_parameters, progress_bar
from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_app.doctor.reading import Parameters
    from radar_lab.doctor.evidence import Evidence
    from radar_lab.doctor.finding import Finding
    from radar_lab.mirrored_angle import Side

_AFTER: Final = "The first one may be the cause of those below: mend it, record again, and ask again."


def doctor(
    bag: Annotated[Path | None, typer.Argument(help="folder of a recording; without: the running graph")] = None,
    seconds: Annotated[float, typer.Option(help="how long to listen to the graph [s]", min=2.0, max=600.0)] = 10.0,
    walked: Annotated[str, typer.Option(help="left or right: to which side somebody walked meanwhile, as the radar looks")] = "",
    param: Params = None,
    config: Configs = None,
    domain: Domain = None,
    namespace: Namespace = "",
    as_json: Json = False,
) -> None:
    """Say what is wrong with a recording or with the running graph, and what to change.

    It measures everything that users report: nobody found, ghosts, merged people, people lost when they stand still, mirrored angles, low
    SNR, folded speed, losses, clocks, saturation, another radar, frames cut wrongly, a radar that does not describe itself. The likeliest
    fault comes first, each with its figure, its limit, and a line to paste. Remedies for the tracking were tried on the recording. Let
    somebody walk about meanwhile, towards the radar and away from it.

    With --param or --config of baseband or tracking, clouds and tracks are made anew with these settings.

    The exit status is 0 when nothing wrong was found, 1 when something was, 2 when nothing could be read.

    Examples: `handwave doctor my_recording` · `handwave doctor my_recording --walked left` · `handwave doctor --seconds 20`
    · `handwave doctor my_recording --param tracking.life.birth_snr=10 --json`
    """
    from radar_lab.doctor.examine import Told, examine

    if walked not in ("", "left", "right"):
        raise ConfigError(f"--walked {walked!r}: say left or right, as the radar looks")
    parameters = parse_parameters(param, config)
    radars, findings = _read(bag, seconds, parameters, domain, namespace, quiet=as_json)
    told = Told(cast("Side | None", walked or None), parameters.get("tracking"))
    found = (*findings, *examine(radars, told))
    if as_json:
        faults = [one.symptom for one in found if one.fault]
        print(json.dumps({"faults": faults, "findings": [dataclasses.asdict(one) for one in found]}))
    else:
        _show(found, radars)
    if any(one.fault for one in found):
        raise typer.Exit(1)


def _read(
    bag: Path | None, seconds: float, parameters: Parameters, domain: int | None, namespace: str, *, quiet: bool
) -> tuple[list[Evidence], list[Finding]]:
    """Read the bag, or listen to the graph."""
    if bag is not None:
        from radar_app.doctor.reading import from_bag

        return from_bag(bag, parameters)
    from radar_app.doctor.listening import Listener
    from radar_app.supervisor import environment
    from radar_ros.interrupts import ros

    os.environ.update(environment(domain))
    with ros(), progress_bar("listening", quiet=quiet, transient=True) as progress:
        listener = Listener(namespace)
        try:
            return listener.listen(seconds, parameters, progress)
        finally:
            listener.close()


def _show(found: Sequence[Finding], radars: Sequence[Evidence]) -> None:
    """Print the faults, one paragraph each, then what is well and what is not known."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)

    def name(one: Finding) -> str:
        return f"{one.radar}: {one.symptom}" if one.radar else one.symptom

    faults = [one for one in found if one.fault]
    if not faults:
        console.print("nothing wrong found", style="bold green")
    for number, one in enumerate(faults, 1):
        console.print(f"{number}. {name(one)}", style="bold red", markup=False)
        console.print(f"   {one.text}.", markup=False)
        console.print(f"   -> {one.remedy}", markup=False)
    if len(faults) > 1:
        console.print(_AFTER)
    for one in found:
        if one.fault is False:
            console.print(f"well: {name(one)}: {one.text}", markup=False, style="dim" if faults else None)
    for one in found:
        if one.fault is None:
            console.print(f"not looked at: {name(one)}: {one.text}", markup=False, style="dim")
    for evidence in radars:
        came = ", ".join(f"{stream.came} of {topic}" for topic, stream in evidence.arrived.items() if stream.came)
        console.print(f"looked at{f' ({evidence.name})' if evidence.name else ''}: {came}", markup=False, style="dim")
