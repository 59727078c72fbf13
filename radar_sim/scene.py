"""Scenes: what stands where, what people do, which effects are simulated, and how exactly."""

from __future__ import annotations

import difflib
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import BeforeValidator

from radar_core import ConfigError, RadarInfo, vocabulary
from radar_core.config import config, knob, load_file
from radar_core.paths import find_config
from radar_sim.effects.config import Effects, EffectsKnob
from radar_sim.movers import Curtain, Fan, Mover
from radar_sim.own_strokes import Stroke, beside, named
from radar_sim.people import Action, Person
from radar_sim.things import Corner, Furniture, Point, Wall, check_places

Model = Literal["auto", "separable", "nufft", "blocks", "exact", "reference"]
MODELS: Final[tuple[Model, ...]] = get_args(Model)[1:]
"""How echoes are computed, cheapest first."""

Purpose = Literal["samples", "detections", "tracks", "gestures"]
"""What a scene can be for: raw samples, or what is made of them."""


@config
class Fidelity:
    """How exactly, and how fast, echoes are computed: docs/explanation/simulator.md shows what each choice costs and gives."""

    model: Model = knob(
        "auto",
        doc="auto: the cheapest within the scene's tolerance; separable: matrix product, few points; nufft: many points; blocks: parts "
        "of a frame; exact: phase recurrence; reference: float64 at every sample",
    )
    blocks: int = knob(4, low=1, high=1024, doc="blocks only: parts of a frame, each with its own range, range rate and direction")
    order: int = knob(2, low=0, high=2, doc="blocks only: order to which migration within a part and array squint are followed")


@config
class Transmitter:
    """How the transmitters' amplitude is modulated, and whether they take turns."""

    amplitude: Literal["constant", "intra", "inter"] = knob(
        "constant", doc="intra: tapered over each chirp; inter: from chirp to chirp of a frame"
    )
    taper: str = knob("hann", doc="intra, inter: scipy's name of the taper, parameters after colons, e.g. chebwin:60")
    together: tuple[tuple[float, float], ...] = knob(
        (),
        unit="m",
        low=-10.0,
        high=10.0,
        doc="no multiplexing: (y, z) of elements that send every chirp at once, at tx_power in all; empty: array.tx take turns (TDM)",
    )


@config
class SceneRadar(RadarInfo):
    """A radar in a scene: what `RadarInfo` says, and what only a simulation knows."""

    transmitter: Transmitter = Transmitter()
    trigger_offset: float = knob(0.0, unit="s", low=0.0, high=100.0, doc="scene time at which its first frame begins")
    clock_drift: float = knob(0.0, low=-0.01, high=0.01, doc="its clock is slow by this share: frames come that much later each")

    def validate(self) -> None:
        """Raise `ConfigError` when it takes no samples, or elements that send together are also to take turns."""
        super().validate()
        if self.waveform.n_sample == 0:
            raise ConfigError("waveform.n_sample is 0; a simulated radar needs samples, e.g. 64")
        if self.transmitter.together and self.waveform.n_tx != 1:
            raise ConfigError(
                f"transmitter.together: elements that send at once cannot take {self.waveform.n_tx} turns; set waveform.n_tx to 1 and "
                "array.tx to the one place that stands for them"
            )

    @property
    def info(self) -> RadarInfo:
        """What the radar says of itself."""
        return RadarInfo(**{f.name: getattr(self, f.name) for f in fields(RadarInfo)})

    @classmethod
    def of(cls, info: RadarInfo, **more: Any) -> SceneRadar:
        """Put a radar into a scene; ``more`` are the fields that only a simulation knows."""
        return cls(**{f.name: getattr(info, f.name) for f in fields(RadarInfo)}, **more)

    @property
    def namespace(self) -> str:
        """Where its topics go: ``left`` for the frame ``left/radar``; empty for a radar alone."""
        return self.frame_id.rpartition("/")[0]


def _short(value: Any) -> Any:
    return {"model": value} if isinstance(value, str) else value


