"""What `solen print predict` does: from a design and a process to the lens that the printer makes, and what it costs.

The lens is predicted with its uncertainty and held against the wanted one; its profile is written as a measured lens
has one, marked as simulated, so that ``[lens] shape = "measured"`` traces it; the response of both is compared, and a
drawing that prints as wanted is written on demand.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from solen import fabricate, files
from solen.arrays import FloatArray, Progress
from solen.errors import DataError, OutputError, SpecError
from solen.fabricate import MESH_WRITERS as MESHES
from solen.fabricate import process as printing
from solen.fabricate.process import Calibration, Compensation, Deviation, Orientation, Prediction, Process, Target
from solen.lens.measured import MeasuredProfile, profile_of, profile_text
from solen.material.resin import resin_of
from solen.parts import printer_of
from solen.pipeline.design.commands import open_design
from solen.pipeline.outputs import check_choice, check_figure, check_out
from solen.pipeline.print import redrawn
from solen.pipeline.print import response as printedresponse
from solen.recording import Provenance
from solen.sensor import Sensor
from solen.spec import Design

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PROFILE_POINTS = 401
NUMERICAL_UM = 0.1
"""What the model's own numbers may be off by from point to point."""
_MOST = (2.5, 97.5)
_TAPER_TOLD_UM = 2.0
_WELL_KNOWN_UM = 3.0


@dataclass(frozen=True)
class Print:
    """How a design is printed, as it was said.

    Attributes
    ----------
    process
        Process file; None for the default.
    printer
        Printer of the library or a file, whose pixels are taken in place of the process's.
    orientation
        How the part lies.
    at
        Of a flat part: ``middle`` of the thickness, ``mean`` over it, or a height above the platform in mm.
    """

    process: Path | None = None
    printer: str | None = None
    orientation: str = "flat"
    at: str = "middle"


@dataclass(frozen=True)
class Outputs:
    """Files that are asked for: the printed lens's profile, the drawing that prints as wanted, a figure, the solid."""

    out: Path | None = None
    compensate: Path | None = None
    figure: Path | None = None
    solid: Path | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """Everything that is known of one print, for its report."""

    sensor: Sensor
    process: Process
    orientation: Orientation
    height_um: float | None
    found: Prediction
    made: Compensation | None
    sources: list[dict[str, Any]]

    @property
    def design(self) -> Design:
        """The design."""
        return self.sensor.design

    @property
    def layers(self) -> int:
        """Number of layers of a part that lies flat."""
        return max(1, round(1e3 * self.design.body.thickness_mm / self.process.process.layer_um))


