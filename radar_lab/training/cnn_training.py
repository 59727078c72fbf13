"""Training the convolutional network with PyTorch (extra ``train``); nothing else of Handwave needs it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError
from radar_lab.training.cnn import CnnConfig, CnnModel, Network, export
from radar_lab.training.validation import Judge, Mask


def train_cnn(
    cubes: NDArray[np.float32], label: NDArray[np.int64], config: CnnConfig | None = None, *, labels: Sequence[str] = GESTURES
) -> Network:
    """Train a network on feature cubes; the same samples and seed give the same numbers on one machine.

    Parameters
    ----------
    cubes : ndarray of float32, shape (n, 5, n_detections, n_frames)
        As `radar_lab.training.encoder.encode` gives them.
    label : ndarray of int64, shape (n,)
        Index into ``labels``.
    config : CnnConfig or None
        None: the defaults.
    labels : sequence of str
        What the labels mean.

    Returns
    -------
    Network
        For `radar_lab.training.cnn.export`.

    Raises
    ------
    ConfigError
        When PyTorch is not installed, or the cubes are too small for so many convolutions.
    DataError
        When there are no samples, or their number differs from that of the labels.
    """
    config = config if config is not None else CnnConfig()
    if cubes.ndim != 4 or len(cubes) != len(label) or len(label) == 0:
        raise DataError(f"cubes have shape {cubes.shape} and there are {len(label)} labels; expected (n, 5, n_detections, n_frames), n > 0")
    if min(cubes.shape[2:]) < 2 ** len(config.channels):
        raise ConfigError(
            f"{len(config.channels)} times 2 x 2 maxima leave nothing of {cubes.shape[2]} x {cubes.shape[3]} cells: use fewer"
        )
    mean, scale = _spread(cubes)
    torch = _torch()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        net = _network(torch, config, cubes.shape[1:], len(labels))
        x = torch.from_numpy(np.where(cubes[:, :1] == 0, 0, (cubes - mean) / scale).astype(np.float32))
        _optimise(torch, net, x, torch.from_numpy(np.asarray(label, np.int64)), config)
    arrays = [p.detach().numpy().copy() for p in net.parameters()]
    pairs = list(zip(arrays[::2], arrays[1::2], strict=True))
    n = len(config.channels)
    return Network(mean.ravel(), scale.ravel(), tuple(pairs[:n]), tuple((weights.T.copy(), bias) for weights, bias in pairs[n:]))


def cnn_judge(
    cubes: NDArray[np.float32], label: NDArray[np.int64], config: CnnConfig | None = None, *, labels: Sequence[str] = GESTURES
) -> Judge:
    """Make the network comparable with any other classifier on the same split: see `radar_lab.training.validation.cross_validate`.

    What is judged is the exported graph in the ONNX runtime, as it would run.

    Parameters
    ----------
    cubes, label, config, labels
        See `train_cnn`; of all samples.
    """

    def judge(known: Mask, test: Mask) -> NDArray[np.float64]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            shape = (cubes.shape[1], cubes.shape[2], cubes.shape[3])
            export(train_cnn(cubes[known], label[known], config, labels=labels), path, shape, labels=tuple(labels))
            return CnnModel(path).probabilities(cubes[test])

    return judge


def _spread(cubes: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean and standard deviation of each attribute over the cells with a detection, shape (5, 1, 1)."""
    used = cubes[:, 0] != 0
    if not used.any():
        raise DataError("cubes hold no detection at all")
    values = np.moveaxis(cubes, 1, 0)[:, used].astype(np.float64)
    scale = values.std(axis=1)
    return values.mean(axis=1).astype(np.float32)[:, None, None], np.where(scale > 1e-6, scale, 1.0).astype(np.float32)[:, None, None]


def _torch() -> Any:
    try:
        import torch
    except ImportError:
        raise ConfigError("training the convolutional network needs PyTorch; install it with: pip install 'handwave[train]'") from None
    return torch


def _network(torch: Any, config: CnnConfig, shape: tuple[int, ...], n_labels: int) -> Any:
    nn = torch.nn
    layers, n_in = [], shape[0]
    for n_out in config.channels:
        layers += [nn.Conv2d(n_in, n_out, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2)]
        n_in = n_out
    cells = n_in * (shape[1] >> len(config.channels)) * (shape[2] >> len(config.channels))
    dense = [nn.Linear(cells, config.hidden), nn.ReLU(), nn.Dropout(config.dropout), nn.Linear(config.hidden, n_labels)]
    return nn.Sequential(*layers, nn.Flatten(), *dense)


def _optimise(torch: Any, net: Any, x: Any, label: Any, config: CnnConfig) -> None:
    """Minimise the cross-entropy; rare labels weigh more, so that all labels weigh the same."""
    count = torch.bincount(label, minlength=net[-1].out_features).float()
    loss = torch.nn.CrossEntropyLoss(torch.where(count > 0, len(label) / count.clamp(min=1), torch.zeros(())) / (count > 0).sum())
    optimiser = torch.optim.AdamW(net.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    steps = config.epochs * -(-len(x) // config.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, total_steps=max(steps, 2))
    net.train()
    for _ in range(config.epochs):
        for rows in torch.randperm(len(x)).split(config.batch):
            optimiser.zero_grad()
            loss(net(x[rows]), label[rows]).backward()
            optimiser.step()
            schedule.step()
    net.eval()
