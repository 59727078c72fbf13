"""The command of the Blender route: a scene to a .blend file, and its meshes to raw frames."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from radar_app.parameters import stopping
from radar_core import ConfigError


def blender(
    scene: Annotated[str, typer.Argument(help="scene file, or one of ours by name")],
    out: Annotated[Path, typer.Option("--out", "-o", help="folder of the new bag; the animation goes into FOLDER.blend beside it")],
    seconds: Annotated[float | None, typer.Option(help="only so many of the scene", min=0.05)] = None,
    rcs: Annotated[str, typer.Option(help="facets: by area and direction; constant: every visible vertex alike")] = "facets",
    blend: Annotated[Path | None, typer.Option("--from", help="a .blend file of this command, as it is or changed")] = None,
) -> None:
    """Simulate a scene by way of Blender: animation exported, targets from its meshes (docs/research/simulator.md).

    Examples: `handwave lab blender short -o bag` · `handwave lab blender short --from bag.blend --rcs constant -o other`
    """
    from rich.progress import track

    from radar_lab.blender_route import BlendFile, export, need_blender, times
    from radar_lab.vertex_targets import RCS, with_meshes
    from radar_ros.offline import simulate
    from radar_sim import Simulator, load_scene

    if rcs not in RCS:
        raise ConfigError(f"--rcs {rcs}: choose {' or '.join(RCS)}")
    need_blender()
    loaded = load_scene(scene)
    if not loaded.people:
        raise ConfigError(f"{scene} has no people; the Blender route is theirs")
    people = tuple(dataclasses.replace(person, body="mesh") for person in loaded.people)
    duration = min(loaded.duration, seconds or loaded.duration)
    first = Simulator(dataclasses.replace(loaded, people=people, duration=duration))
    radars = [first, *(Simulator(first.scene, radar.frame_id) for radar in first.scene.radars[1:])]
    total, done = sum(radar.n_frames for radar in radars), 0
    if not total:
        raise ConfigError(f"{scene}: no frame begins within {duration:g} s; give more --seconds")
    file = out.with_name(f"{out.name}.blend") if blend is None else blend
    for new in (out, *([] if blend else [file])):
        if new.exists():
            raise ConfigError(f"{new} exists already; name another folder, or with --from a .blend file to read")
    with stopping(lambda: f"stopped: {done} of {total} frames in {out}"):
        if blend is None:
            file.parent.mkdir(parents=True, exist_ok=True)
            export(first.scene, times(radars), file)
            print(f"animation in {file}")
        with BlendFile(file, first.scene) as source:
            for _ in track(simulate(with_meshes(radars, source, rcs), out), total=total, description=f"simulating {scene}"):
                done += 1
    print(f"{total} frames in {out}")
