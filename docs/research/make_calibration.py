"""The picture of docs/how-to/calibration.md: docs/img/ambiguity.png. The figures: ``python -m benchmarks calibrate_array --json``."""

from __future__ import annotations

import math
from pathlib import Path

from radar_core import RadarInfo
from radar_lab.arrays.ambiguity import plot

INFO = RadarInfo()


def main() -> None:
    """Draw the picture, and print what it shows."""
    for item in plot(INFO.array, INFO.waveform.wavelength, Path(__file__).resolve().parents[1] / "img" / "ambiguity.png"):
        print(
            f"{item.axis}: unambiguous +-{math.degrees(item.unambiguous):.1f} deg, side lobes in view {item.side_lobe:.2f}, "
            f"beamwidth {math.degrees(item.beamwidth):.1f} deg"
        )


if __name__ == "__main__":
    main()
