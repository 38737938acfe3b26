"""What the commands of a design do: from a new file to the report of its response."""

import csv
import hashlib
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from solen import files
from solen.arrays import Progress
from solen.errors import OutputError, SpecError
from solen.pipeline.design.options import Sampling, check_netcdf, check_paths
from solen.pipeline.outputs import check_figure
from solen.report.design import results as numbers
from solen.report.design.as_printed import printed_summary
from solen.report.plain import number
from solen.sensor import OPTICAL_KEYS, Sensitivity, Sensor, idle_keys, study
from solen.spec import Design, dumps, load, parse_assignment, template, template_names, with_values
from solen.trace import Series, Slope, Trace, convergence
from solen.trace.dataset import writer

DESIGN_NAME = "sensor.toml"


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
        "lens": numbers.lens_numbers(sensor.cut, sensor.material),
        "body": numbers.body_numbers(sensor),
        "warnings": [*sensor.warnings, *idle_keys(sensor)],
    }


def lens(
    path: Path, assignments: Sequence[str] = (), table: Path | None = None, tolerance_mm: float = 1e-4
) -> dict[str, Any]:
    """Numbers of a design's lens, and its profile as a table of x, z where one is asked for."""
    if not (math.isfinite(tolerance_mm) and tolerance_mm >= 1e-9):
        raise SpecError("--tolerance-mm", value=tolerance_mm, limit="must be finite and at least 1e-9 mm")
    sensor = Sensor.of(open_design(path, assignments))
    sensor.body()
    found = numbers.lens_numbers(sensor.lens, sensor.material)
    if table is not None:
        points = sensor.lens.front.flattened(tolerance_mm)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["x_mm", "z_mm"])
        writer.writerows([round(float(x), 14), round(float(z), 14)] for x, z in points)
        files.write_text(table, text.getvalue())
        found |= {"profile": str(table), "profile_points": len(points), "profile_tolerance_mm": tolerance_mm}
    return found | {"warnings": list(sensor.warnings)}


def trace_design(
    path: Path,
    assignments: Sequence[str] = (),
    *,
    angle_deg: float = 0.0,
    sampling: Sampling | None = None,
    paths: bool = False,
    figure: Path | None = None,
    netcdf: Path | None = None,
) -> dict[str, Any]:
    """Trace a design at one angle."""
    sampling = sampling or Sampling()
    _check_angle(angle_deg)
    check_figure(figure)
    sampling.check()
    if netcdf is not None:
        check_netcdf(netcdf)
    design = open_design(path, assignments)
    if paths and sampling.method == "adaptive":
        raise SpecError("--paths", limit="has no meaning with --sampling adaptive", remedy="leave one of them out")
    sensor = Sensor.of(design)
    scene = sensor.scene(angle_deg)
    if paths:
        check_paths(scene)
    if sampling.method == "adaptive":
        result = sensor.integrate(angle_deg, design.trace.mode, sampling.tolerance)
    else:
        options = sampling.options(design.trace.mode, draws=scene.is_random)
        options["legs"] = paths
        result = sensor.trace(angle_deg, **options)
    contents: dict[Path, files.Content] = {}
    if figure is not None:
        contents[figure] = _drawn(sensor, angle_deg, figure.suffix.lower())
    if netcdf is not None:
        contents[netcdf] = writer(result, _attributes(sensor, angle_deg))
    files.write_all(contents)
    where = {"figure": figure, "netcdf": netcdf}
    return _traced(sensor, angle_deg, result) | {name: str(file) for name, file in where.items() if file is not None}


def convergence_of(
    path: Path,
    assignments: Sequence[str] = (),
    *,
    angle_deg: float = 0.0,
    mode: str = "power",
    figure: Path | None = None,
) -> dict[str, Any]:
    """Error against rays of a design at one angle, for each way to choose the rays."""
    _check_angle(angle_deg)
    check_figure(figure)
    design = with_values(open_design(path, assignments), {"trace.mode": mode})
    sensor = Sensor.of(design)
    found = convergence(sensor.scene(angle_deg), design.trace.mode)
    if figure is not None:
        from solen.report import canvas
        from solen.report.design import figures

        drawn = canvas.encoded(figures.convergence_figure(found), figure.suffix.lower(), "convergence")
        files.write_bytes(figure, drawn)
    reference = found.reference
    return {
        "name": design.name,
        "angle_deg": angle_deg,
        "mode": found.mode,
        "reference": {
            "method": reference.method,
            "rays": reference.rays,
            "u": number(reference.u_power),
            "detectors": {name: reference.detectors[name].power for name in sorted(reference.detectors)},
        },
        "series": [_series(series) for series in found.series],
        "warnings": list(sensor.warnings),
    } | ({"figure": str(figure)} if figure else {})


