"""The numbers of a study as plain data: what `results.json` and `results.csv` hold.

A value that does not exist is null, never NaN. Powers are fractions of the emitted power.
"""

import csv
import dataclasses
import io
import json
import math
import tomllib
from collections.abc import Sequence
from typing import Any

import solen
from solen.geometry import arm_angle_deg
from solen.lens import Lens, MeasuredLens, OvalLens
from solen.material import Optical
from solen.report.design.as_printed import measured_numbers, printed_numbers
from solen.report.plain import number
from solen.sensor import Case, InSpace, NullShift, OffIndex, Practice, Response, Sensor, Shift, Study
from solen.sensor.off_index import steps
from solen.spec import dumps
from solen.trace import Detected, Path, Trace

SCHEMA = 1


def results(study: Study) -> dict[str, Any]:
    """Everything a study found, ready for JSON."""
    return {
        "schema": SCHEMA,
        "solen": solen.__version__,
        "simulated": True,
        "name": study.design.name,
        "design": {key: value for key, value in tomllib.loads(dumps(study.design)).items() if key != "schema"},
        "material": material_numbers(study.case.sensor),
        "lens": lens_numbers(study.case.sensor.cut, study.case.sensor.material),
        "body": body_numbers(study.case.sensor),
        "no_lens_refused": study.flat_refused,
        "summary": {name: summary(case) for name, case in study.cases.items()},
        "response": {name: _case(case) for name, case in study.cases.items()},
        "practice": None if study.practice is None else practice_numbers(study.practice),
        "as_printed": None if study.printed is None else printed_numbers(study.printed),
    }


def material_numbers(sensor: Sensor) -> dict[str, Any]:
    """Index and absorption at the emitter's wavelength, and where they come from."""
    material = sensor.material
    return {
        "wavelength_nm": sensor.light.wavelength_nm,
        "index": material.index,
        "u_index": material.u_index,
        "mode": material.mode or None,
        "absorption_per_mm": material.absorption_per_mm,
        "u_absorption_per_mm": material.u_absorption_per_mm,
        "source": material.source,
        "warnings": list(material.warnings),
    }


def lens_numbers(lens: Lens | None, material: Optical) -> dict[str, Any]:
    """What a lens is and does in a material; of a drawn one, None, only that."""
    if lens is None:
        return {"shape": "drawn"}
    common = {
        "distance_mm": lens.distance_mm,
        "half_width_mm": lens.half_width_mm,
        "depth_mm": lens.depth_mm,
        "acceptance_deg": lens.acceptance_deg,
    }
    if isinstance(lens, MeasuredLens):
        return {"shape": "measured", **common, **measured_numbers(lens, material.index)}
    if not isinstance(lens, OvalLens):
        return {"shape": "none", **common}
    return {
        "shape": "cartesian-oval",
        **common,
        "design_index": lens.design_index,
        "material_index": material.index,
        "focus_mm": lens.focus_mm,
        "vertex_radius_mm": lens.vertex_radius_mm,
        "edge_slope": float(lens.slope(lens.half_width_mm)),
        "edge_curvature_per_mm": float(lens.curvature_per_mm(lens.half_width_mm)),
        "edge_incidence_deg": lens.edge_incidence_deg(),
        "tangency_half_width_mm": lens.tangency_half_width_mm,
        "na_object": lens.na_object,
        "na_image": lens.na_image,
        "magnification": lens.magnification,
        **foci(lens, material.index),
        "focus_by_index": [
            {"step": step, "index": material.index + step, "is_u_index": stated, **foci(lens, material.index + step)}
            for step, stated in steps(material)
        ],
    }


def foci(lens: OvalLens, index: float) -> dict[str, float | None]:
    """Where a lens focuses in a material of ``index``: rays near the axis, all at best, and those at the edge."""
    return {
        "paraxial_focus_mm": lens.paraxial_focus_mm(index),
        "best_focus_mm": lens.best_focus_mm(index),
        "marginal_focus_mm": lens.marginal_focus_mm(index),
    }


