"""What `solen print layers` and `solen export --layers` do: a part as layers for a printer, with the sheet for its program.

Pictures are written as they are made, into an archive under a temporary name; sheet, STL and figure follow, and all of
them get their names together or not at all.
"""

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from solen import fabricate, files
from solen.arrays import Progress
from solen.errors import DataError, OutputError, SpecError
from solen.fabricate import Label, Mesh, Part
from solen.fabricate.layers import (
    Exposure,
    Job,
    Layer,
    Solid,
    Summary,
    as_sheet,
    mesh_solid,
    orientation,
    settings,
    solid_of,
    write_archive,
)
from solen.fabricate.layers.orientation import IN_WORDS
from solen.fabricate.stl import read_stl
from solen.fabricate.threemf import read_threemf
from solen.material.resin import Cure, resin_of
from solen.parts import Printer, library_printer, printer_of, printers
from solen.pipeline.design.commands import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.outputs import check_figure
from solen.pipeline.print.slicing import Slicing
from solen.sensor import Sensor
from solen.spec import Design

PAPER_MW_PER_CM2 = 13.0
SMALLEST_MM, LARGEST_MM = 0.5, 1000.0
"""A part beyond these was drawn in another unit."""
NARROW = 0.1
"""A part that stands on less than this share of its largest layer needs something to stand on."""
HEIGHT_UM = 1.0
"""What the stack's height may be off before it is told."""
APART_NM = 10.0
"""How far a working curve's wavelength may be from the printer's."""

READERS: dict[str, Callable[[Path], Mesh]] = {".stl": read_stl, ".3mf": read_threemf}


@dataclass(frozen=True)
class Made:
    """What is cut: the solid as it is printed, its STL, its label, and what the sheet says of it."""

    solid: Solid
    stl: bytes
    label: Label
    source: dict[str, str]
    material: str
    cure: Cure | None
    warnings: tuple[str, ...]


