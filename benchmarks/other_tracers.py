"""Speed of the engine compared with other tracers: same scenes, same machine, one run.

Run with ``python -m benchmarks.other_tracers`` in the project folder; ``--markdown`` prints a table for the
documentation. A tracer that is not installed is listed with the command that installs it. All tracers use counting
mode, as described in `benchmarks.cases`; the detected fraction and the number of interactions per ray show that they
compute the same.

Each figure is the best of several runs in CPU time of the process, without compilation; pvtrace runs once, with a
hundred rays, so its fraction has steps of 0.01. The curves of solen are exact; the other tracers use a mesh within
1e-5 mm of them, or a box. In space, the table also gives the error of the detected fraction, and the time to reach 1e-4
on one core.
"""

import argparse
import os
import platform
from functools import partial
from typing import Literal

import numba

import solen
from benchmarks import with_mitsuba, with_pvtrace
from benchmarks.cases import ERROR, Case, Row, Tool, paper_case, slab_case, space_case
from benchmarks.tracing import RAYS, best_s
from solen.scene import Scene
from solen.trace import integrate, trace

HEADER = (
    "scene", "tracer", "geometry", "rays", "rays/s", "interactions/s", "per ray", "detected", "lost", "error",
    f"s to {ERROR:g}",
)  # fmt: skip
TEXT_COLUMNS = 3


def solen_versions() -> str:
    """Return the versions of solen and its compiler, and the number of cores."""
    python = f"Python {platform.python_version()} on {os.cpu_count()} cores"
    return f"solen {solen.__version__}, numba {numba.__version__}, {python}"


def solen_rows(case: Case, rays: int) -> list[Row]:
    """Return rows for one thread, for all threads, and for single precision (plane) or integration (space)."""
    scene, cores = case.make(rays), os.cpu_count() or 1
    settings: list[tuple[str, int, Literal["double", "single"]]] = [
        ("solen, 1 thread", 1, "double"),
        ("solen", cores, "double"),
    ]
    if scene.extrusion is None:
        settings.append(("solen", cores, "single"))
    rows = []
    for tool, threads, precision in settings:
        run = partial(trace, scene, threads=threads, precision=precision)
        result = run()
        geometry = "float64 exact" if precision == "double" else "float32 exact"
        detected, error = result.ledger.detected, result.u_ledger.detected
        rows.append(Row(case.name, tool, geometry, rays, best_s(run), result.hits, detected, result.undefined, error))
    if scene.extrusion is not None:
        rows.append(integrated_row(case, scene))
    return rows


def integrated_row(case: Case, scene: Scene) -> Row:
    """Return a row for integration."""
    run = partial(integrate, scene, "count", ERROR)
    result = run()
    counts = (result.rays, best_s(run), result.hits, result.ledger.detected, 0)
    return Row(case.name, "solen, integrated", "float64 exact", *counts, result.u_power)


TOOLS = (Tool("solen", lambda: None, solen_versions, solen_rows), with_mitsuba.TOOL, with_pvtrace.TOOL)


def cells(row: Row) -> tuple[str, ...]:
    """Return a row as text, in the order of `HEADER`."""
    return (
        row.case,
        row.tool,
        row.geometry,
        f"{row.rays}",
        f"{row.rays / row.seconds:.3g}",
        f"{row.hits / row.seconds:.3g}",
        f"{row.hits / row.rays:.3f}",
        f"{row.detected:.4f}",
        f"{row.lost}",
        "" if row.error is None else f"{row.error:.1e}",
        "" if row.to_error_s is None else f"{row.to_error_s:.2g}",
    )


def plain(rows: list[tuple[str, ...]]) -> str:
    """Return a table with aligned columns."""
    widths = [max(len(row[column]) for row in (HEADER, *rows)) for column in range(len(HEADER))]
    lines = []
    for row in (HEADER, *rows):
        padded = [
            text.ljust(width) if column < TEXT_COLUMNS else text.rjust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)


def markdown(rows: list[tuple[str, ...]]) -> str:
    """Return a table for the documentation."""
    rule = ["---" if column < TEXT_COLUMNS else "--:" for column in range(len(HEADER))]
    return "\n".join("| " + " | ".join(row) + " |" for row in (HEADER, rule, *rows))


def main() -> None:
    """Print the table, then the versions."""
    parser = argparse.ArgumentParser(description="Compare the speed of the engine with other tracers.")
    parser.add_argument("--rays", type=int, default=RAYS, help=f"number of rays for the fast tracers (default {RAYS})")
    parser.add_argument("--markdown", action="store_true", help="print a Markdown table")
    options = parser.parse_args()
    reasons = {tool.name: tool.missing() for tool in TOOLS}
    tools = [tool for tool in TOOLS if reasons[tool.name] is None]
    rows = [
        cells(row)
        for case in (paper_case(), slab_case(), space_case())
        for tool in tools
        for row in tool.measure(case, options.rays)
    ]
    print(markdown(rows) if options.markdown else plain(rows))
    print()
    print("; ".join(tool.versions() for tool in tools) + ".")
    for name, reason in reasons.items():
        if reason is not None:
            print(f"{name} omitted: {reason}")


if __name__ == "__main__":
    main()
