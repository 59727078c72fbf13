"""Training networks with PyTorch (extra ``train``), which nothing else of Handwave needs: the convolutional one, and the one on curves.

That on streams of slots is trained in `radar_lab.training.stream_training`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import GESTURES, ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.cells import ATTRIBUTES, CellConfig
from radar_gestures.classifiers.branch import CLIP, Branch, half
from radar_gestures.classifiers.curve_net import CurveNet, averaged
from radar_gestures.curves import TOTALS
from radar_gestures.inputs import InputMaker, Inputs, kind_of
from radar_gestures.signals import CurveConfig
from radar_lab.training.cnn import CnnConfig, CnnModel, Network, export
from radar_lab.training.validation import Judge, Mask

COUNTS: Final[Mapping[str, float]] = {"cells": 2.0, "curves": 1.0}
"""How much the network on each kind of inputs counts where there are both. Chosen on folds 1 and 5 of mHomeGes: 2 to 4 are alike there."""
_LEAST_STEPS: Final[int] = 16  # of a pass: small data sets take smaller steps, or there would be too few of them
_LEAST_BATCH: Final[int] = 32  # batch normalisation needs many samples


@config
class CurveTraining:
    """The network and its training."""

    channels: tuple[int, ...] = knob((80, 96), low=1, high=1024, doc="patterns of each convolution")
    hidden: int = knob(64, low=1, high=4096, doc="neurons of the dense layer")
    cell_width: int = knob(64, low=1, high=4096, doc="neurons of each of the two layers that look at a cell, where there are cells")
    cell_steps: int = knob(14, low=2, high=64, doc="of equal time, to the nearest of which each cell is sorted, where there are cells")
    lost_cells: float = knob(0.8, low=0.0, high=0.95, doc="largest share of its cells that a sample lacks in a pass, where there are cells")
    dropout: float = knob(0.25, low=0.0, high=0.95, doc="in training, of the outputs of every layer but those of the cells")
    passes: int = knob(60, low=1, high=10_000, doc="over the samples, each through another changed copy")
    batch: int = knob(256, low=2, high=65_536, doc="samples a step; fewer where there are less than sixteen times as many")
    learning_rate: float = knob(3e-3, low=1e-8, high=10.0, doc="of Adam with a one-cycle schedule, at its highest")
    weight_decay: float = knob(1e-2, low=0.0, high=10.0, doc="decoupled L2 penalty")
    smoothing: float = knob(0.05, low=0.0, high=0.9, doc="share of each label that is spread over all: for labels that may be wrong")
    mixup: float = knob(
        0.0, low=0.0, high=10.0, doc="samples are mixed two by two, in shares of a beta distribution B(mixup, mixup); 0: not"
    )
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of start weights, order of samples, dropout and shares")


def train_cnn(cubes: Float32Array, label: IndexArray, config: CnnConfig | None = None, *, labels: Sequence[str] = GESTURES) -> Network:
    """Train a network on feature cubes or maps; the same samples and seed give the same numbers on one machine.

    Parameters
    ----------
    cubes : ndarray of float32, shape (n, n_attributes, n_detections, n_frames) or (n, n_maps, n_speed, n_frames)
        As `encode` or `encode_maps` of `radar_lab.training.encoder` gives them: the first of each sample is 0 where nothing was detected.
    label : ndarray of int64, shape (n,)
        Index into ``labels``, which says what they mean.
    config : CnnConfig or None
        None: the defaults.

    Raises
    ------
    ConfigError
        When PyTorch is not installed, or the cubes are too small for so many convolutions.
    DataError
        When there are no samples, or their number differs from that of the labels.
    """
    config = config if config is not None else CnnConfig()
    if cubes.ndim != 4 or len(cubes) != len(label) or len(label) == 0:
        raise DataError(f"cubes have shape {cubes.shape} and there are {len(label)} labels; expected (n, attributes, rows, frames), n > 0")
    if min(cubes.shape[2:]) < 2 ** len(config.channels):
        raise ConfigError(
            f"{len(config.channels)} times 2 x 2 maxima leave nothing of {cubes.shape[2]} x {cubes.shape[3]} cells: use fewer"
        )
    mean, scale = _spread(cubes)
    torch = need_torch("the convolutional network")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        net = _network(torch, config, cubes.shape[1:], len(labels))
        x = torch.from_numpy(np.where(cubes[:, :1] == 0, 0, (cubes - mean) / scale).astype(np.float32))
        _fit_cnn(torch, net, x, torch.from_numpy(np.asarray(label, np.int64)), config)
    arrays = [p.detach().numpy().copy() for p in net.parameters()]
    pairs = list(zip(arrays[::2], arrays[1::2], strict=True))
    n = len(config.channels)
    return Network(mean.ravel(), scale.ravel(), tuple(pairs[:n]), tuple((weights.T.copy(), bias) for weights, bias in pairs[n:]))


def cnn_judge(cubes: Float32Array, label: IndexArray, config: CnnConfig | None = None, *, labels: Sequence[str] = GESTURES) -> Judge:
    """Make the network comparable with any other classifier on the same split: see `radar_lab.training.validation.cross_validate`.

    What is judged is the exported graph in the ONNX runtime, as it would run.

    Parameters
    ----------
    cubes, label, config, labels
        See `train_cnn`; of all samples.
    """

    def judge(known: Mask, test: Mask) -> Float64Array:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            shape = (cubes.shape[1], cubes.shape[2], cubes.shape[3])
            export(train_cnn(cubes[known], label[known], config, labels=labels), path, shape, labels=tuple(labels))
            return CnnModel(path).probabilities(cubes[test])

    return judge


def _spread(cubes: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Mean and standard deviation of each attribute over the cells with a detection, shape (n_attributes, 1, 1)."""
    used = cubes[:, 0] != 0
    if not used.any():
        raise DataError("cubes hold no detection at all")
    values = np.moveaxis(cubes, 1, 0)[:, used].astype(np.float64)
    scale = values.std(axis=1)
    return values.mean(axis=1).astype(np.float32)[:, None, None], np.where(scale > 1e-6, scale, 1.0).astype(np.float32)[:, None, None]


