"""What short words cost the fixed-point transform: picture for docs/img and a table.

    python docs/research/make_fixed_point_plot.py            # writes docs/img/fixed_point.png, prints the table as Markdown

The same seed gives the same figures.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from benchmarks.word_length import WordLengthError, word_length_error
from radar_lab.plots import PEOPLE

mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=PEOPLE)  # told apart by everybody

LEVELS = (0.0, 20.0, 40.0, 54.0)
"""Strongest echo over the noise, both in a sample [dB]; leakage of -60 dB stands 54 dB above the noise of the default radar."""
BITS = range(8, 17)


def draw(errors: list[WordLengthError], path: Path) -> None:
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.8), constrained_layout=True)
    bits = [error.word_length for error in errors]
    for i, level in enumerate(LEVELS):
        left.plot(bits, [error.snr_loss[i] for error in errors], "o-", label=f"{level:.0f} dB")
    left.set(xlabel="word length [bit]", ylabel="loss of SNR [dB]", title="Target near the noise floor", ylim=(-0.5, 30))
    left.legend(title="strongest echo over\nthe noise of a sample")
    right.plot(bits, [error.spur for error in errors], "o-", label="largest spur")
    right.plot(bits, [error.floor for error in errors], "s-", label="mean of the error")
    right.plot(bits, [errors[0].spur - 6.02 * (b - bits[0]) for b in bits], "k:", label="6 dB a bit")
    right.set(xlabel="word length [bit]", ylabel="relative to the echo's peak [dB]", title="Beside a strong echo alone")
    right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.set_xticks(bits)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def table(errors: list[WordLengthError]) -> str:
    header = ["bits", "largest spur", "mean error", *(f"SNR loss at {level:.0f} dB" for level in LEVELS)]
    lines = [header, ["---:"] * len(header)]
    for error in errors:
        losses = (f"{max(loss, 0.0):.2f} dB" for loss in error.snr_loss)
        lines.append([str(error.word_length), f"{error.spur:.1f} dB", f"{error.floor:.1f} dB", *losses])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).resolve().parents[1] / "img" / "fixed_point.png")
    parser.add_argument("--trials", type=int, default=256, help="channels with random noise to average over")
    options = parser.parse_args()
    errors = [word_length_error(bits, LEVELS, n_trial=options.trials) for bits in BITS]
    draw(errors, options.output)
    print(table(errors))


if __name__ == "__main__":
    main()