@dataclass
class Run:
    """A job with its files: `contents` to be written in order, then `found` is what is told."""

    job: Job
    made: Made
    how: Slicing
    targets: dict[str, Path]
    progress: Progress
    figure: Path | None = None
    summary: Summary | None = None
    shown: list[Layer] = field(default_factory=list)

    def contents(self) -> dict[Path, files.Content]:
        """What each file holds; the archive comes first, since the others tell what was found on its way."""
        found: dict[Path, files.Content] = {}
        if "layers" in self.targets:
            found[self.targets["layers"]] = self._archive
        found[self.targets["stl"]] = self.made.stl
        found[self.targets["sheet"]] = lambda path: path.write_bytes(self._sheet())
        found[self.targets["settings"]] = lambda path: path.write_bytes(self._settings())
        if self.figure is not None:
            found[self.figure] = lambda path: path.write_bytes(self._drawn())
        return found

    def found(self) -> dict[str, Any]:
        """Result for JSON."""
        job, summary = self.job, self.summary
        stack = None if summary is None else summary.volume_mm3
        return {
            "name": self.made.label.name,
            "printer": job.printer.name,
            "pitch_um": job.printer.pitch_um.usual,
            "pixels": {"columns": job.printer.shape[1], "rows": job.printer.shape[0]},
            "layer_um": job.layer_um,
            "layers": job.count,
            "size_mm": list(job.solid.size_mm),
            "height_mm": job.height_mm,
            "copies": job.copies,
            "places_mm": [list(place) for place in job.places_mm],
            "solid_volume_mm3": job.volume_mm3,
            "stack_volume_mm3": stack,
            "volume_error": None if stack is None else stack / job.volume_mm3 - 1.0,
            "islands": [] if summary is None else [list(one) for one in summary.islands],
            "settings": self.typed(),
            "files": {kind: str(path) for kind, path in self.targets.items()},
            "sources": [self.made.source],
            "warnings": self.warnings(),
        } | ({} if self.figure is None else {"figure": str(self.figure)})

    def typed(self) -> dict[str, Any]:
        """Settings to be typed into the printer's program."""
        words = IN_WORDS[self.how.orientation]
        if any(self.how.rotate_deg):
            words += ", then turned about X, Y, Z by " + ", ".join(f"{angle:g}" for angle in self.how.rotate_deg) + "°"
        return settings(
            self.job,
            name=self.made.label.name,
            stl=self.targets["stl"].name,
            material=self.made.material,
            orientation=words,
            z_offset_um=self.how.z_offset_um,
            cure=self.made.cure,
        )

    def warnings(self) -> list[str]:
        """What must be known of the print."""
        found = [*self.made.warnings, *_of_printer(self.job.printer), *_of_size(self.job)]
        if self.how.irradiance_mW_per_cm2 is None and self.job.printer.irradiance_mw_per_cm2 is None:
            found.append(f"doses are those of {PAPER_MW_PER_CM2:g} mW/cm², the paper's printer; measure yours")
        found += _of_cure(self.typed(), self.made.cure, self.job.printer)
        return found + ([] if self.summary is None else _of_stack(self.job, self.summary))

    def _archive(self, path: Path) -> None:
        wanted = set(shown_numbers(self.job.count)) if self.figure is not None else set()

        def watch(layer: Layer) -> None:
            if layer.index in wanted:
                self.shown.append(layer)
            self.progress((layer.index + 1) / self.job.count)

        about = {
            "name": self.made.label.name,
            "source": self.made.source,
            "orientation": self.how.orientation,
            "rotate_deg": list(self.how.rotate_deg),
            "burn_in_layers": self.how.burn_in_layers,
            "z_offset_mm": self.how.z_offset_um / 1000.0,
        }
        self.summary = write_archive(path, self.job, about, watch)

    def _sheet(self) -> bytes:
        return as_sheet(self.typed(), self.warnings()).encode()

    def _settings(self) -> bytes:
        text = json.dumps(self.typed() | {"warnings": self.warnings()}, indent=1, allow_nan=False)
        return f"{text}\n".encode()

    def _drawn(self) -> bytes:
        from solen.report import canvas
        from solen.report.print.layers import layers_figure

        assert self.figure is not None  # noqa: S101  for the type
        drawn = layers_figure(self.job, self.shown, self.made.label.name)
        return canvas.encoded(drawn, self.figure.suffix.lower(), "layers")


def layers(
    path: Path,
    out: Path,
    how: Slicing,
    assignments: Sequence[str] = (),
    *,
    figure: Path | None = None,
    progress: Progress = lambda _: None,
) -> dict[str, Any]:
    """Cut a design or a mesh into layers and write them with STL and settings into a folder.

    Parameters
    ----------
    path
        A design file (.toml), or a closed mesh (.stl in mm, .3mf).
    out
        Folder for the files, made if need be; files of the same names are replaced.
    how
        Printer, layers, orientation, exposures.
    assignments
        ``key=value`` of the design.
    figure
        Draw some layers and the stack into this file.
    progress
        Told the share of the layers that is done.

    Raises
    ------
    SolenError
        Where the file or an option is wrong, or the part does not fit; nothing is written then.
    """
    check_figure(figure)
    if figure is not None and how.sheet_only:
        raise SpecError("--figure", limit="draws layers, and --sheet-only makes none", remedy="leave one of them out")
    kind = path.suffix.lower()
    if kind not in (".toml", *READERS):
        raise DataError(str(path), limit="must be a design (.toml) or a mesh (.stl, .3mf)", remedy="export it as STL")
    if kind in READERS and assignments:
        raise SpecError("--set", value=assignments[0], limit="is of a design, and this is a mesh")
    made = _of_mesh(path, how) if kind in READERS else _of_design(path, how, open_design(path, assignments))
    with files.output_folder(out):
        run = prepared(made, how, out, stem_of(path), figure, progress)
        files.write_all(run.contents())
    return {"file": str(path)} | run.found()


