"""Motion captures in Biovision's BVH format: a parser that says where a file is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_sim.scatterers import Float64Array

_CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")


@dataclass
class Joint:
    """One joint of a file's skeleton."""

    name: str
    parent: int  # index of the joint it hangs on; -1: the root
    line: int  # where the file defines it
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # from its parent, in the file's units
    channels: list[str] = field(default_factory=list)  # what the motion says of it, in the file's order
    tip: tuple[float, float, float] | None = None  # offset of its End Site


@dataclass(frozen=True, eq=False)
class Bvh:
    """A motion capture as the file has it: its own units and axes.

    Position channels of other joints than the root are not kept: bones do not stretch.
    """

    source: str  # the file
    joints: tuple[Joint, ...]  # parents first
    interval: float  # between frames [s]
    root: Float64Array  # place of the root, shape (n_frame, 3); its offset where the file gives no channels for it
    rotation: Float64Array  # of every joint against its parent, shape (n_frame, n_joint, 3, 3)

    @property
    def duration(self) -> float:
        """From the first to the last frame [s]."""
        return (len(self.root) - 1) * self.interval


def load_bvh(path: str | Path) -> Bvh:
    """Read a motion capture, a .bvh file; channels may come in any order.

    Raises
    ------
    DataError
        Naming file and line: what is not BVH, cut off, of the wrong length, or not a finite number.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as a motion capture ({error}); give the path of a .bvh text file") from error
    lines = _Lines(str(path), text)
    joints = _hierarchy(lines)
    interval, values = _motion(lines, sum(len(joint.channels) for joint in joints))
    root, rotation = _channels(joints, values)
    return Bvh(str(path), joints, interval, root, rotation)


class _Lines:
    """Lines of a file that are not empty, as words, with their numbers."""

    def __init__(self, source: str, text: str) -> None:
        self.source, self.number = source, 0
        self._rest: Iterator[tuple[int, list[str]]] = (
            (number, words) for number, line in enumerate(text.splitlines(), 1) if (words := line.split())
        )

    def error(self, what: str, number: int | None = None) -> DataError:
        return DataError(f"{self.source}, line {self.number if number is None else number}: {what}")

    def next(self, wanted: str) -> list[str]:
        """Words of the next line."""
        for words in self.left():
            return words
        raise self.error(f"the file ends here, but {wanted} should follow; get the whole file")

    def left(self) -> Iterator[list[str]]:
        for number, words in self._rest:
            self.number = number
            yield words

    def numbers(self, words: list[str], what: str) -> list[float]:
        try:
            numbers = [float(word) for word in words]
        except ValueError as error:
            raise self.error(f"{what}: {error}; there must be numbers") from error
        if not all(map(math.isfinite, numbers)):
            raise self.error(f"{what}: {next(w for w, x in zip(words, numbers, strict=True) if not math.isfinite(x))} is no finite number")
        return numbers


def _hierarchy(lines: _Lines) -> tuple[Joint, ...]:
    """Read the skeleton."""
    if lines.next("HIERARCHY") != ["HIERARCHY"]:
        raise lines.error("the first word of a BVH file is HIERARCHY; this is something else")
    joints: list[Joint] = []
    open_: list[int] = []  # joints that we are inside of; -1: an End Site
    while True:
        words = lines.next("the rest of the skeleton and MOTION")
        key = words[0]
        if key in ("ROOT", "JOINT") and len(words) >= 2 and (key == "ROOT") == (not joints):
            _enter(lines, joints, open_, " ".join(words[1:]))
        elif words[:2] == ["End", "Site"] and open_ and open_[-1] >= 0:
            open_.append(-1)
            _brace(lines)
        elif key == "OFFSET" and open_ and len(words) == 4:
            x, y, z = lines.numbers(words[1:], "OFFSET")
            if open_[-1] >= 0:
                joints[open_[-1]].offset = (x, y, z)
            else:
                joints[open_[-2]].tip = (x, y, z)
        elif key == "CHANNELS" and open_ and open_[-1] >= 0:
            joints[open_[-1]].channels = _named(lines, words)
        elif words == ["}"] and open_:
            open_.pop()
        elif words == ["MOTION"] and joints and not open_:
            return tuple(joints)
        else:
            raise lines.error(f"{' '.join(words)!r} is not what a skeleton goes on with here; compare the lines before with another file")


def _enter(lines: _Lines, joints: list[Joint], open_: list[int], name: str) -> None:
    name = name.rpartition(":")[2]  # some programs write the character's name before a colon
    if joints and (not open_ or open_[-1] < 0):
        raise lines.error(f"joint {name} hangs on nothing; a file can hold one skeleton")
    for joint in joints:
        if joint.name == name:
            raise lines.error(f"there is a joint {name} already, in line {joint.line}; names must differ")
    joints.append(Joint(name, open_[-1] if open_ else -1, lines.number))
    open_.append(len(joints) - 1)
    _brace(lines)


def _brace(lines: _Lines) -> None:
    if lines.next("{") != ["{"]:
        raise lines.error("here should be {")


def _named(lines: _Lines, words: list[str]) -> list[str]:
    """Channels of a joint."""
    names = words[2:]
    if len(words) < 2 or words[1] != str(len(names)):
        raise lines.error(f"CHANNELS says {' '.join(words[1:2]) or 'nothing'}, but {len(names)} follow")
    for name in names:
        if name not in _CHANNELS:
            raise lines.error(f"{name} is no channel; there are {', '.join(_CHANNELS)}")
    if len(set(names)) < len(names):
        raise lines.error("a channel is named twice")
    return names


def _motion(lines: _Lines, n_value: int) -> tuple[float, Float64Array]:
    """Read frame interval and values, shape (n_frame, n_value)."""
    words = lines.next("Frames:")
    if len(words) != 2 or words[0] != "Frames:" or not words[1].isdigit() or int(words[1]) < 1:
        raise lines.error("here should be 'Frames:' and how many there are, at least 1")
    n_frame = int(words[1])
    words = lines.next("Frame Time:")
    if len(words) != 3 or words[:2] != ["Frame", "Time:"]:
        raise lines.error("here should be 'Frame Time:' and a time in seconds")
    interval = lines.numbers(words[2:], "Frame Time")[0]
    if interval <= 0.0:
        raise lines.error(f"Frame Time is {interval:g} s; it must be positive")
    values: list[list[float]] = []
    for words in lines.left():
        if len(values) == n_frame:
            raise lines.error(f"there are more frames than the {n_frame} that Frames: says")
        if len(words) != n_value:
            raise lines.error(f"frame {len(values) + 1} has {len(words)} values; the skeleton has {n_value} channels")
        values.append(lines.numbers(words, f"frame {len(values) + 1}"))
    if len(values) < n_frame:
        raise lines.error(f"the file ends after {len(values)} of {n_frame} frames; get the whole file, or correct Frames:")
    return interval, np.array(values).reshape(n_frame, n_value)


def _channels(joints: tuple[Joint, ...], values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Place of the root and rotation of every joint."""
    n = len(values)
    root: Float64Array = np.tile(np.array(joints[0].offset), (n, 1))
    rotation = np.empty((n, len(joints), 3, 3))
    column = 0
    for number, joint in enumerate(joints):
        turn = np.tile(np.eye(3), (n, 1, 1))
        for name in joint.channels:
            axis = "XYZ".index(name[0])
            if name.endswith("rotation"):
                turn = turn @ about(axis, np.radians(values[:, column]))
            elif number == 0:
                root[:, axis] = values[:, column]
            column += 1
        rotation[:, number] = turn
    return root, rotation


def about(axis: int, angle: NDArray[np.float64]) -> Float64Array:
    """Rotations about an axis, shape (n, 3, 3)."""
    turn = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn
