"""Responses of many designs: known ones are read from a store, and others are traced and added to it.

Public names: `responses`, `failures_of` and `point_warnings`.
"""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from pydantic import Field

from solen.errors import DesignError, SpecError
from solen.explore.machines import Here, Machine
from solen.explore.measures import Measure
from solen.explore.store import Accuracy, Point, Store, Variant, no_response
from solen.progress import Progress, part_of
from solen.spec.strict import Finite, Options

MAX_REASONS = 3
LOT = 2**14
"""Number of points whose designs are in memory at the same time."""
BLOCK_S, BLOCK_POINTS = 5.0, 256
"""Longest time in s between writes of points, and the largest number of points in one write."""
NUMBER = re.compile(r"[-+]?\d[\d.,]*(e[-+]?\d+)?")


class AccuracyOptions(Options):
    """Accuracy of traced responses."""

    tolerance: Finite | None = Field(None, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power, as a fraction of the emitted power; default: 1e-6 for a point in one colour, 1e-4
    for any other source.
    """
    rays: int | None = Field(None, ge=256, le=10_000_000)
    """Number of rays to trace at each angle with the compiled batch instead of integrating, which is faster for very
    many designs with a chip in the plane. Designs that the batch does not support are integrated.
    """

    @property
    def accuracy(self) -> Accuracy:
        """The accuracy for the machine that traces."""
        return Accuracy(self.tolerance, self.rays)


def responses(
    variants: Iterable[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> list[Point]:
    """Return responses of designs in their order: known ones from the store, others traced and added to it.

    A design that cannot be built or traced gives a point without angles that states the reason. The responses are
    traced by this process or by another machine.
    """
    every = list(variants)
    machine = machine or Here()
    named: list[str | Point] = []
    lots = range(0, len(every), LOT)
    for done, first in enumerate(lots):
        lot = every[first : first + LOT]
        named += _named(lot, accuracy, store, machine, part_of(progress, done, len(lots)))
    return [store.points[one] if isinstance(one, str) else one for one in named]


def _named(
    variants: Sequence[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> list[str | Point]:
    """Return the names of responses, which are in the store afterwards, or points of designs that cannot be traced."""
    named: list[str | Point] = []
    missing: dict[str, Variant] = {}
    for make in variants:
        try:
            variant = make()
            named.append(name := variant.name(accuracy))
        except (SpecError, DesignError) as bad:  # reproducible, and found quickly
            named.append(no_response(bad))
            continue
        if name not in store.points:
            missing[name] = variant
    _trace(missing, accuracy, store, machine, progress)
    return named


def _trace(
    missing: Mapping[str, Variant],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> None:
    """Trace variants and store them in blocks."""
    fresh: dict[str, Point] = {}
    written, done = time.monotonic(), 0
    try:
        for points in machine.traced(missing, accuracy):
            fresh |= points
            done += len(points)
            if len(fresh) >= BLOCK_POINTS or time.monotonic() - written > BLOCK_S:
                store.add(fresh)
                fresh, written = {}, time.monotonic()
            if progress is not None:
                progress(done / len(missing))
    finally:
        store.add(fresh)


def failures_of(points: Sequence[Point]) -> dict[str, int]:
    """Return the reasons why points have no response, the most frequent first, with their counts.

    Reasons that differ only in their numbers count as the first of them.
    """
    reasons = [point.why for point in points if not point.is_traced]
    first = {NUMBER.sub("", why): why for why in reversed(reasons)}
    return {first[kind]: number for kind, number in Counter(NUMBER.sub("", why) for why in reasons).most_common()}


def point_warnings(measure: Measure, points: Sequence[Point], failures: Mapping[str, int]) -> Iterator[str]:
    """Return warnings about points without a response, and about those that did not reach the tolerance."""
    if failures:
        many, first = sum(failures.values()), next(iter(failures))
        others = "".join(f"; {number} of them: {why}" for why, number in list(failures.items())[1:MAX_REASONS])
        more = f"; and {len(failures) - MAX_REASONS} further reasons" if len(failures) > MAX_REASONS else ""
        yield f"{many} of {len(points)} points have no response: {first}{others}{more}"
    yield from measure.warnings(points)
    rough = [point.why for point in points if point.is_traced and point.why]
    if rough:
        yield (
            f"{len(rough)} of {len(points)} points did not reach the tolerance; u is the uncertainty reached: "
            f"{rough[0]}"
        )