def body_numbers(sensor: Sensor) -> dict[str, Any]:
    """What follows from the body's dimensions, at rest."""
    body = sensor.body()
    if sensor.is_drawn:
        faces = (*body.all_faces, *body.apart)
        return {
            "file": sensor.design.body.file,
            "outlines": len(body.outlines),
            "area_mm2": body.area_mm2(),
            "emitter_x_mm": body.emitter.point[0],
            "emitter_z_mm": body.emitter.point[1],
            "emitter_axis_deg": body.emitter.axis_deg,
            "receivers": ", ".join(dict.fromkeys(face.whose for face in faces if face.part == "receiver")),
            "faces": [face.name for face in faces],
        }
    right, left = body.marks["fork-right"], body.marks["fork-left"]
    return {
        "arm_angle_deg": arm_angle_deg(sensor.design),
        "arm_angle_assumed": sensor.design.body.arm_angle_deg is None,
        "fork_width_mm": right[0] - left[0],
        "stem_base_z_mm": body.marks["stem-base"][1],
        "crotch_z_mm": body.marks["crotch"][1],
        "area_mm2": body.area_mm2(),
        "faces": [face.name for face in body.faces],
    }


def summary(case: Case) -> dict[str, Any]:
    """The few numbers one asks for first, from the integrated power."""
    power = case.power
    worst = max(range(len(power.traces)), key=lambda i: abs(power.traces[i].ledger.total - 1.0))
    return {
        "from_deg": float(power.angle_deg[0]),
        "to_deg": float(power.angle_deg[-1]),
        "contrast_from": number(power.contrast[0]),
        "contrast_to": number(power.contrast[-1]),
        "null_deg": case.null_deg,
        "slope_per_deg": case.slope_per_deg,
        "saturation_deg": power.saturation_deg(),
        "received_share": received_share(power),
        "u_power": float(power.u.max()),
        "ledger_error": abs(power.traces[worst].ledger.total - 1.0),
        "truncated": max(trace.ledger.truncated for trace in power.traces),
        "undefined_rays": sum(trace.undefined for trace in power.traces),
        "rays_traced": int(power.rays.sum() + case.counted.rays.sum()),
    }


def trace_numbers(result: Trace, in_space: bool = False) -> dict[str, Any]:
    """What a trace says as a whole: how it was done, where the power went, what was cut off."""
    ledger = result.ledger
    of_space = {"missed": result.missed, "leaked": result.leaked} if in_space else {}
    return {
        "mode": result.mode,
        "method": result.method,
        "rays": result.rays,
        "ledger": {
            "detected": ledger.detected,
            "escaped": ledger.escaped,
            "absorbed": ledger.absorbed,
            "truncated": ledger.truncated,
        },
        **of_space,
        "hits": result.hits,
        "undefined": result.undefined,
        "undefined_at_mm": [list(place) for place in result.undefined_at_mm],
        "truncated": result.truncated,
        "truncated_at_mm": [list(place) for place in result.truncated_at_mm],
        "single_error": result.single_error,
        "pieces": result.pieces,
        "reached": result.reached,
        "why": result.why or None,
    }


def detected_numbers(reading: Detected, faces: Sequence[str]) -> dict[str, Any]:
    """Reading of a receiver, with its histograms by face where there are any."""
    found: dict[str, Any] = {
        "power": reading.power,
        "u": number(reading.u_power),
        "rays": reading.rays,
        "optical_path_mm": number(reading.optical_path_mm),
    }
    if len(reading.power_by_source) > 1:
        found["by_source"] = list(reading.power_by_source)
    if reading.power_by_angle.size:
        found["position"] = {face: row.tolist() for face, row in zip(faces, reading.power_by_position, strict=True)}
        found["angle"] = reading.power_by_angle.tolist()
    return found


def way_numbers(way: Path, faces: list[str]) -> dict[str, Any]:
    """Way of a branch, by the names of the faces it met."""
    return {
        "ray": way.ray,
        "branch": way.branch,
        "parent": way.parent,
        "fate": way.fate,
        "power": way.power,
        "faces": [faces[i] for i in way.interfaces],
        "points_mm": way.points_mm.tolist(),
        "exit_direction": None if way.exit_direction is None else list(way.exit_direction),
    }


