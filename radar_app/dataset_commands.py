"""Commands about data sets of gestures: generate, inspect, import, compare."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from radar_app.parameters import Params, comma_separated, parse_parameters, stopping
from radar_core import ConfigError, DataError, PointCloud

if TYPE_CHECKING:
    from radar_app.logger.importing import MakeMoment
    from radar_core import RadarInfo
    from radar_dsp.context import CalibratedBasebandConfig
    from radar_lab.datasets.labelled import ImportReport, Moment
    from radar_lab.datasets.samples import SampleSet
    from radar_lab.evaluation.scoring import TruthSegment
    from radar_ros.offline import Recording
    from radar_sim.people import BodyKind

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Data sets of single gestures: simulate them, look at them, cut them out of recordings, compare them.",
)
Folder = Annotated[Path, typer.Argument(help="folder of the data set; what is there already stays, and a stopped run goes on")]


@app.command()
def generate(
    folder: Folder,
    plan: Annotated[
        str,
        typer.Option(
            help="subjects: 10 people x 10 gestures x 15; thesis: 600 of 7; all: 600 of 10; envelope: 3000, near and far, turned, any mount"
        ),
    ] = "subjects",
    samples: Annotated[int | None, typer.Option("--samples", "-n", help="samples that the folder shall hold in the end", min=1)] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="processes that simulate; -1: one per core", min=-1)] = -1,
    seed: Annotated[int, typer.Option(help="of everything random, subjects included", min=0)] = 1,
    subjects: Annotated[int | None, typer.Option(help="people; with 0 every sample is of another", min=0)] = None,
    repetitions: Annotated[int | None, typer.Option(help="of every gesture by every subject", min=1)] = None,
    gestures: Annotated[str, typer.Option(help="only these of the plan, with commas between, e.g. push,pull")] = "",
    body: Annotated[str, typer.Option(help="mesh, or ellipsoids, which takes less time")] = "mesh",
    one_tx: Annotated[bool, typer.Option("--one-tx", help="also keep what one transmitter alone would have seen")] = False,
    raw: Annotated[bool, typer.Option("--raw", help="keep the raw frames too, about 16 MB a sample")] = False,
    cluster: Annotated[str, typer.Option(help="address of a Dask scheduler whose workers share the folder, e.g. tcp://host:8786")] = "",
) -> None:
    """Simulate single gestures of many people, each with clouds, features and truth in a file of its own.

    A sample depends on the seed and its number only: workers, machines and restarts change no byte. A run that is stopped, or killed, goes
    on with the same command. Every sample can be made again from its file alone (`radar_lab.datasets.synthesis.remake`).

    Examples: `handwave dataset generate people --one-tx` · `handwave dataset generate strokes --plan thesis --body ellipsoids --seed 7`
    """
    from radar_lab.datasets.synthesis import synthesise as run
    from radar_lab.datasets.synthesis_plan import named_plan

    if jobs == 0:
        raise ConfigError("--jobs 0: give the number of processes, or -1 for one per core")
    given: dict[str, Any] = {"n_subjects": subjects, "repetitions": repetitions}
    chosen = named_plan(plan, gestures=comma_separated(gestures), **{name: value for name, value in given.items() if value is not None})
    wanted = chosen.n_samples if samples is None else samples

    def held() -> str:
        return f"stopped: {len(list(folder.glob('sample_*.npz')))} of {wanted} samples in {folder}; the same command goes on"

    with stopping(held), _workers(cluster):
        done = run(folder, wanted, seed=seed, n_jobs=jobs, plan=chosen, body=cast("BodyKind", body), raw=raw, one_tx=one_tx)
    print(f"{done} samples simulated, {wanted} in {folder}")


@contextmanager
def _workers(cluster: str) -> Iterator[None]:
    """Let a Dask cluster work; without an address, joblib's own processes."""
    if not cluster:
        yield
        return
    try:
        from distributed import Client
    except ImportError:
        raise ConfigError("--cluster needs Dask; install it with: pip install 'handwave[cluster]'") from None
    from joblib import parallel_config

    try:
        client = Client(cluster)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigError(f"--cluster {cluster}: there is no scheduler ({error}); start one with `dask scheduler`") from None
    with client, parallel_config(backend="dask"):
        yield


