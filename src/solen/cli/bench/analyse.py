"""The command of recordings: `solen bench analyse`."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, show
from solen.cli.bench.recorded import MOVED, RECORDED, Moved, Recorded, request_of

_Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json.")]


def analyse(
    *files: Path,
    moved: Moved = MOVED,
    recorded: Recorded = RECORDED,
    example: Annotated[Path | None, Parameter(negative=())] = None,
    traces: Path | None = None,
    figure: FigureFile = None,
    out: _Out = None,
    as_json: Json = False,
) -> None:
    """Cycles, response curve and numbers of recorded sensors.

    Parameters
    ----------
    files
        Recordings: tables (CSV, TSV, ;, .xlsx) with a time, an angle and receivers' voltages.
    example
        Write the simulated recording that solen ships to this .csv, and analyse it as well.
    traces
        Draw voltages over time with the cycles found into this .svg, .png or .pdf.
    """
    from solen.pipeline.bench import analyse as pipeline

    asked = request_of(files, recorded, moved)
    if example is not None:
        asked = pipeline.with_example(asked, example)
    found = pipeline.analyse(asked, out=out, figure=figure, traces=traces)
    show(found, as_json, lambda: list(_told(found)))


def _told(found: dict[str, Any]) -> Iterator[str]:
    """Lines for a reader."""
    said = "; simulated" if found["simulated"] else ""
    for label, sensor in found["sensors"].items():
        lens = {None: "", True: ", lens", False: ", no lens"}[sensor["lens"]]
        low, high = sensor["motion"][0]["lowest_deg"], sensor["motion"][0]["highest_deg"]
        cycles = f"{sensor['cycles_used']} of {len(sensor['cycles'])} cycles"
        yield f"{label}{lens}: {cycles}, {low:.3g}° to {high:.3g}°{said}"
        for name, one in sensor["receivers"].items():
            yield from _of_receiver(name, one)
        if sensor["left_minus_right"] is not None:
            pair = sensor["left_minus_right"]
            yield f"  left and right show one voltage at {_pm(pair, 'balance_deg', '°')}"
    for name, one in (found["lens_beside_none"] or {}).items():
        share = one["without_lens_percent"]
        if share is not None:
            yield f"without a lens {name} swings by {share:.3g} % of what it does with one"
    for warning in found["warnings"]:
        yield f"warning: {warning}"
    for kind in ("out", "figure", "traces"):
        if kind in found:
            yield f"{kind}: {found[kind]}"


def _of_receiver(name: str, one: dict[str, Any]) -> Iterator[str]:
    slope, zero = (_pm(one, f"sensitivity_{which}V_per_deg", " V/°") for which in ("", "near_zero_"))
    yield f"  {name}: range {_pm(one, 'range_V', ' V')}; sensitivity {slope}, near zero {zero}"
    shares = (
        f"{what} {_percent(one[f'{key}_percent_fs'])}"
        for what, key in (
            ("hysteresis", "hysteresis"),
            ("linearity", "independent_linearity"),
            ("repeatability", "repeatability"),
        )
    )
    yield f"    {', '.join(shares)} of full scale; drift {_pm(one, 'drift_V_per_min', ' V/min')}"
    noise = one["noise_V"]
    angle = one["resolution_near_zero_deg"]
    yield f"    noise {1e3 * noise:.3g} mV" + ("" if angle is None else f", that is {angle:.2g}° near zero")


def _pm(values: dict[str, Any], name: str, unit: str) -> str:
    value, u = values[name], values[f"u_{name}"]
    if value is None:
        return "not known"
    if not u:
        return f"{value:.4g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{digits}f} ± {u:.{digits}f}{unit}" if digits < 9 else f"{value:.9g} ± {u:.1e}{unit}"


def _percent(value: float | None) -> str:
    return "not known" if value is None else f"{value:.2g} %"
