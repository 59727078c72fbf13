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
from radar_gestures.classifiers.curve_net import CLIP, CurveNet, half
from radar_gestures.curves import TOTALS
from radar_lab.training.cnn import CnnConfig, CnnModel, Network, export
from radar_lab.training.validation import Judge, Mask

_LEAST_STEPS: Final[int] = 16  # of a pass: small data sets take smaller steps, or there would be too few of them
_LEAST_BATCH: Final[int] = 32  # batch normalisation needs many samples


@config
class CurveTraining:
    """The network and its training."""

    channels: tuple[int, ...] = knob((80, 96), low=1, high=1024, doc="patterns of each convolution")
    hidden: int = knob(64, low=1, high=4096, doc="neurons of the dense layer")
    dropout: float = knob(0.25, low=0.0, high=0.95, doc="in training, of the outputs of every layer")
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
    names: Sequence[str],
    labels: Sequence[str],
    steps: int,
    config: CurveTraining | None = None,
    curves: Mapping[str, Any] | None = None,
) -> CurveNet:
    """Train a network; the same samples and seed give the same numbers on one machine.

    Its kernels and weights are rounded to half precision at the end (`curve_net.half`): the file takes half the bytes.

    Parameters
    ----------
    changed : ndarray of float32, shape (n_copies, n, n_features)
        Samples, in copies that the passes take in turn: see `variation.copies`. One copy: the samples as they are.
    label : ndarray of int64, shape (n,)
        Index into ``labels``.
    names, labels : sequence of str
        What inputs and outputs are called.
    steps, curves : int, mapping or None
        Of the curves; their settings, for the file.
    config : CurveTraining or None
        None: the defaults.

    Raises
    ------
    ConfigError, DataError
        When PyTorch is not installed; when there are fewer than two samples, or their number differs from that of the labels.
    """
    config = config if config is not None else CurveTraining()
    if changed.ndim != 3 or len(changed) == 0 or changed.shape[1] != len(label) or len(label) < 2 or changed.shape[2] != len(names):
        raise DataError(
            f"samples have shape {changed.shape}, expected (copies, {len(label)} labels, {len(names)} names), with at least two samples"
        )
    torch = need_torch("the network on curves")
    mean, scale = changed[0].mean(axis=0), changed[0].std(axis=0) + np.float32(1e-3)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        net = _Network(torch, config, len(names), steps, len(labels))
        _fit_curves(torch, net, [((x - mean) / scale).clip(-CLIP, CLIP) for x in changed], np.asarray(label, np.int64), config)
    kernels, offsets = zip(*(_folded(*pair) for pair in net.convolutions), strict=True)
    return CurveNet(
        mean,
        scale,
        tuple(half(kernel) for kernel in kernels),
        offsets,
        tuple(half(as_array(layer.weight.T)) for layer in net.dense),
        tuple(as_array(layer.bias) for layer in net.dense),
        names=tuple(names),
        labels=tuple(labels),
        steps=steps,
        settings=dict(curves) if curves is not None else {},
    )


class _Network:
    """The layers of `CurveNet` with dropout and batch normalisation, which training needs and the finished network does not."""

    def __init__(self, torch: Any, config: CurveTraining, n_features: int, steps: int, n_labels: int) -> None:
        nn = torch.nn
        self._torch, self._steps = torch, steps
        self._split = n_features - len(TOTALS)
        self._drop = nn.Dropout(config.dropout)
        self.convolutions = []
        width, length = self._split // steps, steps
        for number, n in enumerate(config.channels):
            stride = 1 if number == 0 else 2
            self.convolutions.append((nn.Conv1d(width, n, 3, padding=1, stride=stride), nn.BatchNorm1d(n)))
            width, length = n, -(-length // stride)
        self.n_labels = n_labels
        self.dense = [nn.Linear(width * length + len(TOTALS), config.hidden), nn.Linear(config.hidden, n_labels)]
        self.modules = nn.ModuleList([self._drop, *(part for pair in self.convolutions for part in pair), *self.dense])

    def __call__(self, x: Any) -> Any:
        """Scores of each label, before the softmax."""
        torch = self._torch
        wave = x[:, : self._split].reshape(len(x), self._steps, -1).transpose(1, 2)
        for convolution, norm in self.convolutions:
            wave = self._drop(torch.relu(norm(convolution(wave))))
        value = torch.cat([wave.transpose(1, 2).flatten(1), x[:, self._split :]], dim=1)
        return self.dense[1](self._drop(torch.relu(self.dense[0](value))))


def _fit_curves(torch: Any, net: _Network, copies: Sequence[Float32Array], label: IndexArray, config: CurveTraining) -> None:
    loss, target = torch.nn.CrossEntropyLoss(label_smoothing=config.smoothing), torch.from_numpy(label)
    batch = min(config.batch, max(len(label) // _LEAST_STEPS, _LEAST_BATCH), len(label))
    full = len(label) // batch * batch  # the rest that fills no batch waits for the next pass: batch normalisation needs many samples

    def batches() -> Iterator[tuple[Any, Any]]:
        for turn in range(config.passes):
            x = torch.from_numpy(copies[turn % len(copies)].astype(np.float32))
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
