"""How many floating point operations models take (Table 4.2)."""

from __future__ import annotations

from itertools import pairwise

from radar_gestures.cells import ATTRIBUTES
from radar_gestures.classifiers.branch import Branch
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.classifiers.rejection import ByDistance, Rejector
from radar_gestures.curves import TOTALS
from radar_gestures.stream.network import StreamNet


def operations(model: Classifier) -> int:
    """Count the floating point operations of one classification; of a network on streams, of one slot.

    Perceptron: each neuron counts as many multiplications as it has inputs and as many additions, that of the bias included; each hidden
    one also a comparison (ReLU); the softmax of k labels counts k - 1 comparisons, k subtractions, k exponentials, k - 1 additions and k
    divisions. Standardisation and temperature cost nothing: they are part of the first and the last layer.
    Networks: two for each weight each time it is used, two for each sum (bias and ReLU), two for each input's standardisation and five for
    each label's softmax; cells, one for each output of each in the largest and one in the sum. What rejection takes is apart
    (`rejection_operations`).

    Raises
    ------
    TypeError
        For a model of another kind.
    """
    if isinstance(model, GestureModel):
        sizes = [len(model.names), *(len(bias) for bias in model.biases)]
        return sum(2 * a * b for a, b in pairwise(sizes)) + sum(sizes[1:-1]) + 5 * sizes[-1] - 2
    if isinstance(model, CurveNet):
        return _of_curves(model)
    if isinstance(model, StreamNet):
        return _of_streams(model)
    raise TypeError(f"nobody knows what a {type(model).__name__} takes")


def rejection_operations(rejector: Rejector) -> int:
    """Count the operations that reject one event, beside those of the perceptron.

    By probability none; by distance only the most probable gesture costs: n subtractions, n (n + 1) for the triangle, 2 n - 1 for the
    square, 3 for the score.
    """
    if not isinstance(rejector, ByDistance):
        return 0
    n = int(rejector.means.shape[-1])
    return n + n * (n + 1) + 2 * n - 1 + 3


def _of_curves(model: CurveNet) -> int:
    total = sum(_of_branch(branch) for branch in model.branches)
    return total + sum(2 * weight.size + 2 * int(weight.shape[1]) for weight in model.weights) + 5 * len(model.labels)


def _of_branch(branch: Branch) -> int:
    length, total = branch.steps, 2 * branch.mean.size
    if branch.cell_weights:
        cells, width = (branch.mean.size - len(TOTALS)) // len(ATTRIBUTES), len(branch.cell_biases[-1])
        total += cells * (sum(2 * weight.size + 2 * int(weight.shape[1]) for weight in branch.cell_weights) + 2 * width)
        total += length * 2 * len(branch.pool_factor)
    for number, kernel in enumerate(branch.kernels):
        length = length if number == 0 else -(-length // 2)
        total += length * (2 * kernel.size + 2 * int(kernel.shape[2]))
    return total


def _of_streams(model: StreamNet) -> int:
    total = 2 * len(model.names)
    for member in model.members:
        weights = member.first[0].size + member.last[0].size + sum(block.kernel.size + block.mix.size for block in member.blocks)
        sums = len(member.first[1]) * (1 + 2 * len(member.blocks)) + len(model.labels)
        total += 2 * weights + 2 * sums + 5 * len(model.labels)
    return total
