"""Training the network on streams of slots with PyTorch (extra ``train``), from simulated lives."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from radar_core import GESTURES, DataError, RadarInfo
from radar_core.config import config, knob
from radar_core.types import Float32Array, IndexArray
from radar_gestures.classifiers.branch import half
from radar_gestures.classifiers.model import save_model
from radar_gestures.needs import Needs
from radar_gestures.stream.network import CLIP, Block, Member, StreamNet
from radar_gestures.stream.slots import NAMES
from radar_lab.training.networks import as_array, need_torch
from radar_lab.training.quick_lives import quick_lives
from radar_lab.training.slot_sequences import LifeSlots, SlotSequence, read_lives, varied
from radar_lab.training.stream_figures import Judged, choose_limit, figures_of, judge

_PARTS: Final = 10  # lives are counted off in so many parts
_CHOOSE, _FIGURES = 4, 9  # the part that the limit is chosen on, and the one that gives the figures: networks learn from the others
_FLATTEST: Final = 0.05  # inputs that hardly change are not blown up further
_APART: Final = 1e-6  # m: antennas nearer to each other than this stand in one place
_NORM: Final = 1.0  # longest gradient of a step
_SLOWER: Final = 3.0  # times: after quick lives


@config
class StreamTraining:
    """The network and its training."""

    width: int = knob(64, low=1, high=1024, doc="numbers that are known of a slot in each layer")
    dilations: tuple[int, ...] = knob((1, 2, 4, 8, 16), low=1, high=1024, doc="slots between the three taps of each block")
    delay: int = knob(8, low=0, high=100, doc="slots that the network sees after the one it judges")
    dropout: float = knob(0.3, low=0.0, high=0.95, doc="in training, of what each block adds")
    members: int = knob(3, low=1, high=100, doc="networks that are trained apart and averaged")
    passes: int = knob(60, low=1, high=10_000, doc="over the sequences, each time changed otherwise")
    first_passes: int = knob(6, low=1, high=10_000, doc="before them over quick lives and the sequences together, if there are quick ones")
    batch: int = knob(16, low=1, high=65_536, doc="pieces of sequences a step")
    length: int = knob(256, low=2, high=100_000, doc="slots of a piece")
    learning_rate: float = knob(3e-3, low=1e-8, high=10.0, doc="of Adam with a one-cycle schedule, at its highest")
    weight_decay: float = knob(2e-2, low=0.0, high=10.0, doc="decoupled L2 penalty")
    smoothing: float = knob(0.03, low=0.0, high=0.9, doc="share of each label that is spread over all: for labels that may be wrong")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of start weights, order, changes and dropout")


@dataclass(frozen=True, eq=False)
class StreamReport:
    """What training found out."""

    model: StreamNet
    judged: Judged  # events of the lives for the figures


def train_streams(
    folder: str | Path,
    out: str | Path | None = None,
    config: StreamTraining | None = None,
    *,
    lost: float = 0.05,
    quick: int = 0,
    n_jobs: int = 1,
) -> StreamReport:
    """Train a network on the lives of a folder and write it to ``out``; needs PyTorch (extra ``train``).

    Parameters
    ----------
    folder : str or Path
        As `radar_lab.datasets.lives.generate_lives` fills it.
    out : str or Path or None
        Model file (.npz); None: write nothing.
    config : StreamTraining or None
        None: the defaults.
    lost, n_jobs : float, int
        As in `fit_lives`; lives that are read or made, and networks that are trained, at the same time.
    quick : int
        Quick lives to learn from first, see `train_stream_net`.

    Raises
    ------
    ConfigError, DataError
        Without PyTorch; when there are no lives, or too few to keep one to choose on and one for the figures.
    """
    need_torch("the network on streams")  # before minutes of reading
    config = config or StreamTraining()
    lives = read_lives(folder, n_jobs=n_jobs)
    report = fit_lives(lives, config, lost=lost, first=quick_lives(quick, seed=config.seed, n_jobs=n_jobs), n_jobs=n_jobs)
    if out is not None:
        save_model(report.model, out)
    return report


def fit_lives(
    lives: Sequence[LifeSlots],
    config: StreamTraining | None = None,
    *,
    lost: float = 0.05,
    more: Sequence[SlotSequence] = (),
    first: Sequence[SlotSequence] = (),
    n_jobs: int = 1,
) -> StreamReport:
    """Train a network on eight of ten lives, choose on the fifth of ten what it rejects, and measure on the tenth what it is worth.

    The three kinds of lives are disjoint, and the last is looked at once, when all is chosen. Events of the lives left out are found as at
    run time: gestures begin and end where the network says so, and have the label with the largest pooled probability of their slots.
    ``StreamNet.reject`` is the highest limit of their score that gives up at most a share of ``lost`` of the strokes that were named
    right: what is called a gesture in between, or named wrong, mostly lies below.

    Parameters
    ----------
    lives : sequence of LifeSlots
        Numbered from 0; of ten in a row one is to choose on, and one for the figures; of many lives they hold all kinds of radars.
    config : StreamTraining or None
        None: the defaults.
    lost : float
        Share of strokes named right that may be rejected.
    more : sequence of SlotSequence
        Others to learn from too, such as recorded ones; nothing is chosen or measured on them.
    first : sequence of SlotSequence
        Quick lives to learn from before, see `train_stream_net`.
    n_jobs : int
        Networks that are trained at the same time.

    Raises
    ------
    ConfigError, DataError
        As `train_streams`.
    """
    config = config or StreamTraining()
    known = [*learned_sequences(lives), *more]
    model = train_stream_net(known, first=first, config=config, n_jobs=n_jobs)
    return measured(model, lives, config, lost=lost, more=len(more))


def learned_sequences(lives: Sequence[LifeSlots]) -> list[SlotSequence]:
    """Sequences of the lives that `fit_lives` learns from.

    Raises
    ------
    DataError
        When there are too few lives to learn from some, to choose on one, and to keep one for the figures.
    """
    learned, choose, measure = _parted(lives)
    known = [sequence for life in learned for sequence in life.sequences]
    if not choose or not measure or not known:
        raise DataError(f"there are {len(lives)} lives with {len(known)} tracks to learn from; it takes at least {_PARTS}: simulate more")
    return known


def measured(model: StreamNet, lives: Sequence[LifeSlots], config: StreamTraining, *, lost: float, more: int = 0) -> StreamReport:
    """Choose what a network rejects that learned from `learned_sequences` of these lives, and measure it, see `fit_lives`.

    ``more``: how many other sequences it learned from.
    """
    learned, choose, measure = _parted(lives)
    reject = choose_limit(judge(model, choose), lost)
    judged = judge(model, measure)
    figures = figures_of(judged, reject)
    figures |= {
        "trained_lives": len(learned),
        "trained_other_sequences": more,
        "training": json.loads(json.dumps(dataclasses.asdict(config))),
    }
    settings = {"needs": dataclasses.asdict(least([life.info for life in learned]))}
    return StreamReport(dataclasses.replace(model, reject=reject, figures=figures, settings=settings), judged)


def _parted(lives: Sequence[LifeSlots]) -> tuple[list[LifeSlots], list[LifeSlots], list[LifeSlots]]:
    """Lives to learn from, to choose on, and for the figures."""
    choose, measure = ([life for life in lives if _part(life) == part] for part in (_CHOOSE, _FIGURES))
    return [life for life in lives if _part(life) not in (_CHOOSE, _FIGURES)], choose, measure


def _part(life: LifeSlots) -> int:
    """Count a life off; from ten to ten the counting is shifted, since each of four in a row is seen by another kind of radar."""
    return (life.number - life.number // _PARTS) % _PARTS


def least(radars: Sequence[RadarInfo]) -> Needs:
    """Say what all of some radars give: a network that learned from them has seen no poorer one."""
    waves = [info.waveform for info in radars]
    wide, high = (all(float(np.ptp(info.array.virtual[:, axis])) > _APART for info in radars) for axis in (0, 1))
    interval = max(wave.frame_interval for wave in waves)
    return Needs(interval, max(wave.speed_resolution for wave in waves), min(wave.max_speed for wave in waves), wide, high)


def train_stream_net(
    sequences: Sequence[SlotSequence],
    *,
    first: Sequence[SlotSequence] = (),
    labels: Sequence[str] = GESTURES,
    config: StreamTraining | None = None,
    n_jobs: int = 1,
) -> StreamNet:
    """Train a network; the same sequences and seed give the same numbers on one machine.

    Its weights are rounded to half precision at the end (`branch.half`): the file takes half the bytes.

    Parameters
    ----------
    sequences : sequence of SlotSequence
        At least one, with the features `NAMES`.
    first : sequence of SlotSequence
        Quick lives (`radar_lab.training.quick_lives`): networks learn from them and the sequences together first, and from the sequences
        alone at the end, a third as fast.
    labels : sequence of str
        What their labels mean; the first is no gesture.
    config : StreamTraining or None
        None: the defaults.
    n_jobs : int
        Members that are trained at the same time; they come out the same.

    Raises
    ------
    ConfigError, DataError
        When PyTorch is not installed; when there is no sequence, or one has other features or labels.
    """
    config = config or StreamTraining()
    known = [*sequences, *first]
    top = max((int(sequence.label.max(initial=0)) for sequence in known), default=-1)
    if not sequences or top >= len(labels) or any(sequence.features.shape[1] != len(NAMES) for sequence in known):
        raise DataError(f"{len(known)} sequences with labels up to {top}; expected some with {len(NAMES)} features, {len(labels)} labels")
    need_torch("the network on streams")
    mean, scale = _spread(sequences)
    each = (dataclasses.replace(config, seed=config.seed + number) for number in range(config.members))
    members = Parallel(n_jobs=n_jobs)(delayed(_trained)(sequences, first, mean, scale, labels, own) for own in each)
    return StreamNet(mean, scale, tuple(members), NAMES, tuple(labels), config.delay)


def _trained(
    sequences: Sequence[SlotSequence], first: Sequence[SlotSequence], mean: Float32Array, scale: Float32Array, labels: Sequence[str],
    config: StreamTraining,
) -> Member:  # fmt: skip
    """Train one member."""
    torch = need_torch("the network on streams")
    with threadpool_limits(1), torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        net = _Network(torch, config, len(NAMES), len(labels))
        if first:
            together = dataclasses.replace(config, passes=config.first_passes)
            _fit(torch, net, [*first, *sequences], mean, scale, labels, together)
            config = dataclasses.replace(config, learning_rate=config.learning_rate / _SLOWER)
        _fit(torch, net, sequences, mean, scale, labels, config)
    return net.exported()


def _spread(sequences: Sequence[SlotSequence]) -> tuple[Float32Array, Float32Array]:
    """Mean and standard deviation of every feature over all slots, shape (n_features,); in sums, as there are millions of slots."""
    n = sum(len(sequence.label) for sequence in sequences)
    mean = np.sum([sequence.features.sum(axis=0, dtype=np.float64) for sequence in sequences], axis=0) / n
    square = np.sum([((sequence.features - mean) ** 2).sum(axis=0) for sequence in sequences], axis=0) / n
    return mean.astype(np.float32), np.maximum(np.sqrt(square), _FLATTEST).astype(np.float32)


class _Network:
    """The layers of a `Member` with dropout, which training needs and the finished network does not."""

    def __init__(self, torch: Any, config: StreamTraining, n_features: int, n_labels: int) -> None:
        nn, width = torch.nn, config.width
        self._torch, self._config = torch, config
        self._first, self._last = nn.Conv1d(n_features, width, 1), nn.Conv1d(width, n_labels, 1)
        self._taps = nn.ModuleList([nn.Conv1d(width, width, 3, dilation=d) for d in config.dilations])
        self._mixes = nn.ModuleList([nn.Conv1d(width, width, 1) for _ in config.dilations])
        self._drop = nn.Dropout(config.dropout)
        self.modules = nn.ModuleList([self._first, self._taps, self._mixes, self._drop, self._last])

    def __call__(self, x: Any) -> Any:
        """Scores of each label, before the softmax, shape (n, n_labels, n_slots), of inputs (n, n_features, n_slots)."""
        torch = self._torch
        value = torch.relu(self._first(x))
        for dilation, taps, mix in zip(self._config.dilations, self._taps, self._mixes, strict=True):
            inner = torch.relu(taps(torch.nn.functional.pad(value, (2 * dilation, 0))))
            value = value + self._drop(mix(inner))
        return self._last(torch.relu(value))

    def exported(self) -> Member:
        """Make the finished network."""
        blocks = tuple(
            Block(half(as_array(taps.weight.permute(2, 1, 0))), as_array(taps.bias), *_dense(mix), dilation)
            for taps, mix, dilation in zip(self._taps, self._mixes, self._config.dilations, strict=True)
        )
        return Member(_dense(self._first), blocks, _dense(self._last))


def _dense(layer: Any) -> tuple[Float32Array, Float32Array]:
    """Weights, shape (n_in, n_out), and biases of a convolution with one tap."""
    return half(as_array(layer.weight[:, :, 0].T)), as_array(layer.bias)


def _fit(
    torch: Any, net: _Network, sequences: Sequence[SlotSequence], mean: Float32Array, scale: Float32Array, labels: Sequence[str],
    config: StreamTraining,
) -> None:  # fmt: skip
    """Minimise the cross-entropy of slots; a label weighs more by the square root of how rare it is, and nothing if there is none."""
    count = np.sum([np.bincount(sequence.label, minlength=len(labels)) for sequence in sequences], axis=0)
    rare = np.where(count > 0, np.sqrt(count.sum() / np.maximum(count, 1)), 0.0)
    rarity = torch.from_numpy((rare / rare[count > 0].mean()).astype(np.float32))
    loss = torch.nn.CrossEntropyLoss(rarity, reduction="none", label_smoothing=config.smoothing)
    pieces = np.repeat(np.arange(len(sequences)), [max(1, len(sequence.label) // config.length) for sequence in sequences])
    steps = config.passes * -(-len(pieces) // config.batch)
    optimiser = torch.optim.AdamW(net.modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, total_steps=max(steps, 2))
    net.modules.train()
    for chosen in _batches(sequences, pieces, labels, config):
        x = np.clip((np.array([piece.features for piece in chosen]) - mean) / scale, -CLIP, CLIP)
        label, weight = (torch.from_numpy(np.array([getattr(piece, name) for piece in chosen])) for name in ("label", "weight"))
        optimiser.zero_grad()
        (loss(net(torch.from_numpy(np.ascontiguousarray(x.transpose(0, 2, 1)))), label) * weight).mean().backward()
        torch.nn.utils.clip_grad_norm_(net.modules.parameters(), _NORM)
        optimiser.step()
        schedule.step()
    net.modules.eval()


def _batches(
    sequences: Sequence[SlotSequence], pieces: IndexArray, labels: Sequence[str], config: StreamTraining
) -> Iterator[list[SlotSequence]]:
    """Give changed pieces of sequences, all equally long; long sequences come as often as they have room for pieces."""
    rng = np.random.default_rng(config.seed)
    for _ in range(config.passes):
        order = rng.permutation(pieces)
        for first in range(0, len(order), config.batch):
            yield [_piece(sequences[k], rng, labels, config) for k in order[first : first + config.batch]]


def _piece(sequence: SlotSequence, rng: np.random.Generator, labels: Sequence[str], config: StreamTraining) -> SlotSequence:
    """Cut a piece out at random and change it; its labels stand where the network says them, ``delay`` slots later."""
    first = int(rng.integers(max(1, len(sequence.label) - config.length + 1)))
    names = [field.name for field in dataclasses.fields(SlotSequence)]
    cut = varied(SlotSequence(*(getattr(sequence, name)[first : first + config.length] for name in names)), rng, labels)
    missing, late = config.length - len(cut.label), min(config.delay, config.length)
    before = missing + late
    return SlotSequence(
        np.pad(cut.features, ((missing, 0), (0, 0)), mode="edge"),
        np.pad(cut.label, (before, 0))[: config.length],
        np.pad(cut.weight, (before, 0))[: config.length],  # nothing is known of slots before: they count nothing
        np.pad(cut.stroke, (before, 0), constant_values=-1)[: config.length],
    )
