"""What each command does from end to end: inputs read, stages called, outputs written.

Every function returns a plain dictionary, ready for JSON; the command line only chooses how to show it. Whatever is
computed is computed before the first file is written, and files are renamed into place, so that an interrupted command
leaves nothing half-written.
"""

import csv
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from solen import files
from solen.errors import OutputError, SpecError
from solen.report import results as numbers
from solen.sensor import Sensor, study
from solen.spec import Design, json_schema, load, parse_assignment, template, template_names, with_values
from solen.trace import Path as Way
from solen.trace import Trace

DESIGN_NAME = "sensor.toml"
MOST_PATHS = 100_000
"""Rays whose ways are written out at most."""
FIGURE_KINDS = (".svg", ".png", ".pdf")

Progress = Callable[[float], None]


def open_design(path: Path, assignments: Sequence[str] = ()) -> Design:
    """Design of a file, with ``key=value`` assignments put in; of two to one key the later one counts."""
    design = load(path)
    changes = dict(parse_assignment(text) for text in assignments)
    return with_values(design, changes) if changes else design


def new(folder: Path, example: str = "solen-860") -> dict[str, Any]:
    """Write a commented design file into a folder; an existing one is never overwritten."""
    if example not in template_names():
        raise SpecError("--example", value=example, limit=f"must be one of {', '.join(template_names())}")
    with files.output_folder(folder):
        target = folder / DESIGN_NAME
        if target.exists():
            raise OutputError(str(target), limit="exists already", remedy="name another folder or remove it")
        files.write_text(target, template(example))
    return {"design": str(target), "example": example}


def schema() -> dict[str, Any]:
    """JSON Schema of the design file."""
    return json_schema()


def check(path: Path, assignments: Sequence[str] = ()) -> dict[str, Any]:
    """Prove that a design can be built at every angle of its motion, and say what follows from it."""
    design = open_design(path, assignments)
    sensor = Sensor.of(design)
    sensor.check()
    return {
        "design": str(path),
        "name": design.name,
        "angles": len(design.motion.angles_deg()),
        "material": numbers.material_numbers(sensor),
        "lens": numbers.lens_numbers(sensor.lens, sensor.material.index),
        "body": numbers.body_numbers(sensor),
    }


def lens(
    path: Path, assignments: Sequence[str] = (), table: Path | None = None, tolerance_mm: float = 1e-4
) -> dict[str, Any]:
    """Numbers of a design's lens, and its profile as a table of x, z where one is asked for."""
    if not (math.isfinite(tolerance_mm) and tolerance_mm >= 1e-9):
        raise SpecError("--tolerance-mm", value=tolerance_mm, limit="must be finite and at least 1e-9 mm")
    sensor = Sensor.of(open_design(path, assignments))
    sensor.body()
    found = numbers.lens_numbers(sensor.lens, sensor.material.index)
    if table is not None:
        points = sensor.lens.front.flattened(tolerance_mm)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["x_mm", "z_mm"])
        writer.writerows([round(float(x), 14), round(float(z), 14)] for x, z in points)
        files.write_text(table, text.getvalue())
        found |= {"profile": str(table), "profile_points": len(points), "profile_tolerance_mm": tolerance_mm}
    return found


def trace_design(
    path: Path,
    assignments: Sequence[str] = (),
    *,
    angle_deg: float = 0.0,
    paths: bool = False,
    figure: Path | None = None,
) -> dict[str, Any]:
    """Trace a design at one angle."""
    if not (math.isfinite(angle_deg) and abs(angle_deg) < 90.0):
        raise SpecError("--angle-deg", value=angle_deg, limit="must be between -90 and 90")
    if figure is not None and figure.suffix.lower() not in FIGURE_KINDS:
        raise OutputError(str(figure), limit=f"a figure ends in {', '.join(FIGURE_KINDS)}", remedy="rename it")
    design = open_design(path, assignments)
    if paths and design.emitter.rays > MOST_PATHS:
        raise SpecError("--paths", value=f"{design.emitter.rays} rays", limit=f"writes at most {MOST_PATHS} of them")
    sensor = Sensor.of(design)
    result = sensor.trace(angle_deg, legs=paths)
    if figure is not None:
        _draw(sensor, angle_deg, figure)
    return _traced(sensor, angle_deg, result) | ({"figure": str(figure)} if figure else {})


def run(path: Path, out: Path, assignments: Sequence[str] = (), progress: Progress | None = None) -> dict[str, Any]:
    """Do the whole chain: lens, body, traces over the motion with and without lens, figures, tables and report."""
    from solen.report import html

    design = open_design(path, assignments)
    with files.output_folder(out):
        found = study(design, progress)
        drawn = html.figures(found)
        data = numbers.results(found)
        texts = {f"{name}.svg": text for name, text in drawn.items()}
        texts["results.json"] = numbers.json_text(data)
        texts["results.csv"] = numbers.csv_table(found)
        texts["report.html"] = html.html(found, drawn)
        written = files.write_all({out / name: text.encode("utf-8") for name, text in texts.items()})
        for name in html.FIGURES:
            if name not in drawn:  # of an earlier design
                files.remove(out / f"{name}.svg")
    return {
        "report": str(out / "report.html"),
        "files": [str(file) for file in written],
        "name": design.name,
        "material": data["material"],
        "lens": data["lens"],
        "summary": data["summary"],
    }


def _traced(sensor: Sensor, angle_deg: float, result: Trace) -> dict[str, Any]:
    ledger = result.ledger
    found: dict[str, Any] = {
        "name": sensor.design.name,
        "angle_deg": angle_deg,
        "lens": sensor.design.lens.shape,
        "mode": result.mode,
        "rays": result.rays,
        "detectors": {
            name: {"power": result.detectors[name].power, "rays": result.detectors[name].rays}
            for name in sorted(result.detectors)
        },
        "ledger": {
            "detected": ledger.detected,
            "escaped": ledger.escaped,
            "absorbed": ledger.absorbed,
            "truncated": ledger.truncated,
        },
        "hits": result.hits,
        "undefined": result.undefined,
        "undefined_at_mm": [list(place) for place in result.undefined_at],
    }
    if result.legs is not None:
        faces = [interface.name for interface in sensor.scene(angle_deg).interfaces]
        found["paths"] = [_way(way, faces) for way in result.paths()]
    return found


def _way(way: Way, faces: list[str]) -> dict[str, Any]:
    return {
        "ray": way.ray,
        "branch": way.branch,
        "parent": way.parent,
        "fate": way.fate,
        "power": way.power,
        "faces": [faces[i] for i in way.interfaces],
        "points_mm": way.points.tolist(),
        "exit_direction": None if way.exit_direction is None else list(way.exit_direction),
    }


def _draw(sensor: Sensor, angle_deg: float, target: Path) -> None:
    from solen.report import figures

    shown = min(sensor.design.emitter.rays, figures.SHOWN_RAYS)
    view = figures.sensor_view(sensor, angle_deg, shown, sensor.design.trace.mode)
    files.write_bytes(target, figures.encoded(figures.rays_figure([view]), target.suffix.lower(), "rays"))
