"""Independent pieces of work on many cores or machines, with a progress bar."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain

from joblib import Parallel, delayed, effective_n_jobs
from threadpoolctl import threadpool_limits

_BATCH = 4  # pieces handed to a worker at once, at most
_ROUNDS = 4  # batches per worker, at least: the last ones then end at about the same time


def work_through(
    make: Callable[[int], None],
    todo: Sequence[int],
    *,
    n_total: int,
    n_jobs: int | None = None,
    progress: bool = True,
    title: str = "working",
) -> None:
    """Call ``make`` for every number in ``todo``, several at a time.

    Workers are joblib's: processes of this machine, unless the caller has chosen another back end. With Dask, on a cluster::

        with Client("tcp://scheduler:8786"), joblib.parallel_config(backend="dask"):
            work_through(...)

    Each piece runs on one thread: the cores are taken by pieces, and sums that several threads share would round differently.

    Parameters
    ----------
    make : callable
        Does one piece; a function of a module, so that it can be sent to other processes.
    todo : sequence of int
        Pieces to do.
    n_total : int
        All pieces, those done by an earlier run too; for the progress bar.
    n_jobs : int or None
        Pieces at the same time, -1: as many as there are cores; None: what joblib's configuration says, else 1. Dask: its whole cluster.
    progress : bool
        Whether to show a progress bar.
    title : str
        Beside the bar.
    """
    size = max(1, min(_BATCH, math.ceil(len(todo) / (_ROUNDS * max(effective_n_jobs(n_jobs), 1)))))
    batches = [list(todo[first : first + size]) for first in range(0, len(todo), size)]
    with threadpool_limits(1):
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered", batch_size=1)
        done = parallel(delayed(_work)(make, batch) for batch in batches)
        for _ in _shown(chain.from_iterable(done), len(todo), n_total, title) if progress and todo else done:
            pass


def _work(make: Callable[[int], None], batch: list[int]) -> list[int]:
    with threadpool_limits(1):
        for number in batch:
            make(number)
    return batch


def _shown(done: Iterable[int], n_todo: int, n_total: int, title: str) -> Iterator[int]:
    """Pass on what is done, with a progress bar that also counts what an earlier run had done."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    with Progress(title, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        task = bar.add_task("", total=n_total, completed=n_total - n_todo)
        for item in done:
            bar.advance(task)
            yield item