@app.command()
def inspect(
    folder: Annotated[Path, typer.Argument(help="folder of the data set")],
    numbers: Annotated[list[int] | None, typer.Argument(help="samples to draw; none: the first of every gesture")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder for the pictures; without it only the table is shown")] = None,
) -> None:
    """Show what a data set holds, and draw feature maps and signals of its samples, with the event that was found.

    A picture has micro-Doppler, azimuth and elevation over time, below them the signals that features are made of; grey: what was
    performed, red: start and end of the event.

    Examples: `handwave dataset inspect strokes` · `handwave dataset inspect strokes 0 17 230 --out pictures`
    """
    from rich.console import Console

    from radar_lab.datasets.samples import read_sample, sample_files, sample_path

    files = sample_files(folder)
    chosen = [sample_path(folder, number) for number in numbers or ()]
    if absent := [path for path in chosen if path not in files]:
        raise DataError(f"{folder}: there is no {absent[0].name}; it has samples {_number(files[0])} to {_number(files[-1])}")
    table, firsts = _contents(files)
    Console().print(table)
    if out is None:
        return
    from radar_lab.evaluation.pictures import draw_sample_maps

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"--out {out}: this folder cannot be made ({error.strerror}); name another one") from None
    for path in chosen or firsts:
        sample = read_sample(path)
        picture = out / f"{path.stem}_{sample['gesture']}.png"
        draw_sample_maps(sample, picture)
        print(picture)


def _number(path: Path) -> int:
    return int(path.stem.removeprefix("sample_"))


def _contents(files: list[Path]) -> tuple[Any, list[Path]]:
    """Table of the gestures in files, and the first file of each."""
    import numpy as np
    from rich.table import Table

    from radar_core import vocabulary
    from radar_lab.datasets.samples import read_sample

    rows, gestures = [], []
    for path in files:
        sample = read_sample(path)
        rows.append([int(sample[name]) for name in ("subject", "found")])
        gestures.append(str(sample["gesture"]))
    (subject, found), labels = np.array(rows).T, vocabulary(gestures)
    label = np.array([labels.index(name) for name in gestures])
    table = Table("gesture", "samples", "subjects", "found", "missed")
    for number in np.unique(label):
        own = label == number
        hits = int(found[own].sum())
        table.add_row(labels[number], str(own.sum()), str(len(np.unique(subject[own]))), str(hits), str(int(own.sum()) - hits))
    return table, [files[int(np.argmax(label == number))] for number in np.unique(label)]


@app.command("import")
def import_(
    bag: Annotated[
        Path, typer.Argument(help="folder of a recording with raw frames or point clouds, or of a session of `handwave view --log`")
    ],
    folder: Annotated[Path, typer.Argument(help="folder of the data set; samples of several recordings of one radar may go into it")],
    labels: Annotated[Path | None, typer.Option(help="CSV with columns start,end,gesture,person; default: the recording's truth")] = None,
    own: Annotated[str, typer.Option(help="gestures of your own that --labels names beside the ten, with commas between")] = "",
    one_tx: Annotated[bool, typer.Option("--one-tx", help="of raw frames: also keep what one transmitter alone saw")] = False,
    param: Params = None,
) -> None:
    """Cut labelled gestures out of a recording and add them to a data set, one file each.

    Start and end are seconds from the recording's first frame. A simulated recording says itself what was performed, and by whom; so does
    a session that was labelled on the page. Raw frames go through the baseband, which takes parameters as in the graph:
    `--param baseband.calibration=array.npz`; of a session they are taken with `--one-tx` or `--param`, else its clouds. A label that was
    imported before is left out.

    Examples: `handwave dataset import living_room people --labels labels.csv` · `handwave dataset import my_demo strokes`
    · `handwave dataset import my_session people`
    """
    from radar_app.logger.store import is_session
    from radar_lab.datasets.labelled import import_labelled, read_labels
    from radar_ros.offline import baseband_config, open_recording

    baseband = baseband_config(parse_parameters(param))
    if is_session(bag):
        if labels or own:
            raise ConfigError(f"{bag}: a session has labels of its own; leave --labels and --own out")
        _tell(_import_session(bag, folder, one_tx, baseband if one_tx or param else None), folder)
        return
    recording = open_recording(bag)
    if one_tx and recording.topic != "radar/frame":
        raise ConfigError(f"--one-tx needs raw frames, and {bag} only has point clouds")
    wanted = _own_labels(bag) if labels is None else read_labels(labels, _first_stamp(recording), comma_separated(own) or ())
    moments = _moments(recording, one_tx, baseband)
    _tell(import_labelled(folder, recording.info, moments, wanted, source=bag.resolve().name, one_tx=one_tx), folder)


def _tell(report: ImportReport, folder: Path) -> None:
    print(f"{report.n_written} samples added to {folder}, in {report.n_found} of them the gesture is found")
    if report.n_known:
        print(f"{report.n_known} were there already")
    if report.n_outside:
        print(f"{report.n_outside} labels lie outside of the recording")