def _network(torch: Any, config: CnnConfig, shape: tuple[int, ...], n_labels: int) -> Any:
    nn = torch.nn
    layers, n_in = [], shape[0]
    for n_out in config.channels:
        layers += [nn.Conv2d(n_in, n_out, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2)]
        n_in = n_out
    cells = n_in * (shape[1] >> len(config.channels)) * (shape[2] >> len(config.channels))
    dense = [nn.Linear(cells, config.hidden), nn.ReLU(), nn.Dropout(config.dropout), nn.Linear(config.hidden, n_labels)]
    return nn.Sequential(*layers, nn.Flatten(), *dense)


def _fit_cnn(torch: Any, net: Any, x: Any, label: Any, config: CnnConfig) -> None:
    """Minimise the cross-entropy; rare labels weigh more, so that all labels weigh the same."""
    count = torch.bincount(label, minlength=net[-1].out_features).float()
    loss = torch.nn.CrossEntropyLoss(torch.where(count > 0, len(label) / count.clamp(min=1), torch.zeros(())) / (count > 0).sum())
    batches = (rows for _ in range(config.epochs) for rows in torch.randperm(len(x)).split(config.batch))
    steps = config.epochs * -(-len(x) // config.batch)
    _optimise(torch, net, net, loss, ((x[rows], label[rows]) for rows in batches), steps, config)


def _optimise(torch: Any, net: Any, modules: Any, loss: Any, batches: Iterable[tuple[Any, Any]], steps: int, config: Any) -> None:
    """Minimise a loss over batches of inputs and labels, which are drawn one after the other; rates of `CnnConfig` or `CurveTraining`."""
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, total_steps=max(steps, 2))
    modules.train()
    for x, label in batches:
        optimiser.zero_grad()
        loss(net(x), label).backward()
        optimiser.step()
        schedule.step()
    modules.eval()


def need_torch(what: str) -> Any:
    """Import PyTorch. Raises `ConfigError`, which says that training ``what`` needs it, when it is not installed."""
    try:
        import torch
    except ImportError:
        raise ConfigError(f"training {what} needs PyTorch; install it with: pip install 'handwave[train]'") from None
    return torch


def train_net(
    changed: Float32Array,
    label: IndexArray,
    *,
    labels: Sequence[str],
    inputs: Inputs,
    config: CurveTraining | None = None,
    settings: Mapping[str, Any] | None = None,
) -> CurveNet:
    """Train a network on curves, on cells, or one on each; the same samples and seed give the same numbers on one machine.

    Several are trained each by itself, and then `averaged`, with `COUNTS`. Kernels and weights are rounded to half precision at the end
    (`half`): the file takes half the bytes.

    Parameters
    ----------
    changed : ndarray of float32, shape (n_copies, n, n_features)
        Samples, in copies that the passes take in turn: see `variation.copies`. One copy: the samples as they are.
    label : ndarray of int64, shape (n,)
        Index into ``labels``.
    labels : sequence of str
        What outputs are called.
    inputs, settings : Inputs, mapping or None
        What samples are; how they were made, for the file.
    config : CurveTraining or None
        None: the defaults.

    Raises
    ------
    ConfigError, DataError
        When PyTorch is not installed; when there are fewer than two samples, or their number differs from that of the labels.
    """
    config = config if config is not None else CurveTraining()
    names = [maker.names for maker in InputMaker(inputs).makers]
    n = sum(map(len, names))
    if changed.ndim != 3 or len(changed) == 0 or changed.shape[1] != len(label) or len(label) < 2 or changed.shape[2] != n:
        raise DataError(f"samples have shape {changed.shape}, expected (copies, {len(label)} labels, {n} names), with at least two samples")
    torch = need_torch("the network on curves or cells")
    ends = np.cumsum([len(own) for own in names])
    nets = [
        _train_one(torch, part, np.asarray(label, np.int64), own, tuple(labels), one, config, settings)
        for part, own, one in zip(np.split(changed, ends[:-1], axis=2), names, inputs, strict=True)
    ]
    return nets[0] if len(nets) == 1 else averaged(nets, [COUNTS[kind_of(one)] for one in inputs])


