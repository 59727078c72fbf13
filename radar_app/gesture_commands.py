"""Commands about gestures of one's own and people: record, train, evaluate, enrol, use."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_app.parameters import Domain, Json, Namespace, comma_separated
from radar_core import ConfigError, RadarInfo

if TYPE_CHECKING:
    from radar_gestures.classifiers.enrolled import Base, Enrolled
    from radar_gestures.stage import GestureConfig
    from radar_lab.datasets.own import Take

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Gestures of your own and people: record samples, train, evaluate, enrol, and use a model without a restart.",
)
Folders = Annotated[list[Path], typer.Argument(help="data sets of recorded samples")]
BaseName = Annotated[str, typer.Option("--base", help="model that is taught, a file or one of ours by name; none: the samples alone")]
Out = Annotated[Path, typer.Option("--out", "-o", help="model file to write (.npz)")]


@app.command()
def record(
    name: Annotated[str, typer.Argument(help="gesture: one of the ten, or a name of your own, e.g. circle")],
    folder: Annotated[Path, typer.Option("--out", "-o", help="data set that the samples go to")] = Path("own"),
    samples: Annotated[int, typer.Option("--samples", "-n", help="samples of this gesture that it shall hold in the end", min=1)] = 10,
    person: Annotated[int, typer.Option(help="number of who performs it", min=0)] = 0,
    base: BaseName = "gestures",
    scene: Annotated[str, typer.Option(help="no graph: simulate this scene, in which the nearest person performs it")] = "",
    stroke: Annotated[str, typer.Option(help="no graph: simulate a person who performs this stroke file again and again")] = "",
    simulated: Annotated[bool, typer.Option("--simulated", help="no graph: simulate a person who performs one of the ten")] = False,
    seed: Annotated[int, typer.Option(help="with --stroke or --simulated: of everything random", min=0)] = 1,
    silent: Annotated[float, typer.Option(help="say why nothing was taken after so long [s]", min=1.0)] = 8.0,
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Record samples of a gesture from a running graph: perform it, rest for two seconds, again.

    What is no good sample is refused, with the reason.

    Stand where you will use it, 1 to 3 m before the radar, alone.

    Examples: `handwave gesture record circle` · `handwave gesture record clap -n 10 -o own` · `handwave gesture record clap --stroke clap`
    """

    def told(take: Take | str) -> None:
        if isinstance(take, str):
            print(f"waiting: {take}", flush=True)
        elif take.accepted:
            print(f"sample {take.number}: {name}, {take.duration:.2f} s", flush=True)
        else:
            print(f"refused: {take.reason}", flush=True)

    def config(info: RadarInfo) -> GestureConfig:
        return _config(base, info)

    if scene or stroke or simulated:
        from radar_lab.datasets.own_simulated import own_scene, simulate_takes
        from radar_sim import load_scene

        chosen = load_scene(scene) if scene else own_scene(stroke, name, samples, seed=seed)
        added = simulate_takes(chosen, folder, name, person, samples, config, told)
    else:
        _set_domain(domain)
        from radar_ros.interrupts import ros
        from radar_ros.own_gestures import TakeListener

        with ros(), closing(TakeListener(folder, name, person, config, namespace)) as listener:
            print(f"perform {name}, then rest for two seconds; Ctrl-C ends", flush=True)
            added = listener.takes(samples, silent, told)
    print(f"{added} samples of {name} added to {folder}")


def _config(base: str, info: RadarInfo) -> GestureConfig:
    """Knobs of events and features: the base's own, or what is usual for the radar."""
    from radar_gestures.classifiers.model import load_model
    from radar_gestures.presets import usual_config
    from radar_gestures.stage import GestureConfig, config_for

    return usual_config(info) if base == "none" else config_for(load_model(base).settings, GestureConfig())


def _set_domain(domain: int | None) -> None:
    import os

    from radar_app.supervisor import environment

    os.environ.update(environment(domain))


@app.command()
def train(
    folders: Folders,
    out: Out = Path("own.npz"),
    base: BaseName = "gestures",
    seed: Annotated[int, typer.Option(help="of everything random", min=0)] = 1,
) -> None:
    """Teach a model the gestures of recorded samples, in seconds; it keeps those that it knows.

    With `--base none` it knows the recorded ones only: record at least two gestures, and `random` too. To train on many people see
    `handwave train`.

    Examples: `handwave gesture train own` · `handwave gesture train own -o mine.npz --base none`
    """
    from radar_gestures.classifiers.enrolled import Enrolled
    from radar_gestures.classifiers.model import save_model
    from radar_lab.training.own import judge, learn, read_for
    from radar_lab.training.tuning import usual_tuning

    _check_out(out)
    named = None if base == "none" else _tunable(base)
    taught = named.base if isinstance(named, Enrolled) else named
    model = learn(folders, taught, None if taught is None else usual_tuning(taught, seed))
    save_model(model, out)
    outcome = judge(model, read_for(folders, model))
    print(f"names {', '.join(model.labels)}")
    print(
        f"{outcome.right} of the {outcome.total} samples that it learnt from right; new ones tell how good it is: handwave gesture evaluate"
    )
    print(f"model in {out}; use it with: handwave gesture use {out}")