def prepared(
    made: Made, how: Slicing, out: Path, stem: str, figure: Path | None = None, progress: Progress = lambda _: None
) -> Run:
    """A checked job and the names of its files."""
    printer = printer_of(how.printer)
    job = Job(made.solid, printer, how.layer_um, _exposure(how, printer), how.copies, how.gap_mm, how.mirror)
    endings = {"layers": "-layers.zip", "stl": "-placed.stl", "sheet": "-settings.md", "settings": "-settings.json"}
    if how.sheet_only:
        del endings["layers"]
    targets = {kind: out / f"{stem}{ending}" for kind, ending in endings.items()}
    if figure is not None and figure.resolve() in {target.resolve() for target in targets.values()}:
        raise OutputError(str(figure), limit="is a file of the layers too", remedy="rename the figure")
    return Run(job, made, how, targets, progress, figure)


def made_of(design: Design, part: Part, label: Label, path: Path, how: Slicing, mesh: Mesh | None = None) -> Made:
    """A design's part, turned as it is printed."""
    rotation = orientation(how.orientation, how.rotate_deg)
    name, cure = _resin(how.resin, design)
    stl = _placed(mesh or fabricate.mesh_of(part, fabricate.layers.solid.MESH_MM), rotation, label)
    source = {"file": path.name, "sha256": label.sha256, "format": "design"}
    return Made(solid_of(part, rotation), stl, label, source, name, cure, ())


def shown_numbers(count: int) -> list[int]:
    """Numbers of the layers that a figure shows: the first, the last and some between."""
    return sorted({round(share * (count - 1)) for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)})


def list_printers() -> dict[str, Any]:
    """The library, a row for each printer."""
    return {"printers": [{"printer": name} | _row(library_printer(name)) for name in printers()]}


def show_printer(text: str) -> dict[str, Any]:
    """A printer with all that its file says."""
    printer = printer_of(text)
    return {"printer": text} | _row(printer) | {"file": printer.model_dump(mode="json", exclude_none=True)}


def _row(printer: Printer) -> dict[str, Any]:
    rows, columns = printer.shape
    least, most = printer.layers_um
    return {
        "name": printer.name,
        "pitch_um": printer.pitch_um.usual,
        "columns": columns,
        "rows": rows,
        "size_mm": [round(length, 9) for length in printer.size_mm],
        "wavelength_nm": None if printer.wavelength_nm is None else printer.wavelength_nm.usual,
        "least_layer_um": least,
        "most_layer_um": most,
        "unconfirmed": list(printer.unconfirmed),
    }


def _of_design(path: Path, how: Slicing, design: Design) -> Made:
    part = fabricate.sensor_part(design, Sensor.of(design).body())
    label = fabricate.label_of(design, f"thickness {design.body.thickness_mm:g} mm, {how.orientation}")
    return made_of(design, part, label, path, how)


def _of_mesh(path: Path, how: Slicing) -> Made:
    mesh = READERS[path.suffix.lower()](path)
    rotation = orientation(how.orientation, how.rotate_deg)
    warnings = []
    if mesh.volume_mm3 < 0.0 and not mesh.open_edges():
        mesh = Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy(), mesh.tolerance_mm)
        warnings.append("the mesh was inside out; its triangles are turned")
    solid = mesh_solid(mesh, rotation, str(path))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    label = Label(path.stem, digest, how.orientation)
    name, cure = _resin(how.resin, None)
    source = {"file": path.name, "sha256": digest, "format": path.suffix.lower()[1:]}
    return Made(solid, _placed(mesh, rotation, label), label, source, name, cure, tuple(warnings))


def _placed(mesh: Mesh, rotation: Any, label: Label) -> bytes:
    """STL of a mesh as it is printed: turned, its lowest corner at the origin."""
    turned = mesh.vertices @ rotation.T
    return fabricate.as_stl(Mesh(turned - turned.min(axis=0), mesh.triangles, mesh.tolerance_mm), label)