def _train_one(
    torch: Any,
    changed: Float32Array,
    label: IndexArray,
    names: tuple[str, ...],
    labels: tuple[str, ...],
    inputs: CurveConfig | CellConfig,
    config: CurveTraining,
    settings: Mapping[str, Any] | None,
) -> CurveNet:
    cells = isinstance(inputs, CellConfig)
    steps = config.cell_steps if isinstance(inputs, CellConfig) else inputs.steps
    mean, scale = _spread_of_cells(changed[0]) if cells else (changed[0].mean(axis=0), changed[0].std(axis=0) + np.float32(1e-3))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        net = _Network(torch, config, len(names), steps, len(labels), cells)
        _fit_curves(torch, net, [((x - mean) / scale).clip(-CLIP, CLIP) for x in changed], label, config)
    kernels, offsets = zip(*(_folded(*pair) for pair in net.convolutions), strict=True)
    branch = Branch(mean, scale, tuple(half(kernel) for kernel in kernels), offsets, steps, **net.of_cells())
    return CurveNet(
        (branch,),
        tuple(half(as_array(layer.weight.T)) for layer in net.dense),
        tuple(as_array(layer.bias) for layer in net.dense),
        names=names,
        labels=labels,
        settings=dict(settings) if settings is not None else {},
    )


