"""Commands about synthetic data sets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from radar_core import ConfigError


def synthesise(
    folder: Annotated[Path, typer.Argument(help="folder of the data set; what is there already stays, and a stopped run goes on")],
    samples: Annotated[int, typer.Option("--samples", "-n", help="samples that the folder shall hold in the end", min=1)] = 600,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="processes that simulate; -1: one per core", min=-1)] = -1,
    seed: Annotated[int, typer.Option(help="of everything random", min=0)] = 1,
    plan: Annotated[str, typer.Option(help="thesis: ten animations of seven gestures; all: the ten gestures")] = "thesis",
    gestures: Annotated[str, typer.Option(help="only these of the plan, with commas between, e.g. push,pull")] = "",
    body: Annotated[str, typer.Option(help="mesh, or ellipsoids, which takes less time")] = "mesh",
    raw: Annotated[bool, typer.Option("--raw", help="keep the raw frames too, about 16 MB a sample")] = False,
    cluster: Annotated[str, typer.Option(help="address of a Dask scheduler whose workers share the folder, e.g. tcp://host:8786")] = "",
) -> None:
    """Simulate single gestures of many people, each with maps, features and truth in a file of its own.

    A sample depends on the seed and its number only: workers, machines and restarts change no byte. A run that is stopped, or killed, goes
    on with the same command. docs/simulator.md says what a file holds.

    Examples: `handwave synthesise strokes` · `handwave synthesise more -n 2000 --plan all --body ellipsoids --seed 7`
    """
    from radar_gestures.synthesis import synthesise as run
    from radar_gestures.synthesis_plan import Plan
    from radar_ros.interrupts import INTERRUPTED, interruptible

    if jobs == 0:
        raise ConfigError("--jobs 0: give the number of processes, or -1 for one per core")
    names = tuple(name.strip() for name in gestures.split(",") if name.strip())
    chosen = Plan(animations=plan, gestures=names)
    with interruptible(), _workers(cluster):
        try:
            done = run(folder, samples, seed=seed, n_jobs=jobs, plan=chosen, body=body, raw=raw)
        except KeyboardInterrupt:
            held = len(list(folder.glob("sample_*.npz")))
            print(f"stopped: {held} of {samples} samples in {folder}; the same command goes on")
            raise typer.Exit(INTERRUPTED) from None
    print(f"{done} samples simulated, {samples} in {folder}")


@contextmanager
def _workers(cluster: str) -> Iterator[None]:
    """Let a Dask cluster work; without an address, joblib's own processes."""
    if not cluster:
        yield
        return
    try:
        from distributed import Client
    except ImportError:
        raise ConfigError("--cluster needs Dask; install it with: pip install 'handwave[cluster]'") from None
    from joblib import parallel_config

    try:
        client = Client(cluster)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigError(f"--cluster {cluster}: there is no scheduler ({error}); start one with `dask scheduler`") from None
    with client, parallel_config(backend="dask"):
        yield
