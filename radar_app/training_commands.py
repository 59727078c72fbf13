"""Commands about classifiers: train one, evaluate one."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from radar_app.parameters import Json, comma_separated
from radar_core import ConfigError

if TYPE_CHECKING:
    from radar_gestures.classifiers.perceptron import GestureModel
    from radar_lab.datasets.samples import SampleSet
    from radar_lab.training.training import TrainingConfig
    from radar_lab.training.validation import Validation

SPLITS = ("subjects", "random", "all")


def train(
    folders: Annotated[list[Path], typer.Argument(help="folders of data sets: of scenes, or of single samples")],
    out: Annotated[Path, typer.Option("--out", "-o", help="model file to write (.npz); beside it its card (.md)")] = Path("gestures.npz"),
    labels: Annotated[
        str,
        typer.Option(
            help="only these gestures, with commas between, e.g. random,push,pull; default: the ten, or with some of your own all"
        ),
    ] = "",
    hidden: Annotated[str, typer.Option(help="neurons of the hidden layers, with commas between")] = "32",
    regularisation: Annotated[float, typer.Option(help="L2 penalty on the weights", min=0.0)] = 0.1,
    starts: Annotated[int, typer.Option(help="start weights to try; the network with the least loss is kept", min=1, max=100)] = 1,
    lost: Annotated[float, typer.Option(help="share of known gestures given up to reject unknown ones", min=0.0, max=1.0)] = 0.05,
    seed: Annotated[int, typer.Option(help="of everything random", min=0)] = 1,
    scenes: Annotated[int, typer.Option(help="first simulate until the first folder holds so many scenes, 10 s each", min=0)] = 0,
    lives: Annotated[int, typer.Option(help="model stream: first simulate until the folder holds so many lives, 10 s each", min=0)] = 0,
    quick_lives: Annotated[
        int, typer.Option(help="model stream: learn first from so many lives that no echo is simulated of, 0.1 s each", min=0)
    ] = 0,
    jobs: Annotated[int, typer.Option(help="with --scenes or --lives: processes that simulate", min=1)] = 2,
    model: Annotated[
        str,
        typer.Option(
            help="perceptron: on thirteen features; network: on cells and curves; cells, curves: on one; stream: on streams of slots"
        ),
    ] = "perceptron",
    passes: Annotated[int, typer.Option(help="networks: over the samples", min=1)] = 60,
    farther: Annotated[
        bool, typer.Option("--farther", help="networks but stream: people will stand farther from the radar than in the samples")
    ] = False,
) -> None:
    """Train the model that names gestures: the perceptron on the thirteen features, or a network, which needs PyTorch.

    Its accuracy, its calibration and the limit for rejecting unknown gestures are measured on people left out of the training, two or more
    at a time; the model itself is then trained on everybody. The same samples and seed give the same file.

    The network takes single samples only, and also radars with ten clouds a second; the model brings its events and features. It is two
    networks, whose scores are averaged: one on cells (single detections) and one on curves (means of every frame). Each of them can be
    trained alone, which takes less time and names fewer gestures of real people rightly.
    That on streams takes one folder of simulated lives, half minutes of people in front of any of our radars: a fifth of them is left out
    for the figures.

    Use the model with: `handwave up --param gestures.model=gestures.npz`, or in a running graph: `handwave gesture use gestures.npz`

    Examples: `handwave dataset generate strokes` then `handwave train strokes -o mine.npz` · `handwave train samples --scenes 120 -j 2`
    · `handwave train lives --model stream --lives 1000 --quick-lives 4000 -o stream.npz`
    """
    if model not in ("perceptron", "network", "cells", "curves", "stream"):
        raise ConfigError(f"--model {model}: choose perceptron, network, cells, curves or stream")
    if farther and model not in ("network", "cells", "curves"):
        raise ConfigError(f"--farther: goes with --model network, cells or curves, not with {model}")
    for name, number in (("--lives", lives), ("--quick-lives", quick_lives)):
        if number and model != "stream":
            raise ConfigError(f"{name} {number}: goes with --model stream only")
    if model == "stream":
        if labels or scenes or len(folders) != 1:
            raise ConfigError("--model stream: give one folder of lives, and neither --labels nor --scenes")
        _train_stream(folders[0], out, lost, seed, passes, lives, quick_lives, jobs)
        return
    if model in ("network", "cells", "curves"):
        _train_curves(folders, out, comma_separated(labels), lost, seed, passes, model, farther)
        return
    from radar_lab.training.card import card, write_card
    from radar_lab.training.training import TrainingConfig, describe
    from radar_lab.training.training import train as fit

    if out.suffix != ".npz":
        raise ConfigError(f"--out {out}: give a file that ends in .npz")
    if scenes:
        from radar_lab.datasets.scenes import generate

        generate(folders[0], scenes, seed=seed, n_jobs=jobs)
    config = TrainingConfig(hidden=_sizes(hidden), regularisation=regularisation, starts=starts, lost=lost, seed=seed)
    report = fit(folders, out, config, labels=comma_separated(labels) or None)
    print(describe(report))
    text = card(
        report.model,
        [report.validation],
        data={"data sets": ", ".join(folder.name for folder in folders), **report.model.settings},
        command=_command(folders, out, labels, config, scenes),
        n_bytes=out.stat().st_size,
    )
    write_card(text, out.with_suffix(".md"))
    print(f"model in {out}, its card in {out.with_suffix('.md')}")


def _train_curves(
    folders: list[Path], out: Path, labels: tuple[str, ...], lost: float, seed: int, passes: int, model: str, farther: bool
) -> None:
    from radar_gestures.inputs import KINDS
    from radar_lab.training.card import card, write_card
    from radar_lab.training.curve_training import train_curves
    from radar_lab.training.networks import CurveTraining
    from radar_lab.training.validation import as_text

    if out.suffix != ".npz":
        raise ConfigError(f"--out {out}: give a file that ends in .npz")
    inputs = tuple(kind() for name, kind in KINDS.items() if model in (name, "network"))
    config = CurveTraining(seed=seed, passes=passes)
    report = train_curves(folders, out, config, labels=labels or None, inputs=inputs, lost=lost, farther=farther)
    print(as_text(report.validation))
    print(f"rejected below {report.model.reject:.3g}, which with those called random loses {report.lost:.1%} of the gestures")
    missed = ", ".join(f"{name} {count}" for name, count in sorted(report.missed.items()))
    print(f"no event was found in: {missed or 'none'}")
    options = f"--passes {passes} --lost {lost} --seed {seed}" + (f" --labels {','.join(labels)}" if labels else "")
    options += " --farther" if farther else ""
    text = card(
        report.model,
        [report.validation],
        data={"data sets": ", ".join(folder.name for folder in folders), **report.model.settings},
        command=f"handwave train {' '.join(map(str, folders))} --model {model} --out {out} {options}",
        n_bytes=out.stat().st_size,
    )
    write_card(text, out.with_suffix(".md"))
    print(f"model in {out}, its card in {out.with_suffix('.md')}")


def _train_stream(folder: Path, out: Path, lost: float, seed: int, passes: int, lives: int, quick: int, jobs: int) -> None:
    from radar_lab.datasets.lives import generate_lives
    from radar_lab.training.card import card, write_card
    from radar_lab.training.networks import need_torch
    from radar_lab.training.stream_figures import as_text
    from radar_lab.training.stream_training import StreamTraining, train_streams

    if out.suffix != ".npz":
        raise ConfigError(f"--out {out}: give a file that ends in .npz")
    need_torch("the network on streams")  # before hours of simulation
    if lives:
        generate_lives(folder, lives, seed=seed, n_jobs=jobs)
    report = train_streams(folder, out, StreamTraining(seed=seed, passes=passes), lost=lost, quick=quick, n_jobs=jobs)
    print(as_text(report.model))
    simulated = "".join(f"--{name} {many} " for name, many in (("lives", lives), ("quick-lives", quick)) if many)
    text = card(
        report.model,
        [],
        data={"data set": folder.name, **report.model.figures},
        command=f"handwave train {folder} --model stream {simulated}--out {out} --passes {passes} --lost {lost} --seed {seed}",
        n_bytes=out.stat().st_size,
    )
    write_card(text, out.with_suffix(".md"))
    print(f"model in {out}, its card in {out.with_suffix('.md')}")


def evaluate(
    model: Annotated[str, typer.Argument(help="model file, or one of ours by name, e.g. gestures")],
    folder: Annotated[Path, typer.Argument(help="folder of a data set")],
    split: Annotated[str, typer.Option(help="subjects: anew, people left out; random: anew, 80/20; all: the model as it is")] = "subjects",
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder for the pictures and the card")] = None,
    unknown: Annotated[bool, typer.Option("--unknown", help="also keep each gesture from the training in turn: is it rejected?")] = False,
    as_json: Json = False,
) -> None:
    """Say how good a model is on a data set: accuracy, recall and precision of each gesture, confusion matrix, calibration.

    `subjects` and `random` train models like the given one (same labels, layers and settings of training) on parts of the data set and
    test each on the rest, because a model must not be tested on what it was trained on. `all` tests the model itself: for data it has
    never seen.

    Examples: `handwave evaluate gestures strokes --split all` · `handwave evaluate mine.npz samples --split random -o pictures`
    """
    import json

    from radar_gestures.classifiers.loading import load_perceptron
    from radar_lab.training.training import of_labels, read_folder
    from radar_lab.training.validation import as_text

    if split not in SPLITS:
        raise ConfigError(f"--split {split}: choose one of {', '.join(SPLITS)}")
    judged = load_perceptron(model)
    samples = of_labels(read_folder(folder), judged.labels)
    if judged.names != samples.names:
        raise ConfigError(f"the model takes {len(judged.names)} features, the data set holds {len(samples.names)}; train one on it")
    validation = _validate(judged, samples, split)
    figures = validation.figures()
    if not as_json:
        print(as_text(validation))
    if unknown:
        figures["unknown_rejected"] = _unknown(judged, samples, quiet=as_json)
    if as_json:
        print(json.dumps(figures))
    if out is not None:
        _draw(judged, validation, out, model, folder, split)
        if not as_json:
            print(f"pictures and card in {out}")


def _validate(model: GestureModel, samples: SampleSet, split: str) -> Validation:
    from radar_lab.training.calibration import soften
    from radar_lab.training.training import config_of, validate
    from radar_lab.training.validation import Validation, leave_subjects_out, random_split

    if split == "all":
        return Validation("all", model.labels, model.probabilities(samples.features), samples.label, samples.person)
    config = config_of(model)
    if split == "random":
        folds = random_split(len(samples.label), seed=config.seed)
    else:
        folds = leave_subjects_out(samples.person, most=config.folds, seed=config.seed)
    found = validate(samples, folds, config, labels=model.labels, split=split)
    return dataclasses.replace(found, probabilities=soften(found.probabilities, model.temperature))


def _unknown(model: GestureModel, samples: SampleSet, *, quiet: bool) -> dict[str, float]:
    from radar_lab.training.training import config_of
    from radar_lab.training.unknown import as_table, leave_one_gesture_out

    reports = leave_one_gesture_out(samples, config_of(model), labels=model.labels)
    if not quiet:
        print(as_table(reports))
    return {report.rejector: report.mean for report in reports}


def _draw(model: GestureModel, validation: Validation, out: Path, name: str, folder: Path, split: str) -> None:
    from radar_core.paths import find_config
    from radar_lab.evaluation.pictures import draw_confusion, draw_reliability
    from radar_lab.training.card import card, write_card

    draw_confusion({split: validation}, out / "confusion.png")
    draw_reliability({split: validation}, out / "calibration.png")
    text = card(
        model,
        [validation],
        data={"data set": folder.name, **model.settings},
        command=f"handwave evaluate {name} {folder} --split {split} --out {out}",
        n_bytes=find_config(name, "models", ".npz").stat().st_size,
    )
    write_card(text, out / "card.md")


def _sizes(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(size) for size in text.split(","))
    except ValueError:
        raise ConfigError(f"--hidden {text}: give whole numbers with commas between, e.g. 32 or 64,32") from None


def _command(folders: list[Path], out: Path, labels: str, config: TrainingConfig, scenes: int) -> str:
    """Return the command that was given, with all that matters for the result."""
    parts = [
        f"handwave train {' '.join(map(str, folders))} --out {out} --hidden {','.join(map(str, config.hidden))}",
        f"--regularisation {config.regularisation:g} --starts {config.starts} --lost {config.lost:g} --seed {config.seed}",
    ]
    return " ".join(parts + ([f"--labels {labels}"] if labels else []) + ([f"--scenes {scenes}"] if scenes else []))
