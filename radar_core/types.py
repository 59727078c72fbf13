"""Names of the array types that signatures speak of; shapes are in the docstrings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Complex128Array = NDArray[np.complex128]
IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