def sensitivity(
    path: Path,
    keys: Sequence[str] = (),
    assignments: Sequence[str] = (),
    *,
    angle_deg: float = 0.0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Derivatives of a design's readings at one angle with respect to its numbers."""
    _check_angle(angle_deg)
    sensor = Sensor.of(open_design(path, assignments))
    rows = sensor.sensitivity(keys or None, angle_deg, progress)
    skipped = {} if keys else {key: sensor.inert(key) for key in OPTICAL_KEYS if sensor.inert(key)}
    return {
        "name": sensor.design.name,
        "angle_deg": angle_deg,
        "sensitivities": [_sensitivity(row) for row in rows],
        "skipped": skipped,
        "warnings": list(sensor.warnings),
    }


def source_of(path: Path) -> dict[str, str]:
    """Name and checksum of a design file, as a source of what follows from it."""
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "format": "design"}


def run(path: Path, out: Path, assignments: Sequence[str] = (), progress: Progress | None = None) -> dict[str, Any]:
    """Do the whole chain: lens, body, traces over the motion with and without lens and beside neighbours, report."""
    from solen.report.design import html

    design = open_design(path, assignments)
    with files.output_folder(out):
        found = study(design, progress, practical=True)
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
        "practice": None if found.practice is None else numbers.practice_summary(found.practice),
        "as_printed": None if found.printed is None else printed_summary(found.printed),
        "warnings": [*found.case.sensor.warnings, *idle_keys(found.case.sensor)],
    }


def _check_angle(angle_deg: float) -> None:
    if not (math.isfinite(angle_deg) and abs(angle_deg) < 90.0):
        raise SpecError("--angle-deg", value=angle_deg, limit="must be between -90 and 90")


def _attributes(sensor: Sensor, angle_deg: float) -> dict[str, str | float]:
    """What a file says of the design that was traced."""
    return {
        "name": sensor.design.name,
        "angle_deg": angle_deg,
        "design": dumps(sensor.design),
        "interfaces": ", ".join(interface.name for interface in sensor.scene(angle_deg).interfaces),
    }


def _traced(sensor: Sensor, angle_deg: float, result: Trace) -> dict[str, Any]:
    scene = sensor.scene(angle_deg)
    faces = {name: [i.name for i in scene.interfaces if i.receiver == name] for name in scene.receivers}
    found: dict[str, Any] = {
        "name": sensor.design.name,
        "angle_deg": angle_deg,
        "lens": sensor.design.lens.shape,
        **numbers.trace_numbers(result, in_space=scene.extrusion is not None),
        "detectors": {name: numbers.detected_numbers(result.detectors[name], faces[name]) for name in sorted(faces)},
        "warnings": [*sensor.warnings, *idle_keys(sensor, result.mode)],
    }
    if result.legs is not None:
        found["paths"] = [
            numbers.way_numbers(way, [interface.name for interface in scene.interfaces]) for way in result.paths()
        ]
    return found


def _series(series: Series) -> dict[str, Any]:
    return {
        "method": series.method,
        "rays": series.rays.tolist(),
        "error": [number(value) for value in series.error],
        "u": [number(value) for value in series.u_power],
    }


def _sensitivity(row: Sensitivity) -> dict[str, Any]:
    slopes: dict[str, Slope] = {"right": row.right, "left": row.left, "contrast": row.contrast}
    values = {name: number(slope.value) for name, slope in slopes.items()}
    uncertainties = {f"u_{name}": number(slope.u_value) for name, slope in slopes.items()}
    return {"key": row.key, "value": row.value, **values, **uncertainties, "why": row.why or None}


def _drawn(sensor: Sensor, angle_deg: float, suffix: str) -> bytes:
    from solen.report import canvas
    from solen.report.design import figures

    shown = min(sensor.design.emitter.rays, figures.SHOWN_RAYS)
    view = figures.sensor_view(sensor, angle_deg, shown, sensor.design.trace.mode)
    return canvas.encoded(figures.rays_figure([view]), suffix, "rays")
