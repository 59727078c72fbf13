"""The convolutional networks that the thesis compares with: on the cubes of [SFL+20] (section 4.5.5) and on its feature maps (4.5.3).

Both are one network with other inputs, see `radar_lab.training.encoder`: the thesis gives the layers of neither, and these are ours.
PyTorch trains it (extra ``train``), the ONNX runtime runs it; a model file is an ONNX graph, which holds operators and numbers and no code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float32Array, Float64Array
from radar_lab.training.encoder import ATTRIBUTES

FORMAT: Final[int] = 1
"""Version of the graph's description; a reader refuses every other."""
_MOST_BYTES: Final[int] = 200_000_000
_ADVICE: Final[str] = "train the network again"


@config
class CnnConfig:
    """The network and its training."""

    channels: tuple[int, ...] = knob((16, 32, 64), low=1, high=4096, doc="filters of each 3 x 3 convolution; after each, 2 x 2 maxima")
    hidden: int = knob(128, low=1, high=65_536, doc="neurons of the dense layer")
    dropout: float = knob(0.3, low=0.0, high=0.95, doc="of the dense layer, in training")
    epochs: int = knob(40, low=1, high=100_000, doc="passes over the samples")
    batch: int = knob(32, low=1, high=65_536, doc="samples a step")
    learning_rate: float = knob(1e-3, low=1e-8, high=10.0, doc="of Adam with a one-cycle schedule, at its highest")
    weight_decay: float = knob(1e-4, low=0.0, high=1.0, doc="decoupled L2 penalty")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of start weights, order of samples and dropout")