def _resin(name: str | None, design: Design | None) -> tuple[str, Cure | None]:
    """The material in words, and its working curve where it has one."""
    path = None
    if name is None and design is not None:
        name, path = design.material.resin, design.files.get("material.resin")
    elif name is not None and (name.endswith(".toml") or "/" in name or "\\" in name):
        path = Path(name)
    if name is None:
        index = "" if design is None else f" (n = {design.material.index:g} in the design)"
        return f"not named{index}: give --resin", None
    resin = resin_of(name, path)
    return resin.name, resin.cure


def _exposure(how: Slicing, printer: Printer) -> Exposure:
    own = printer.irradiance_mw_per_cm2
    irradiance = how.irradiance_mW_per_cm2
    if irradiance is None:
        irradiance = PAPER_MW_PER_CM2 if own is None else own.usual
    if not (math.isfinite(how.z_offset_um) and abs(how.z_offset_um) <= 1e5):
        raise SpecError("--z-offset-um", value=how.z_offset_um, limit="must be within 100 mm")
    return Exposure(how.burn_in_layers, how.burn_in_s, how.exposure_s, irradiance)


def _of_printer(printer: Printer) -> list[str]:
    if not printer.unconfirmed:
        return []
    *others, last = printer.unconfirmed
    numbers = f"{', '.join(others)} and {last}" if others else last
    return [f"{numbers} of {printer.name} are estimates: compare them with the printer's own before using the pictures"]


def _of_size(job: Job) -> list[str]:
    size, found = job.solid.size_mm, []
    if max(size) < SMALLEST_MM or max(size) > LARGEST_MM:
        found.append(f"the part is {max(size):.3g} mm long: is that its unit? An STL has none and is read as mm")
    off_um = (job.height_mm - size[2]) * 1000.0
    if abs(off_um) > HEIGHT_UM:
        way = "higher" if off_um > 0.0 else "lower"
        found.append(f"{job.count} layers of {job.layer_um:g} µm are {abs(off_um):.1f} µm {way} than the part")
    faces = [height for height in job.solid.heights_mm if 0.0 < height < size[2] - 1e-4]
    moves_um = [abs(math.ceil(height / job.layer_mm - 0.5) * job.layer_mm - height) * 1000.0 for height in faces]
    between = [height for height, move_um in zip(faces, moves_um, strict=True) if move_um > HEIGHT_UM]
    if between:
        first = f"the first at {between[0]:.4g} mm"
        found.append(
            f"{len(between)} level faces lie within a layer ({first}) and move by up to {max(moves_um):.1f} µm"
        )
    return found


def _of_cure(typed: dict[str, Any], cure: Cure | None, printer: Printer) -> list[str]:
    if cure is None:
        return []
    found = []
    if typed["cure_depth_um"] <= typed["layer_um"]:
        depth = f"{typed['cure_depth_um']:.0f} µm, a layer is {typed['layer_um']:g} µm"
        found.append(f"one exposure cures {depth}: layers would not hold together")
    light = printer.wavelength_nm
    if light is not None and cure.wavelength_nm is not None and abs(light.usual - cure.wavelength_nm) > APART_NM:
        apart = f"{cure.wavelength_nm:g} nm, the printer has {light.usual:g} nm"
        found.append(f"the working curve was measured at {apart}: its depths do not hold")
    return found


def _of_stack(job: Job, summary: Summary) -> list[str]:
    found = []
    if summary.islands:
        index, pieces = summary.islands[0]
        where = f"{pieces} at layer {index + 1}, {index * job.layer_mm:.4g} mm"
        total = sum(count for _, count in summary.islands)
        found.append(f"{total} pieces begin in the air (first {where}): they need supports, which solen does not make")
    if summary.first_mm2 < NARROW * summary.largest_mm2:
        first, largest = (area / job.copies for area in (summary.first_mm2, summary.largest_mm2))
        areas = f"{first:.3g} mm² where its largest layer has {largest:.3g} mm²"
        found.append(f"the part stands on {areas}: give it a base or supports, or turn it")
    return found
