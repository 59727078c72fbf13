"""Whether a hand is still followed when clouds are lost on the way: single ones at random, and ten in a row."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.hand_gain import NEAR
from benchmarks.hand_runs import DISTANCES, SCRIPTS, HandStore, MaskArray, Tracked, counts, follow, residual, rms, scene, track
from benchmarks.stores import kept

_RUN: Final = 10  # clouds that are lost together
LOSSES: Final = {"0": (0.0, 1), "5": (0.05, 1), "10": (0.1, 1), "20": (0.2, 1), "5_in_tens": (0.05, _RUN)}
"""Share of clouds that are lost, and how many of them in a row, by name."""


def lost(n: int, share: float, row: int, seed: int) -> MaskArray:
    """Draw which of ``n`` clouds are lost, shape (n,): a share of them, so many in a row."""
    begins = np.random.default_rng([30, seed]).random(n) < share / row
    return np.asarray(np.convolve(begins, np.ones(row))[:n] > 0, np.bool_)


def without(tracked: Tracked, gone: MaskArray) -> Tracked:
    """Leave clouds out."""
    left = ~gone
    clouds = [cloud for cloud, here in zip(tracked.clouds, left, strict=True) if here]
    rows = {name: getattr(tracked, name)[left] for name in ("time", "hand", "joint", "velocity")}
    return dataclasses.replace(tracked, clouds=clouds, **rows)


def followed(every: Sequence[Tracked]) -> dict[str, Any]:
    """Shares of the clouds that came at which the hand was followed, with intervals by scenes, and errors of those; by kind of loss."""
    found: dict[str, Any] = {}
    for name, (share, row) in LOSSES.items():
        shares, errors = [], []
        for number, tracked in enumerate(every):
            rest = without(tracked, lost(len(tracked.time), share, row, number))
            error = residual(rest, follow(rest))[counts(rest)]
            shares.append(float((error < NEAR).mean()))
            errors.append(error[error < NEAR])
        drawn = np.random.default_rng(0).choice(shares, size=(1000, len(shares))).mean(axis=1)
        found[name] = {
            "followed": float(np.mean(shares)),
            "interval": [float(x) for x in np.percentile(drawn, (2.5, 97.5))],
            "worst_scene": min(shares),
            "rmse_m": rms(errors),
        }
    return found


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Every script at every distance, bodies of ellipsoids; quick: one scene."""
    scripts, places = ([dataclasses.replace(SCRIPTS[1], duration=3.0)], DISTANCES[:1]) if quick else (SCRIPTS, DISTANCES)
    scenes = [scene(script, seed, far, "ellipsoids") for seed, far in enumerate(places, 1) for script in scripts]
    with kept(keep) as folder:
        store = HandStore(folder)
        store.fill(scenes, n_jobs=1, progress=False)
        by_loss = followed([track(store, one) for one in scenes])
    return {"scenes": len(scenes), "hand_followed_at_5pct_lost": by_loss["5"]["followed"], "by_loss": by_loss, "choices": []}