def printed(
    path: Path,
    how: Print,
    outputs: Outputs,
    assignments: Sequence[str] = (),
    *,
    response: bool = True,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Predict the printed lens of a design.

    Parameters
    ----------
    path
        The design file.
    how
        The process and the orientation.
    outputs
        Files to write; all are made before any is written.
    assignments
        ``key=value`` of the design.
    response
        Whether the sensor's response is traced with both lenses.
    progress
        Called with the share done, up to 1.

    Raises
    ------
    SolenError
        Where the design, the process or the files cannot be; nothing is written then.
    """
    orientation = _orientation(how)
    _check_outputs(outputs, orientation)
    process, sources = process_of(how)
    sensor = Sensor.of(open_design(path, assignments))
    process = with_resin(process, sensor.design)
    case = _case(sensor, process, sources, how, orientation, outputs.compensate is not None, progress)
    profile = profile_of_print(case, case.found.deviation)
    told = _told(case)
    reprinted = None if case.made is None else profile_of_print(case, case.made.printed)
    if response:
        told["response"], why = printedresponse.response(sensor, profile, progress)
        told["warnings"] += why
        if reprinted is not None:
            told["compensation"]["response"], _ = printedresponse.response(sensor, reprinted)
    told["sources"] = sources
    contents: dict[Path, files.Content] = {}
    if outputs.out is not None:
        contents[outputs.out] = profile_text(profile).encode()
    if outputs.compensate is not None and case.made is not None and reprinted is not None:
        contents |= redrawn.contents(outputs.compensate, sensor, case.made, process.name, reprinted)
    if outputs.figure is not None:
        from solen.report import canvas

        contents[outputs.figure] = canvas.encoded(_drawn(case, told), outputs.figure.suffix.lower(), "printed")
    if outputs.solid is not None:
        contents[outputs.solid], told["solid_mm3"] = _solid(case, outputs.solid)
    files.write_all(contents)
    named = {
        "out": outputs.out,
        "compensated": outputs.compensate,
        "figure": outputs.figure,
        "solid": outputs.solid,
    }
    return told | {"design": str(path)} | {key: str(file) for key, file in named.items() if file is not None}


def process_of(how: Print) -> tuple[Process, list[dict[str, Any]]]:
    """Process that was named, with the pixels of a named printer, and the provenance of its file."""
    if how.process is None:
        return with_printer(printing.default_process(), how.printer), []
    process = printing.read_process(how.process)
    simulated = process.calibration is not None and process.calibration.simulated
    digest = hashlib.sha256(how.process.read_bytes()).hexdigest()
    process = with_printer(process, how.printer)
    return process, [Provenance(how.process.name, digest, "solen-process", simulated=simulated).as_dict()]


def with_printer(process: Process, name: str | None) -> Process:
    """Process with the pixels of a printer, by its name in the library or its file; as it is without one.

    Raises
    ------
    DataError
        Where there is no such printer, it does not print layers as thin or thick, or the process was calibrated with
        other pixels.
    """
    if name is None:
        return process
    printer = printer_of(name)
    pitch_um, layer_um = printer.pitch_um.usual, process.process.layer_um
    least, most = printer.layers_um
    if not least <= layer_um <= most:
        limit = f"{printer.name} prints layers of {least:g} to {most:g} µm"
        raise DataError("process.layer_um", value=layer_um, limit=limit, remedy="change one of the two")
    if process.calibration is not None and abs(pitch_um - process.process.pixel_um) > 1e-6 * pitch_um:
        limit = f"the process was calibrated with pixels of {process.process.pixel_um:g} µm"
        remedy = "leave --printer out, or calibrate that printer"
        raise DataError("--printer", value=f"{printer.name}, {pitch_um:g} µm", limit=limit, remedy=remedy)
    found = process.with_settings(pixel_um=pitch_um)
    source = f"{printer.pitch_um.basis}: {printer.name}"
    return found.model_copy(update={"source": found.source | {"pixel_um": source}})


def with_resin(process: Process, design: Design) -> Process:
    """Process with the working curve of the design's resin, where it has one and the process only assumes its own."""
    resin = None if design.material.resin is None else resin_of(design.material.resin, design.resin_file)
    if resin is None or resin.cure is None or process.calibration is not None:
        return process
    if not {"Dp_um", "Ec_mJ_per_cm2"} <= set(process.assumptions):
        return process
    cure = resin.cure
    found = process.with_settings(Dp_um=cure.Dp_um, Ec_mJ_per_cm2=cure.Ec_mJ_per_cm2)
    told: dict[str, Any] = {"source": found.source | dict.fromkeys(("Dp_um", "Ec_mJ_per_cm2"), f"resin: {resin.name}")}
    if cure.covariance is not None:
        simulated = any(one.simulated for one in resin.sources if one.of == "cure")
        told["calibration"] = Calibration(
            keys=("Dp_um", "Ec_mJ_per_cm2"), covariance=cure.covariance, simulated=simulated
        )
    return found.model_copy(update=told)


def profile_of_print(case: Case, deviation: Deviation) -> MeasuredProfile:
    """Profile of a printed lens; it is simulated, and says so.

    Its ``u_mm`` is what may differ from point to point. What the process leaves open moves all points together and is
    told as a sentence: taken for noise of single points it would have the profile smoothed away.
    """
    points = deviation.points_mm
    chosen = np.unique(np.linspace(0, len(points) - 1, PROFILE_POINTS).round().astype(int))
    x, z = _forwards(points[chosen]).T
    common = float(np.sqrt(np.mean(case.found.u_um**2)))
    told = (
        f"predicted by a print model ({case.process.name}), not measured",
        f"what the process's numbers leave open, {common:.2g} µm root mean square along the lens, moves its points "
        "together and is not in u_mm",
    )
    made = profile_of(
        x,
        z,
        1e-3 * NUMERICAL_UM,
        name=f"{case.design.name}, printed by the model",
        simulated=True,
        edge="predicted",
        sources=tuple(case.sources),
    )
    return replace(made, warnings=told)


def _forwards(points: FloatArray) -> FloatArray:
    """Points (N, 2) of which each lies farther right than all before it."""
    highest = np.concatenate([[-np.inf], np.maximum.accumulate(points[:-1, 0])])
    return points[points[:, 0] > highest + 1e-9]


def _case(
    sensor: Sensor,
    process: Process,
    sources: list[dict[str, Any]],
    how: Print,
    orientation: Orientation,
    compensate: bool,
    progress: Progress | None,
) -> Case:
    body, thickness_mm, settings = sensor.body(), sensor.design.body.thickness_mm, process.process
    height_um = _height_um(how, thickness_mm, settings.layer_um)
    target = Target.of(printing.lens_face(body).curve, printing.points_for(orientation))
    rings = printing.rings_of(printing.as_designed(body))
    half = None if progress is None else lambda done: progress(0.5 * done)
    found = printing.predicted(rings, target, process, thickness_mm, orientation, height_um, half)
    made = printing.compensated(body, target, settings, thickness_mm, height_um) if compensate else None
    return Case(sensor, process, orientation, height_um, found, made, sources)


def _solid(case: Case, target: Path) -> tuple[bytes, dict[str, float | int]]:
    """File of the whole part as it is printed flat, and its volume beside the designed one's."""
    design, body = case.design, case.sensor.body()
    rings = printing.rings_of(printing.as_designed(body))
    lens = Target.of(printing.lens_face(body).curve, printing.points_for("flat"))
    mesh, slabs = printing.printed_solid(
        rings, case.process.process, design.body.thickness_mm, lens.centre, design.name
    )
    label = fabricate.label_of(design, f"simulated: as printed by the model, {case.process.name}")
    label = replace(label, name=f"simulated print of {label.name}")  # all that an STL has room for
    designed = fabricate.area_mm2(body.outlines) * design.body.thickness_mm
    told = {"printed": mesh.volume_mm3, "designed": designed, "triangles": len(mesh.triangles), "slabs": len(slabs)}
    return MESHES[target.suffix.lower()[1:]](mesh, label), told


def _orientation(how: Print) -> Orientation:
    check_choice("--orientation", how.orientation, printing.ORIENTATIONS)
    found = next(one for one in printing.ORIENTATIONS if one == how.orientation)
    if found != "flat" and how.at != "middle":
        raise SpecError("--at", value=how.at, limit="is of a part printed flat", remedy="leave it out")
    return found


def _check_outputs(outputs: Outputs, orientation: Orientation) -> None:
    check_figure(outputs.figure)
    check_out(outputs.out)
    _check_solid(outputs.solid, orientation)
    if outputs.compensate is None:
        return
    if orientation != "flat":
        limit = "--compensate is of a part printed flat: steps of layers cannot be drawn away"
        raise SpecError("--orientation", value=orientation, limit=limit, remedy="print it flat, or in thinner layers")
    if outputs.compensate.suffix.lower() != ".toml":
        raise OutputError(str(outputs.compensate), limit="a design ends in .toml", remedy="rename it")


def _check_solid(solid: Path | None, orientation: Orientation) -> None:
    if solid is None:
        return
    if orientation != "flat":
        raise SpecError(
            "--orientation", value=orientation, limit="--solid is of a part printed flat", remedy="leave it out"
        )
    if solid.suffix.lower()[1:] not in MESHES:
        kinds = ", ".join(f".{kind}" for kind in MESHES)
        raise OutputError(str(solid), limit=f"a solid ends in {kinds}", remedy="rename it")


def _height_um(how: Print, thickness_mm: float, layer_um: float) -> float | None:
    """Height whose profile is meant; None for the mean."""
    thickness_um = max(1, round(1e3 * thickness_mm / layer_um)) * layer_um
    if how.at in ("mean", "middle"):
        return None if how.at == "mean" else 0.5 * thickness_um
    try:
        height_um = 1e3 * float(how.at)
    except ValueError:
        height_um = -1.0
    if not 0.0 <= height_um <= thickness_um:
        limit = f"must be middle, mean, or a height in mm from 0 to {1e-3 * thickness_um:g}"
        raise SpecError("--at", value=how.at, limit=limit)
    return height_um


def _told(case: Case) -> dict[str, Any]:
    settings, found = case.process.process, case.found
    shift, shape = found.deviation.shifted
    return {
        "name": case.design.name,
        "simulated": True,
        "orientation": case.orientation,
        "process": case.process.name,
        "settings": settings.model_dump(),
        "cure_depth_um": settings.cure_depth_um,
        "inside_mJ_per_cm2": settings.inside_mJ_per_cm2(),
        "profile_at": _at(case),
        "deviation_um": _deviation(found.deviation) | {"u": _rms(found.u_um), "u_max": float(found.u_um.max())},
        "shape_um": {"shift_z": shift, "rms": shape.rms_um, "max": shape.largest[0]},
        "ripple_um": _ripple(case),
        "walls_um": _walls(case),
        "contributions_um": found.contributions_um,
        "compensation": None if case.made is None else _compensation(case.made, found.deviation),
        "response": None,
        "warnings": [*case.process.warnings(), *_of_orientation(case), *_of_compensation(case)],
    }


def _at(case: Case) -> str:
    if case.orientation != "flat":
        return "the whole thickness: nothing changes along it"
    if case.height_um is None:
        return "mean over the thickness"
    return f"{1e-3 * case.height_um:g} mm above the platform, mean over its layer"


def _ripple(case: Case) -> dict[str, Any]:
    if case.orientation == "flat":
        return {"along": "thickness", "peak_to_valley": case.found.ripple_through_um, "rms": None}
    low, high = np.percentile(case.found.ripple_um, _MOST)
    return {"along": "profile", "peak_to_valley": float(high - low), "rms": _rms(case.found.ripple_um)}


def _walls(case: Case) -> dict[str, Any] | None:
    if case.orientation != "flat":
        return None
    _, walls = printing.walls_um(case.process.process, case.layers)
    places = {"first": 0, "middle": case.layers // 2, "last": -1}
    return {"layers": case.layers, **{name: float(walls[place]) for name, place in places.items()}}


def _of_orientation(case: Case) -> list[str]:
    """What the chosen orientation means for who believes the numbers."""
    walls, ripple = _walls(case), _ripple(case)
    if walls is None:
        return [
            f"the steps of the layers, {ripple['rms']:.2g} µm root mean square along the profile, scatter light; the "
            "traced profile is without them"
        ]
    if max(walls["first"], walls["middle"], walls["last"]) - min(walls["first"], walls["last"]) < _TAPER_TOLD_UM:
        return []
    return [
        f"walls stand {walls['first']:+.3g} µm beyond their image at the first layer, {walls['middle']:+.3g} in the "
        f"middle and {walls['last']:+.3g} at the last: light at another height meets another lens"
    ]


def _of_compensation(case: Case) -> list[str]:
    """What a drawing against the print is worth: no more than the process is known."""
    u = _rms(case.found.u_um)
    if case.made is None or u < max(2.0 * case.made.printed.rms_um, _WELL_KNOWN_UM):
        return []
    return [
        f"compensated, the lens is {case.made.printed.rms_um:.2g} µm off in the model, which knows it to {u:.2g} µm: "
        "calibrate the process with coupons of your printer before you trust the drawing"
    ]


def _deviation(deviation: Deviation) -> dict[str, Any]:
    worst, place = deviation.largest
    return {"rms": deviation.rms_um, "mean": deviation.mean_um, "max": worst, "max_at_mm": list(place)}


def _compensation(made: Compensation, before: Deviation) -> dict[str, Any]:
    return {
        "label": redrawn.LABEL,
        "before_um": _deviation(before),
        "after_um": _deviation(made.printed),
        "rounds_rms_um": list(made.rounds_um),
        "lens_drawn_um": [float(made.drawn_um.min()), float(made.drawn_um.max())],
        "walls_drawn_um": made.wall_um,
        "scale": made.scale,
        "response": None,
    }


def _drawn(case: Case, told: dict[str, Any]) -> "Figure":
    from solen.report.print.predict import printed_figure

    walls = printing.walls_um(case.process.process, case.layers) if case.orientation == "flat" else None
    return printed_figure(case.found, case.made, walls, told)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
