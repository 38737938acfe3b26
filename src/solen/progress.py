"""Long work: the share of it that is done, and items on several threads."""

import os
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]
"""Called with the share of the work that is done, from 0 to 1."""


def part_of(progress: Progress | None, first: float, parts: float = 1.0, length: float = 1.0) -> Progress | None:
    """Progress of a part of some work: where it begins and its length, of a whole of ``parts``."""
    return None if progress is None else lambda done: progress((first + length * done) / parts)


def tracked(items: Collection[T], progress: Progress | None) -> Iterator[T]:
    """Items in turn; after each, the progress is called with the share of them that is done."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done / len(items))


def on_threads(
    work: Callable[[T], R], items: Collection[T], progress: Progress | None = None, threads: int | None = None
) -> list[R]:
    """Results of some work on each item, in order, by default on a thread per core.

    If one item fails, those that have not begun are left.
    """
    if len(items) == 1:  # starting a thread takes as long as tracing few rays
        return [work(item) for item in tracked(items, progress)]
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            return [result for _, result in zip(tracked(items, progress), pool.map(work, items), strict=True)]
        finally:
            pool.shutdown(cancel_futures=True)