class CnnModel:
    """A network read from an ONNX file that `export` wrote.

    Attributes
    ----------
    labels : tuple of str
        What the outputs mean.
    shape : tuple of int, length 3
        Of the cubes: attributes, detections, frames; or of the maps: maps, Doppler gates, frames.
    flop, n_bytes : int
        Floating point operations of one classification, counted from the graph (see `count_flop`); size of the file.

    Raises
    ------
    ConfigError
        When there is no such file, it is no graph of ours or of another version, or the ONNX runtime is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        content = _read(Path(path))
        self._session = _session(Path(path), content)
        about = _about(Path(path), self._session.get_modelmeta().custom_metadata_map)
        self.labels: tuple[str, ...] = tuple(about["labels"])
        self.shape: tuple[int, ...] = tuple(about["shape"])
        self.flop = int(about["flop"])
        self.n_bytes = len(content)

    def probabilities(self, cubes: NDArray[np.floating]) -> Float64Array:
        """Probability of every label, in the order of ``labels``, shape (..., n_labels).

        ``cubes`` have the shape (..., *shape), as `encode` or `encode_maps` gives them; `DataError` for another shape or non-finite
        values.
        """
        x = np.asarray(cubes, np.float32)
        if x.shape[-3:] != self.shape:
            raise DataError(f"cubes have shape {x.shape}, expected (..., {', '.join(map(str, self.shape))})")
        if not np.isfinite(x).all():
            raise DataError("cubes have non-finite values; leave such an event out")
        (found,) = self._session.run(None, {"cube": x.reshape(-1, *self.shape)})
        return np.asarray(found, np.float64).reshape(*x.shape[:-3], len(self.labels))


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigError(f"{path}: larger than {_MOST_BYTES // 1_000_000} MB; {_ADVICE}")
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: the network cannot be read ({error.strerror}); {_ADVICE}") from None
    if b"location" in content:  # how ONNX names files beside its own, which could be any file of this machine
        raise ConfigError(f"{path}: the network refers to other files; {_ADVICE}, which puts everything into one")
    return content


def _session(path: Path, content: bytes) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise ConfigError("the convolutional network needs the ONNX runtime; install it with: pip install 'handwave[cnn]'") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # sums of several threads round differently from run to run
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions have no base class of their own
        raise ConfigError(f"{path}: this is no ONNX graph ({str(error).splitlines()[0]}); {_ADVICE}") from None


def _about(path: Path, described: Mapping[str, str]) -> dict[str, Any]:
    try:
        about = json.loads(described["handwave"])
        number = about["format"]
        sound = all(isinstance(name, str) for name in about["labels"]) and len(about["shape"]) == 3 and int(about["flop"]) > 0
    except (KeyError, ValueError, TypeError, RecursionError):
        raise ConfigError(f"{path}: a graph, but not one of ours: it has no description; {_ADVICE}") from None
    if number != FORMAT or not sound:
        raise ConfigError(f"{path}: network format {number}, but this version of Handwave reads format {FORMAT}; {_ADVICE}")
    return dict(about)


@dataclass(frozen=True, eq=False)
class Network:
    """Numbers of a trained network, independent of what trained it."""

    # mean, scale: standardisation of each attribute or map; cells without a detection stay 0; shape (n_attributes,)
    mean: Float32Array
    scale: Float32Array
    # Filters, shape (n_out, n_in, 3, 3), and biases, shape (n_out,), of each convolution (edges padded by 1), each followed by ReLU and
    # maxima over 2 x 2 cells
    convolutions: tuple[tuple[Float32Array, Float32Array], ...]
    # Weights, shape (n_in, n_out), and biases, shape (n_out,), of each dense layer; ReLU between them, softmax after the last
    dense: tuple[tuple[Float32Array, Float32Array], ...]


def export(
    network: Network, path: str | Path, shape: tuple[int, int, int] = (len(ATTRIBUTES), 50, 50), *, labels: tuple[str, ...] = GESTURES
) -> int:
    """Write a network as an ONNX graph, input ``cube``, output ``probabilities``; returns the floating point operations of one cube.

    Parameters
    ----------
    network : Network
        What to write.
    path : str or Path
        Target (.onnx); its folder is made.
    shape : tuple of int, length 3
        Of the cubes or maps, as in `CnnModel`.
    labels : tuple of str
        What the outputs mean.

    Raises
    ------
    ConfigError
        When onnx is not installed.
    """
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError:
        raise ConfigError("exporting a network needs onnx; install it with: pip install 'handwave[train]'") from None
    nodes, numbers = _nodes(network)
    batch = [helper.make_tensor_value_info("cube", TensorProto.FLOAT, ["n", *shape])]
    found = [helper.make_tensor_value_info("probabilities", TensorProto.FLOAT, ["n", len(labels)])]
    tensors = [numpy_helper.from_array(np.asarray(array), name) for name, array in numbers.items()]
    graph = helper.make_graph([helper.make_node(*ends, **options) for ends, options in nodes], "handwave", batch, found, tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9, producer_name="handwave")
    checker.check_model(model)
    flop = count_flop(model, shape)
    about = {"format": FORMAT, "labels": list(labels), "shape": list(shape), "flop": flop}
    helper.set_model_props(model, {"handwave": json.dumps(about)})
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(model.SerializeToString(deterministic=True))
    return flop


def _nodes(network: Network) -> tuple[list[tuple[tuple[Any, ...], dict[str, Any]]], dict[str, NDArray[Any]]]:
    """Operators (kind, inputs, outputs) with their options, and the numbers they take."""
    # Standardised only where something was detected: a cell is empty when its amplitude is 0.
    nodes: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
        (("Slice", ["cube", "first", "second", "axis"], ["amplitude"]), {}),
        (("Equal", ["amplitude", "zero"], ["empty"]), {}),
        (("Sub", ["cube", "mean"], ["centred"]), {}),
        (("Mul", ["centred", "inverse"], ["standard"]), {}),
        (("Where", ["empty", "zero", "standard"], ["x0"]), {}),
    ]
    index = {"first": np.array([0]), "second": np.array([1]), "axis": np.array([1])}
    numbers: dict[str, NDArray[Any]] = {name: array.astype(np.int64) for name, array in index.items()}
    numbers |= {"zero": np.zeros(1, np.float32), "mean": network.mean.reshape(-1, 1, 1), "inverse": (1 / network.scale).reshape(-1, 1, 1)}
    for i, (filters, bias) in enumerate(network.convolutions):
        numbers |= {f"filters{i}": filters, f"bias{i}": bias}
        nodes += [
            (("Conv", [f"x{i}", f"filters{i}", f"bias{i}"], [f"c{i}"]), {"pads": [1, 1, 1, 1]}),
            (("Relu", [f"c{i}"], [f"r{i}"]), {}),
            (("MaxPool", [f"r{i}"], [f"x{i + 1}"]), {"kernel_shape": [2, 2], "strides": [2, 2]}),
        ]
    nodes.append((("Flatten", [f"x{len(network.convolutions)}"], ["d0"]), {}))
    for i, (weights, bias) in enumerate(network.dense):
        last = i == len(network.dense) - 1
        numbers |= {f"weights{i}": weights, f"offset{i}": bias}
        nodes.append((("Gemm", [f"d{i}", f"weights{i}", f"offset{i}"], [f"g{i}"]), {}))
        nodes.append((("Softmax" if last else "Relu", [f"g{i}"], ["probabilities" if last else f"d{i + 1}"]), {"axis": 1} if last else {}))
    return nodes, numbers


def count_flop(model: Any, shape: tuple[int, int, int]) -> int:
    """Count the floating point operations of one cube (its shape given) from the graph, as `operations` does for the perceptron.

    A convolution counts for every output cell twice the size of its filter (multiplications, additions with that of the bias), a dense
    layer for every neuron twice its inputs; ReLU one comparison a cell, maxima of 4 cells 3 comparisons, other arithmetic one operation a
    cell, softmax of k labels 5 k - 2. `DataError` is raised for an operator that is not counted.
    """
    from onnx import shape_inference

    known = shape_inference.infer_shapes(model).graph
    sizes = {"cube": (1, *shape)} | {tensor.name: tuple(tensor.dims) for tensor in known.initializer}
    for value in [*known.value_info, *known.output]:
        sizes[value.name] = tuple(d.dim_value or 1 for d in value.type.tensor_type.shape.dim)
    total = 0
    for node in known.node:
        cells = int(np.prod(sizes[node.output[0]]))
        inputs = int(np.prod(sizes[node.input[1]][1:])) if node.op_type == "Conv" else 0
        costs = {"Conv": 2 * inputs, "Relu": 1, "Sub": 1, "Mul": 1, "Equal": 1, "Where": 0, "Slice": 0, "Flatten": 0}
        if node.op_type in costs:
            total += costs[node.op_type] * cells
        elif node.op_type == "Gemm":
            total += 2 * int(np.prod(sizes[node.input[1]]))
        elif node.op_type == "MaxPool":
            total += 3 * cells
        elif node.op_type == "Softmax":
            total += 5 * cells - 2
        else:
            raise DataError(f"count_flop: the operator {node.op_type} is not counted; say in cnn.py what it costs")
    return total