@config
class Scene:
    """A room with radars, people and things; build it in Python or load it from YAML with `load_scene`."""

    duration: float = knob(10.0, unit="s", low=0.0, high=1e6, doc="length of the scene")
    seed: int = knob(0, low=0, high=1 << 62, doc="of everything random")
    radars: tuple[SceneRadar, ...] = knob((SceneRadar(),), doc="radars in the room; several need frame_ids such as left/radar")
    people: tuple[Person, ...] = knob((), doc="who is in the room")
    strokes: Annotated[tuple[Stroke, ...], BeforeValidator(named)] = knob((), doc="gestures of one's own: stroke files, or what they hold")
    points: tuple[Point, ...] = knob((), doc="point scatterers")
    corners: tuple[Corner, ...] = knob((), doc="corner reflectors")
    walls: tuple[Wall, ...] = knob((), doc="upright walls")
    furniture: tuple[Furniture, ...] = knob((), doc="boxes")
    fans: tuple[Fan, ...] = knob((), doc="fans that turn")
    curtains: tuple[Curtain, ...] = knob((), doc="curtains and plants in the wind")
    movers: tuple[Mover, ...] = knob((), doc="small things that move over the floor: pets, a robot vacuum")
    effects: EffectsKnob = Effects()
    fidelity: Annotated[Fidelity, BeforeValidator(_short)] = Fidelity()
    tolerance: float = knob(
        0.02,
        low=1e-6,
        high=1.0,
        doc="relative rms error that may be made: of samples by fidelity auto, of what the scene is for by leaving effects out",
    )
    purpose: Purpose = knob(
        "samples",
        doc="what the scene is for, by which effects: auto judges: raw samples; or what is made of them, to which an effect on echoes "
        "matters by how far it moves the strongest ones, relative to their range",
    )

    def validate(self) -> None:
        """Raise `ConfigError` when two of a kind share a name, there is no radar, or a person is where none can be."""
        if not self.radars:
            raise ConfigError("Scene.radars is empty; leave it out for the default radar, or name one", key=("radars",))
        names = [radar.frame_id for radar in self.radars]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise ConfigError(
                    f"radars.{i}.frame_id is {name!r}, as that of radar {names.index(name)}; give each its own, e.g. left/radar",
                    key=("radars", i, "frame_id"),
                )
        ids = [person.id for person in self.people]
        for i, number in enumerate(ids):
            if number in ids[:i]:
                raise ConfigError(f"people.{i}.id: ids {ids} repeat; give each person a number of their own", key=("people", i, "id"))
        check_places(self.people, self.walls, self.furniture)
        self._check_gestures()

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the gestures that people may perform, in the order of their numbers in the truth: the ten, then the scene's own."""
        return vocabulary(stroke.name for stroke in self.strokes)

    def _check_gestures(self) -> None:
        names = [stroke.name for stroke in self.strokes]
        if len(set(names)) != len(names):
            raise ConfigError(f"strokes: {', '.join(names)}: two have the same name", key=("strokes",))
        known = self.labels
        for i, person in enumerate(self.people):
            for j, action in enumerate(person.script):
                if action.gesture is not None and action.gesture not in known:
                    near = difflib.get_close_matches(action.gesture, known, n=1)
                    hint = f" (did you mean {near[0]!r}?)" if near else ""
                    raise ConfigError(
                        f"people.{i}.script.{j}.gesture is {action.gesture!r}{hint}; choose one of {', '.join(known)}, or name the file of "
                        "a stroke of your own in strokes:",
                        key=("people", i, "script", j, "gesture"),
                    )


def load_scene(name: str | Path) -> Scene:
    """Load a scene file, or one of ours by its bare name (``demo``, ``short``, ...).

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    path = find_config(name, "scenes", ".yaml")
    with beside(path.parent):
        scene = load_file(Scene, path)

    def placed(action: Action) -> Action:
        """Take a motion capture's path as relative to the scene's file."""
        play = action.play
        return action if play is None else replace(action, play=replace(play, file=str(path.parent / play.file)))

    return replace(scene, people=tuple(replace(p, script=tuple(map(placed, p.script))) for p in scene.people))