def csv_table(study: Study) -> str:
    """One row an angle: right, left and contrast of every case, in the order of the header."""
    columns = [(f"{name}_{kind}", response) for name, case in study.cases.items() for kind, response in _pairs(case)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["angle_deg"] + [f"{name}_{what}" for name, _ in columns for what in ("right", "left", "contrast")])
    for i, angle in enumerate(study.case.power.angle_deg):
        row = [repr(float(angle))]
        for _, response in columns:
            values = (response.right[i], response.left[i], response.contrast[i])
            row += ["" if math.isnan(value) else repr(float(value)) for value in values]
        writer.writerow(row)
    return text.getvalue()


def json_text(data: dict[str, Any]) -> str:
    """JSON text of plain data; what JSON cannot hold is an error, never a NaN."""
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def _pairs(case: Case) -> tuple[tuple[str, Response], tuple[str, Response]]:
    return (("count", case.counted), ("power", case.power))


def _case(case: Case) -> dict[str, Any]:
    return {name: _response(response) for name, response in _pairs(case)}


def _response(response: Response) -> dict[str, Any]:
    return {
        "angle_deg": [float(value) for value in response.angle_deg],
        "right": [float(value) for value in response.right],
        "left": [float(value) for value in response.left],
        "contrast": [number(value) for value in response.contrast],
        "u_power": [number(value) for value in response.u],
        "rays": [int(value) for value in response.rays],
        "ledger": [
            {
                "detected": trace.ledger.detected,
                "escaped": trace.ledger.escaped,
                "absorbed": trace.ledger.absorbed,
                "truncated": trace.ledger.truncated,
            }
            for trace in response.traces
        ],
    }


def practice_numbers(found: Practice) -> dict[str, Any]:
    """What the comparison with a design's neighbours found; null is what ``skipped`` gives the reason for."""
    return {
        "emitter": dataclasses.asdict(found.extent),
        "point": None if found.point is None else _response(found.point),
        "chip": None if found.chip is None else _response(found.chip),
        "null_shift": None if found.null is None else _null_shift(found.null),
        "index": None if found.index is None else [_off_index(one) for one in found.index],
        **_shifts(found),
        "budget": None if found.budget is None else dataclasses.asdict(found.budget),
        "in_space": None if found.in_space is None else _in_space(found.in_space),
        "skipped": found.skipped,
    }


def practice_summary(found: Practice) -> dict[str, Any]:
    """The few numbers of it that one asks for first."""
    chip = found.chip
    return {
        "emitter": dataclasses.asdict(found.extent),
        "chip": None if chip is None else _ends(chip),
        "null_shift": None if found.null is None else _null_shift(found.null),
        **_shifts(found),
        "index_step": abs(found.index[0].step) if found.index else None,
        "index_is_u": any(one.known for one in found.index or ()),
        "skipped": found.skipped,
    }


def received_share(response: Response) -> float:
    """Power at both receivers, mean over the angles."""
    return float((response.right + response.left).mean())


def _ends(response: Response) -> dict[str, float | None]:
    return {
        "from_deg": float(response.angle_deg[0]),
        "to_deg": float(response.angle_deg[-1]),
        "contrast_from": number(response.contrast[0]),
        "contrast_to": number(response.contrast[-1]),
        "received_share": received_share(response),
    }


def _null_shift(found: NullShift) -> dict[str, float]:
    return {**dataclasses.asdict(found), "shift_deg": found.shift_deg}


def _off_index(found: OffIndex) -> dict[str, Any]:
    change = found.response.contrast - found.base.contrast
    return {
        "step": found.step,
        "index": found.index,
        "is_u_index": found.known,
        **_response(found.response),
        "change": [number(value) for value in change],
        "shift": _shift(found.shift),
    }


def _shifts(found: Practice) -> dict[str, Any]:
    """How far the index and the chip move the response, and what follows."""
    return {
        "index_shift": _shift(found.index_shift),
        "chip_shift": _shift(found.chip_shift),
        "warnings": list(found.warnings),
    }


def _shift(found: Shift | None) -> dict[str, float] | None:
    return None if found is None else dataclasses.asdict(found)


def _in_space(found: InSpace) -> dict[str, Any]:
    return {
        "emitter": dataclasses.asdict(found.extent),
        "pattern": found.pattern,
        "pattern_replaced": found.replaced,
        "cone_deg": found.cone_deg,
        "thickness_mm": found.thickness_mm,
        "received_plane": received_share(found.plane),
        "received_space": received_share(found.same),
        "plane": _response(found.plane),
        "space": _response(found.space),
    }