def _spread_of_cells(samples: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Mean and scale of samples, shape (n, n_features): the same for every cell; ``there`` and ``when`` stay as they are."""
    mean, scale = np.zeros(samples.shape[1], np.float32), np.ones(samples.shape[1], np.float32)
    parts = samples[:, : -len(TOTALS)].reshape(len(samples), -1, len(ATTRIBUTES))
    own = parts[parts[..., 0] > 0][:, 2:]
    if len(own):
        mean[: -len(TOTALS)].reshape(-1, len(ATTRIBUTES))[:, 2:] = own.mean(axis=0)
        scale[: -len(TOTALS)].reshape(-1, len(ATTRIBUTES))[:, 2:] = own.std(axis=0) + np.float32(1e-3)
    mean[-len(TOTALS) :], scale[-len(TOTALS) :] = samples[:, -len(TOTALS) :].mean(axis=0), samples[:, -len(TOTALS) :].std(axis=0) + 1e-3
    return mean, scale


class _Network:
    """The layers of `CurveNet` with dropout and batch normalisation, which training needs and the finished network does not."""

    def __init__(self, torch: Any, config: CurveTraining, n_features: int, steps: int, n_labels: int, cells: bool) -> None:
        nn = torch.nn
        self._torch, self._steps = torch, steps
        self._split = n_features - len(TOTALS)
        self._drop = nn.Dropout(config.dropout)
        self.cells = [nn.Linear(len(ATTRIBUTES) - 1, config.cell_width), nn.Linear(config.cell_width, config.cell_width)] if cells else []
        self._pool = nn.BatchNorm1d(2 * config.cell_width + 1) if cells else nn.Identity()
        self.convolutions = []
        width, length = 2 * config.cell_width + 1 if cells else self._split // steps, steps
        for number, n in enumerate(config.channels):
            stride = 1 if number == 0 else 2
            self.convolutions.append((nn.Conv1d(width, n, 3, padding=1, stride=stride), nn.BatchNorm1d(n)))
            width, length = n, -(-length // stride)
        self.n_labels = n_labels
        self.dense = [nn.Linear(width * length + len(TOTALS), config.hidden), nn.Linear(config.hidden, n_labels)]
        self.modules = nn.ModuleList(
            [self._drop, *self.cells, self._pool, *(part for pair in self.convolutions for part in pair), *self.dense]
        )

    def __call__(self, x: Any) -> Any:
        """Scores of each label, before the softmax."""
        torch = self._torch
        wave = self._pooled(x) if self.cells else x[:, : self._split].reshape(len(x), self._steps, -1).transpose(1, 2)
        for convolution, norm in self.convolutions:
            wave = self._drop(torch.relu(norm(convolution(wave))))
        value = torch.cat([wave.transpose(1, 2).flatten(1), x[:, self._split :]], dim=1)
        return self.dense[1](self._drop(torch.relu(self.dense[0](value))))

    def _pooled(self, x: Any) -> Any:
        """Look at every cell, and pool those of each step, shape (n, 2 cell_width + 1, n_steps)."""
        torch, n = self._torch, len(x)
        cells = x[:, : self._split].reshape(n, -1, len(ATTRIBUTES))
        event, number = torch.nonzero(cells[..., 0] > 0.5, as_tuple=True)
        own = cells[event, number]
        when = own[:, 1].clip(0.0, 1.0) * (self._steps - 1)
        step = when.round()
        value = torch.cat([own[:, 2:], (when - step)[:, None]], dim=1)
        for layer in self.cells:
            value = torch.relu(layer(value))
        key, rows = event * self._steps + step.long(), n * self._steps
        nothing = torch.zeros(rows, value.shape[1])
        most = nothing.scatter_reduce(0, key[:, None].expand_as(value), value, "amax")
        count = torch.bincount(key, minlength=rows)[:, None].float()
        pooled = torch.cat([most, nothing.index_add(0, key, value) / (count + 1.0), torch.log1p(count)], dim=1)
        return self._pool(pooled.reshape(n, self._steps, -1).transpose(1, 2))

    def lose_cells(self, x: Any, most: float) -> Any:
        """Leave out a share of the cells of each sample that is drawn for it, up to ``most``; signals stay as they are."""
        if self.cells:
            there = x[:, : self._split : len(ATTRIBUTES)]
            there *= self._torch.rand_like(there) >= most * self._torch.rand(len(x), 1)
        return x

    def of_cells(self) -> dict[str, Any]:
        """Give what `CurveNet` holds of the cells; nothing where the network takes signals."""
        if not self.cells:
            return {}
        factor = as_array(self._pool.weight) / np.sqrt(as_array(self._pool.running_var) + np.float32(self._pool.eps))
        return {
            "cell_weights": tuple(half(as_array(layer.weight.T)) for layer in self.cells),
            "cell_biases": tuple(as_array(layer.bias) for layer in self.cells),
            "pool_factor": factor,
            "pool_offset": as_array(self._pool.bias) - as_array(self._pool.running_mean) * factor,
        }


def _fit_curves(torch: Any, net: _Network, copies: Sequence[Float32Array], label: IndexArray, config: CurveTraining) -> None:
    loss, target = torch.nn.CrossEntropyLoss(label_smoothing=config.smoothing), torch.from_numpy(label)
    batch = min(config.batch, max(len(label) // _LEAST_STEPS, _LEAST_BATCH), len(label))
    full = len(label) // batch * batch  # the rest that fills no batch waits for the next pass: batch normalisation needs many samples

    def batches() -> Iterator[tuple[Any, Any]]:
        for turn in range(config.passes):
            x = net.lose_cells(torch.from_numpy(copies[turn % len(copies)].astype(np.float32)), config.lost_cells)
            for rows in torch.randperm(len(label))[:full].split(batch):
                yield (x[rows], target[rows]) if config.mixup == 0 else _mixed(torch, x[rows], target[rows], net.n_labels, config.mixup)

    _optimise(torch, net, net.modules, loss, batches(), config.passes * (full // batch), config)


def _mixed(torch: Any, x: Any, target: Any, n_labels: int, alpha: float) -> tuple[Any, Any]:
    """Mix samples and their labels' shares two by two (Zhang et al., mixup: Beyond Empirical Risk Minimization, ICLR 2018)."""
    share, other = torch.distributions.Beta(alpha, alpha).sample(), torch.randperm(len(x))
    shares = torch.nn.functional.one_hot(target, n_labels).float()
    return share * x + (1 - share) * x[other], share * shares + (1 - share) * shares[other]


def _folded(convolution: Any, norm: Any) -> tuple[Float32Array, Float32Array]:
    """Kernel and offset of a convolution with its batch normalisation put in, which is linear once training is over."""
    factor = as_array(norm.weight) / np.sqrt(as_array(norm.running_var) + np.float32(norm.eps))
    kernel = np.transpose(as_array(convolution.weight), (2, 1, 0)) * factor
    offset = (as_array(convolution.bias) - as_array(norm.running_mean)) * factor + as_array(norm.bias)
    return np.ascontiguousarray(kernel, np.float32), np.asarray(offset, np.float32)


def as_array(tensor: Any) -> Float32Array:
    """Take a tensor out of the training."""
    return np.ascontiguousarray(tensor.detach().numpy(), np.float32)
