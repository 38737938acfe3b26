"""Progress of long computations, and parallel work on several threads."""

import os
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]
"""A function called with the completed fraction of the work, from 0 to 1."""


def part_of(progress: Progress | None, first: float, total: float = 1.0, length: float = 1.0) -> Progress | None:
    """Return the progress function of a part of the work, which begins at ``first`` of ``total`` and has ``length``."""
    return None if progress is None else lambda done: progress((first + length * done) / total)


def tracked(items: Collection[T], progress: Progress | None) -> Iterator[T]:
    """Yield items in turn, and report the completed fraction after each."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done / len(items))


def on_threads(
    work: Callable[[T], R], items: Collection[T], progress: Progress | None = None, threads: int | None = None
) -> list[R]:
    """Return the results of a function for all items, in order; by default one thread per core computes them.

    If one item fails, those not yet started are cancelled.
    """
    if len(items) == 1:  # starting a thread takes as long as tracing a few rays
        return [work(item) for item in tracked(items, progress)]
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            return [result for _, result in zip(tracked(items, progress), pool.map(work, items), strict=True)]
        finally:
            pool.shutdown(cancel_futures=True)