@app.command()
def evaluate(
    model: Annotated[str, typer.Argument(help="model file, or one of ours by name")],
    folders: Folders,
    person: Annotated[str, typer.Option(help="whose head names them; empty: that for everybody")] = "",
    as_json: Json = False,
) -> None:
    """Say how a model names recorded samples, gesture by gesture; use samples that it did not learn from.

    Examples: `handwave gesture evaluate own.npz more` · `handwave gesture evaluate people.npz anna_more --person anna`
    """
    import json

    from radar_gestures.classifiers.model import model_of
    from radar_lab.training.own import judge, read_for

    chosen = model_of(model, person)
    outcome = judge(chosen, read_for(folders, chosen))
    low, high = outcome.interval
    if as_json:
        print(json.dumps({"right": outcome.right, "total": outcome.total, "interval": [low, high], "named": outcome.named}))
        return
    for gesture, row in sorted(outcome.named.items()):
        said = ", ".join(f"{name} {count}" for name, count in sorted(row.items(), key=lambda item: -item[1]))
        print(f"{gesture:14} {row.get(gesture, 0):4d} of {sum(row.values()):4d} right; named {said}")
    print(f"{outcome.right} of {outcome.total} right (95 % interval {low:.1%} to {high:.1%})")


@app.command()
def enrol(
    person: Annotated[str, typer.Argument(help="what the person is called in the model")],
    folders: Folders,
    model: Annotated[str, typer.Option(help="model to adapt: a file, or one of ours by name")] = "gestures",
    out: Out = Path("people.npz"),
    number: Annotated[int | None, typer.Option(help="use the samples of this person of the data sets only", min=0)] = None,
    gestures: Annotated[str, typer.Option(help="use only these gestures, with commas between")] = "",
    seed: Annotated[int, typer.Option(help="of everything random", min=0)] = 1,
) -> None:
    """Adapt a model to a person by three to five samples of each gesture; the model keeps everybody who was enrolled before.

    Say who is there with `handwave gesture use people.npz --person anna`; else it is the model for everybody.

    Examples: `handwave gesture enrol anna anna_samples` · `handwave gesture enrol ben ben_samples --model people.npz -o people.npz`
    """
    from radar_gestures.classifiers.enrolled import Enrolled
    from radar_gestures.classifiers.model import save_model
    from radar_lab.training.own import enrol as adapt
    from radar_lab.training.own import read_for
    from radar_lab.training.tuning import usual_tuning

    _check_out(out)
    known = _tunable(model)
    tuning = usual_tuning(known.base if isinstance(known, Enrolled) else known, seed)
    samples = read_for(folders, known, tuning.copies, seed).of(number)
    if gestures:
        samples = samples.only(comma_separated(gestures))
    made = adapt(known, person, samples, tuning)
    save_model(made, out)
    print(f"{person} enrolled with {len(samples.gestures)} samples; {out} knows {', '.join(made.heads)}")


@app.command()
def use(
    model: Annotated[str, typer.Argument(help="model file, or one of ours by name")],
    person: Annotated[str, typer.Option(help="who is there, of those enrolled in the model; empty: anybody")] = "",
    domain: Domain = None,
    namespace: Namespace = "",
) -> None:
    """Let a running graph name gestures with another model, without a restart. The model brings its own features and events.

    The same as `ros2 param set /gestures model FILE`. For the next start: `handwave up --param gestures.model=FILE`.

    Examples: `handwave gesture use own.npz` · `handwave gesture use people.npz --person anna` · `handwave gesture use gestures`
    """
    from radar_gestures.classifiers.model import model_of

    labels = model_of(model, person).labels  # for its messages, before anybody is asked
    _set_domain(domain)
    from radar_ros.interrupts import ros
    from radar_ros.own_gestures import ModelSetter

    with ros(), closing(ModelSetter(namespace)) as setter:
        setter.use(str(Path(model).resolve()) if Path(model).is_file() else model, person)
    print(f"the graph names {', '.join(labels)} from now on")


def _check_out(out: Path) -> None:
    if out.suffix != ".npz":
        raise ConfigError(f"--out {out}: give a file that ends in .npz")


def _tunable(name: str) -> Base | Enrolled:
    from radar_gestures.classifiers.curve_net import CurveNet
    from radar_gestures.classifiers.enrolled import Enrolled
    from radar_gestures.classifiers.model import load_model
    from radar_gestures.classifiers.perceptron import GestureModel

    model = load_model(name)
    if not isinstance(model, GestureModel | CurveNet | Enrolled):
        raise ConfigError(f"{name}: this kind of model cannot be taught")
    return model
