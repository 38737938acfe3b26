"""The command that sweeps parameters of a design."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.explore.merits import table_merits
from solen.explore.swept import Sweep
from solen.pipeline.explore.sweep import sweep as sweep
from solen.report.design.summary import measured

MAX_ROWS = 40


@lines.register
def _(result: Sweep) -> Iterator[str]:
    failed = sum(result.failures.values())
    reused = result.points * (1 + len(result.robust)) - result.traced - failed
    counts = f"{result.traced} traced, {reused} reused, {failed} failed"
    yield f"simulated: {result.name}, {result.points} points ({_kind(result)}): {counts}"
    if result.robust:
        yield f"each point with {len(result.robust)} deviations, and without; the file contains the worst merits"
    heads = [*result.values, *table_merits(result.merits)]
    widths = [max(12, len(head)) for head in heads]
    yield "  ".join(f"{head:>{width}}" for head, width in zip(heads, widths, strict=True))
    for point in range(min(result.points, MAX_ROWS)):
        cells = [*(_value(values[point]) for values in result.values.values()), *_merits(result, point)]
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    if result.points > MAX_ROWS:
        yield f"... {result.points - MAX_ROWS} more rows in the table"


def _kind(result: Sweep) -> str:
    if result.is_grid:
        return f"a grid of {' x '.join(map(str, result.shape))}"
    return f"part {result.part}" if result.part else "samples"


def _value(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _merits(result: Sweep, point: int) -> Iterator[str]:
    for name in table_merits(result.merits):
        value, u = result.merits[name][point], result.merits[f"u_{name}"][point]
        yield measured(value, u, sign=False)
