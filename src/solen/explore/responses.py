"""Responses of many designs, which are read from a store, or traced and added to it.

Public names: `responses`, `failures_of` and `point_warnings`.
"""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from pydantic import Field

from solen.errors import DesignError, SpecError
from solen.explore.machines import LocalMachine, Machine
from solen.explore.measures import Measure
from solen.explore.store import Accuracy, Point, Store, Variant, no_response
from solen.progress import Progress, part_of
from solen.spec.strict import Finite, Options

MAX_REASONS = 3
MAX_LOADED = 2**14
"""Largest number of points whose designs are in memory at the same time."""
BLOCK_S, BLOCK_POINTS = 5.0, 256
"""Time in s after which, and number of points from which, traced points are written as a block."""
NUMBER = re.compile(r"[-+]?\d[\d.,]*(e[-+]?\d+)?")


class AccuracyOptions(Options):
    """Accuracy of traced responses."""

    tolerance: Finite | None = Field(None, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power, as a fraction of the emitted power; default: 1e-6 for a monochromatic point
    source, 1e-4 for any other source.
    """
    rays: int | None = Field(None, ge=256, le=10_000_000)
    """Number of rays to trace at each angle with the compiled batch. This replaces integration and is faster for very
    many designs with a chip in the plane (2-D). Designs that the batch does not support are integrated.
    """

    @property
    def accuracy(self) -> Accuracy:
        """The accuracy in the form that a `Machine` takes."""
        return Accuracy(self.tolerance, self.rays)


def responses(
    variants: Iterable[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> list[Point]:
    """Return the responses of variants in their order; those that are not in the store are traced and added to it.

    A design that cannot be built or traced gives a point without a response, with the reason. The responses are traced
    by this process or by another machine.
    """
    makers = list(variants)
    machine = machine or LocalMachine()
    points: list[str | Point] = []
    starts = range(0, len(makers), MAX_LOADED)
    for done, first in enumerate(starts):
        part = makers[first : first + MAX_LOADED]
        points += _names_or_points(part, accuracy, store, machine, part_of(progress, done, len(starts)))
    return [store.points[point] if isinstance(point, str) else point for point in points]


def _names_or_points(
    variants: Sequence[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> list[str | Point]:
    """Return for each variant the name of its stored response, or the point of a design that cannot be traced."""
    points: list[str | Point] = []
    missing: dict[str, Variant] = {}
    for make in variants:
        try:
            variant = make()
            points.append(name := variant.name(accuracy))
        except (SpecError, DesignError) as error:  # not stored, since it is reproduced quickly
            points.append(no_response(error))
            continue
        if name not in store.points:
            missing[name] = variant
    _trace(missing, accuracy, store, machine, progress)
    return points


def _trace(
    missing: Mapping[str, Variant],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> None:
    """Trace variants and store them in blocks."""
    block: dict[str, Point] = {}
    written, done = time.monotonic(), 0
    try:
        for points in machine.traced(missing, accuracy):
            block |= points
            done += len(points)
            if len(block) >= BLOCK_POINTS or time.monotonic() - written > BLOCK_S:
                store.add(block)
                block, written = {}, time.monotonic()
            if progress is not None:
                progress(done / len(missing))
    finally:
        store.add(block)


def failures_of(points: Sequence[Point]) -> dict[str, int]:
    """Return the reasons why points have no response, the most frequent first, with their counts.

    Reasons that differ only in their numbers are counted together under the first of them.
    """
    reasons = [point.why for point in points if not point.is_traced]
    first = {NUMBER.sub("", why): why for why in reversed(reasons)}
    return {first[kind]: count for kind, count in Counter(NUMBER.sub("", why) for why in reasons).most_common()}


def point_warnings(measure: Measure, points: Sequence[Point], failures: Mapping[str, int]) -> Iterator[str]:
    """Yield warnings about points without a response, and about those that did not reach the tolerance."""
    if failures:
        failed, first = sum(failures.values()), next(iter(failures))
        others = "".join(f"; {count} of them: {why}" for why, count in list(failures.items())[1:MAX_REASONS])
        more = f"; and {len(failures) - MAX_REASONS} further reasons" if len(failures) > MAX_REASONS else ""
        yield f"points without a response: {failed} of {len(points)}: {first}{others}{more}"
    yield from measure.warnings(points)
    reasons = [point.why for point in points if point.is_traced and point.why]
    if reasons:
        yield (
            f"{len(reasons)} of {len(points)} points did not reach the tolerance; u is the uncertainty reached: "
            f"{reasons[0]}"
        )