def _import_session(path: Path, folder: Path, one_tx: bool, config: CalibratedBasebandConfig | None) -> ImportReport:
    """Import what was labelled on the page; from raw frames where a configuration is given."""
    from radar_app.logger.importing import session_cuts, subject_numbers, subject_of
    from radar_app.logger.store import read_session
    from radar_lab.datasets.labelled import import_cuts

    session = read_session(path)
    for line in session.told:
        print(line, file=sys.stderr)
    if not session.labels or session.radar is None:
        raise ConfigError(f"{path}: nothing is labelled; label events first: handwave view --log {path}")
    make = None if config is None else _maker(session.radar, True, one_tx, config)
    numbers = subject_numbers(folder, (subject_of(session, label.subject) for label in session.labels))
    cuts = session_cuts(session, numbers, make)
    return import_cuts(folder, session.radar, cuts, source=path.resolve().name, one_tx=one_tx)


def _first_stamp(recording: Recording) -> int:
    """When the recording's seconds begin [ns]."""
    for _, item in recording.messages():
        return item.stamp_ns
    raise DataError(f"{recording.path}: holds no frame and no cloud")


def _truths(bag: Path) -> Iterator[Any]:
    from radar_ros.bags import read
    from radar_ros.messages.truth import truth_from_msg
    from radar_ros.offline import parse

    return (truth_from_msg(parse(item.data, "truth")) for item in read(bag, ("truth",)))


def _own_labels(bag: Path) -> tuple[TruthSegment, ...]:
    from radar_lab.evaluation.scoring import truth_segments

    found = truth_segments(_truths(bag))
    if not found:
        raise ConfigError(f"{bag}: says of no gesture what it is; give --labels with the columns start,end,gesture,person")
    return found


def _moments(recording: Recording, one_tx: bool, config: CalibratedBasebandConfig) -> Iterator[Moment]:
    """Clouds of a recording, with the truth of the same stamps where there is some."""
    places = {truth.stamp_ns: dict(zip(truth.person_id.tolist(), truth.position, strict=True)) for truth in _truths(recording.path)}
    make = _maker(recording.info, recording.topic == "radar/frame", one_tx, config)
    for _, item in recording.messages():
        moment = make(item)
        yield replace(moment, places=places.get(moment.cloud.stamp_ns, {}))


def _maker(info: RadarInfo, raw: bool, one_tx: bool, config: CalibratedBasebandConfig) -> MakeMoment:
    """Say how moments are made of raw frames, which go through the baseband, or of clouds."""
    from radar_core import RadarFrame
    from radar_core.transmitters import one_transmitter, one_transmitter_frame
    from radar_dsp import Baseband
    from radar_dsp.context import load_context
    from radar_lab.datasets.labelled import Moment

    info = load_context(info, config.calibration).radar
    baseband = Baseband(config, info) if raw else None
    single = Baseband(config, one_transmitter(info)) if one_tx else None

    def make(item: RadarFrame | PointCloud) -> Moment:
        if not isinstance(item, RadarFrame):
            return Moment(item)
        assert baseband is not None  # raw says what comes
        one = None if single is None else single.process(one_transmitter_frame(item, info))
        return Moment(baseband.process(item), one)

    return make


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(help="data set that a classifier is trained on, e.g. simulated", metavar="A")],
    second: Annotated[Path, typer.Argument(help="data set that it is tested on, e.g. recorded", metavar="B")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder for pictures and comparison.txt")] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="processes that read; -1: one per core", min=-1)] = 1,
) -> None:
    """Compare two data sets as the thesis compares simulated and recorded gestures (section 5.3.3).

    Are features normally distributed (Shapiro), alike in both (Kruskal-Wallis, for every feature and gesture), are their medians
    (Wilcoxon), and what does a classifier that learned from A make of B, with all features and without the two most different ones?

    Examples: `handwave dataset compare simulated recorded --out comparison`
    """
    from radar_lab.evaluation.comparison import as_text
    from radar_lab.evaluation.comparison import compare as run

    if jobs == 0:
        raise ConfigError("--jobs 0: give the number of processes, or -1 for one per core")
    a, b = (_collected(folder, jobs) for folder in (first, second))
    result = run(a, b)
    text = as_text(result)
    print(text)
    if out is not None:
        from radar_core.files import write_whole
        from radar_lab.evaluation.pictures import draw_comparison

        made = draw_comparison(result, a, b, out, (first.name, second.name))
        write_whole(out / "comparison.txt", text + "\n")
        print(f"\n{len(made)} pictures and comparison.txt in {out}")


def _collected(folder: Path, jobs: int) -> SampleSet:
    """Read a data set of single gestures, or one of whole scenes."""
    from radar_lab.datasets.readings import collect
    from radar_lab.datasets.samples import load_samples

    return load_samples(folder) if any(folder.glob("chunk_*.npz")) else collect(folder, n_jobs=jobs)
