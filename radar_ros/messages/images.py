"""Images of cameras to and from ``sensor_msgs/Image``, without cv_bridge, which is not on PyPI."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from radar_core import DataError
from radar_ros.messages.convert import header

_ENCODINGS = {"rgb8": ("u1", 3), "bgr8": ("u1", 3), "16UC1": ("u2", 1), "mono16": ("u2", 1), "32FC1": ("f4", 1)}
_COLOUR, _DEPTH = ("rgb8", "bgr8"), ("16UC1", "mono16", "32FC1")


def colour_from_msg(msg: Any) -> NDArray[np.uint8]:
    """Take a colour image out of a message: red, green, blue, uint8 of shape (height, width, 3); of rgb8 a view of its buffer.

    A `DataError` says that its encoding is another than rgb8 or bgr8, or its data too short.
    """
    pixels = _pixels(msg, _COLOUR, "colour")
    return np.ascontiguousarray(pixels[..., ::-1]) if msg.encoding == "bgr8" else pixels


def depth_from_msg(msg: Any) -> NDArray[Any]:
    """Take a depth image out of a message: uint16 [mm] or float32 [m] of shape (height, width), a view of its buffer.

    A `DataError` says that its encoding is another than 16UC1 (mono16) or 32FC1, or its data too short.
    """
    return _pixels(msg, _DEPTH, "depth")[..., 0]


def _pixels(msg: Any, allowed: tuple[str, ...], what: str) -> NDArray[Any]:
    """Pixels of an image, shape (height, width, channels), in the byte order of this machine."""
    if msg.encoding not in allowed:
        raise DataError(f"the {what} image has the encoding {msg.encoding!r}; expected {' or '.join(allowed)}: set it in its driver")
    code, channels = _ENCODINGS[msg.encoding]
    kind = np.dtype(f"{'>' if msg.is_bigendian else '<'}{code}")
    row = msg.width * channels * kind.itemsize
    if msg.step < row or len(msg.data) < msg.step * msg.height or not (msg.width and msg.height):
        raise DataError(
            f"the {what} image says {msg.width} x {msg.height} pixels of {msg.encoding} in rows of {msg.step} bytes, but carries "
            f"{len(msg.data)} bytes; its driver is broken"
        )
    rows = np.frombuffer(msg.data, np.uint8, msg.step * msg.height).reshape(msg.height, msg.step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(kind).reshape(msg.height, msg.width, channels)
    return pixels if kind.isnative else pixels.astype(kind.newbyteorder("="))


def image_to_msg(pixels: NDArray[Any], stamp_ns: int, frame_id: str) -> Image:
    """Put an image into a message: uint8 (height, width, 3) as rgb8, uint16 (height, width) as 16UC1, float32 as 32FC1.

    A `DataError` says that it is none of these.
    """
    encoding = {("u1", 3): "rgb8", ("u2", 2): "16UC1", ("f4", 2): "32FC1"}.get((pixels.dtype.str[1:], pixels.ndim))
    if encoding is None or (encoding == "rgb8" and pixels.shape[2] != 3):
        raise DataError(f"an image of {pixels.dtype} and shape {pixels.shape} has no encoding; give rgb uint8, or depth uint16 or float32")
    data = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder("<"), copy=False))
    height, width = data.shape[:2]
    image = Image(header=header(stamp_ns, frame_id), height=height, width=width, encoding=encoding, is_bigendian=0, step=data.strides[0])
    image.data = array.array("B", data.tobytes())
    return image
