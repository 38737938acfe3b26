"""Export of a design's body: the file formats and a summary.

An `Export` contains what the formats need; its mesh is made on demand. To add a format, add it to `FORMATS`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from solen.errors import SolenError
from solen.fabricate.comsol import as_comsol
from solen.fabricate.dxf import as_dxf, check_writer
from solen.fabricate.label import Label, label_of
from solen.fabricate.layers import LayeredPrint
from solen.fabricate.mesh import Mesh, mesh_of
from solen.fabricate.meshfiles import MESH_WRITERS
from solen.fabricate.numbers import NumberedPart, numbered
from solen.fabricate.part import Part
from solen.fabricate.seats import sensor_part
from solen.fabricate.step import as_step, check_kernel
from solen.fabricate.svg import as_svg
from solen.files import Content
from solen.geometry import Body
from solen.geometry.measures import area_mm2
from solen.ranks import Caution, note, warning
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design


@dataclass(frozen=True, eq=False)
class Export:
    """The body of a design for export: the printed part, the label and the mesh tolerance."""

    design: Design
    body: Body
    tolerance_mm: float = 1e-3

    @cached_property
    def part(self) -> Part:
        """Printed part: the body extruded to its thickness, with its seats."""
        return sensor_part(self.design, self.body)

    @property
    def outline(self) -> Body:
        """Body with a single outline for all heights; `DesignError` if the outline varies with height."""
        remedy = 'export --step or a mesh, or set lens.shape = "cartesian-oval" to draw the middle section'
        return self.body.prism(remedy)

    @cached_property
    def numbers(self) -> tuple[NumberedPart, ...]:
        """Parts of a network, numbered as in drawings."""
        return numbered(self.design, self.body)

    @cached_property
    def mesh(self) -> Mesh:
        """Triangle mesh of the part."""
        return mesh_of(self.part, self.tolerance_mm)

    @cached_property
    def label(self) -> Label:
        """Label of the files."""
        seats = ", ".join(cut.name for cut in self.part.cuts)
        about = f"thickness {self.design.body.thickness_mm:g} mm" + (f", with {seats}" if seats else "")
        return label_of(self.design, about)


@dataclass(frozen=True)
class Format:
    """A file format: file extension, writer and required packages."""

    ending: str
    write: Callable[[Export], bytes]
    needs: Callable[[], None] = lambda: None
    flat: bool = False
    """Whether the format contains only outlines, without height."""


def _of_mesh(kind: str) -> Format:
    return Format(f".{kind}", lambda export: MESH_WRITERS[kind](export.mesh, export.label))


FORMATS: dict[str, Format] = {
    "step": Format(".step", lambda export: as_step(export.part, export.label), check_kernel),
    **{kind: _of_mesh(kind) for kind in MESH_WRITERS},
    "dxf": Format(".dxf", lambda export: as_dxf(export.outline, export.label, export.numbers), check_writer, flat=True),
    "comsol": Format("-comsol.txt", lambda export: as_comsol(export.outline, export.label), flat=True),
    "svg": Format(".svg", lambda export: as_svg(export.outline, export.label, export.numbers), flat=True),
}
DEFAULT_FORMATS = ("stl", "3mf")
"""Default formats, which slicers read."""


@dataclass(frozen=True)
class SolidFiles:
    """Solid files keyed by name; empty, with the reason, if the design has no solid."""

    contents: dict[str, Content]
    refused: str = ""


def solid_files(design: Design, stem: str) -> SolidFiles:
    """Return the solid files of a design in the default formats; their names begin with ``stem``."""
    try:
        export = Export(design, Sensor.of(design).body())
        return SolidFiles({f"{stem}{FORMATS[kind].ending}": FORMATS[kind].write(export) for kind in DEFAULT_FORMATS})
    except SolenError as error:
        return SolidFiles({}, str(error))


@dataclass(frozen=True)
class Seat:
    """A pocket or slot and the volume that it removes."""

    name: str
    volume_mm3: float


@dataclass(frozen=True)
class MeshSize:
    """Number of triangles, extent and volume of a mesh, and an upper bound for its volume error."""

    tolerance_mm: float
    size_mm: tuple[float, float, float]
    triangles: int
    volume_mm3: float
    volume_bound_mm3: float

    @classmethod
    def of(cls, mesh: Mesh, part: Part) -> "MeshSize":
        """Return the size of the mesh of a part."""
        bound = part.wall_mm2 * mesh.tolerance_mm
        return cls(mesh.tolerance_mm, mesh.size_mm, len(mesh.triangles), mesh.volume_mm3, bound)


class ExportedSolid(Result):
    """Summary of an export.

    Attributes
    ----------
    export
        The exported solid; omitted from JSON.
    name, sha256
        Name and checksum of the design.
    thickness_mm, area_mm2, volume_mm3
        Thickness of the part, area of its middle section, and volume of the exact solid.
    pieces, faces
        Number of separate parts, and names of the faces.
    seats
        Pockets and slots.
    mesh
        Mesh size; None if no format needs a mesh.
    layers
        Printer layers; None if they were not requested.
    warnings
        Design properties that the files do not contain.
    """

    export: Export = field(metadata=HIDDEN)
    name: str
    sha256: str
    thickness_mm: float
    area_mm2: float
    volume_mm3: float
    pieces: int
    faces: tuple[str, ...]
    seats: tuple[Seat, ...]
    mesh: MeshSize | None
    layers: LayeredPrint | None
    warnings: tuple[Caution, ...]


def exported_solid(export: Export, formats: Sequence[str], layers: LayeredPrint | None = None) -> ExportedSolid:
    """Summarise an export in the given formats, optionally with printer layers."""
    part = export.part
    has_mesh = "mesh" in vars(export)
    return ExportedSolid(
        export=export,
        name=export.design.name,
        sha256=export.label.sha256,
        thickness_mm=export.design.body.thickness_mm,
        area_mm2=area_mm2(export.body.outlines),
        volume_mm3=part.volume_mm3,
        pieces=_pieces(export.body),
        faces=tuple(face.name for face in export.body.all_faces),
        seats=tuple(Seat(cut.name, cut.volume_mm3) for cut in part.cuts),
        mesh=MeshSize.of(export.mesh, part) if has_mesh else None,
        layers=layers,
        warnings=(*_warnings(export, formats), *(layers.warnings if layers else ())),
    )


def _pieces(body: Body) -> int:
    """Return the number of outlines that are not holes."""
    return sum(area_mm2([outline]) > 0.0 for outline in body.outlines)


def _warnings(export: Export, formats: Sequence[str]) -> list[Caution]:
    warnings = []
    if export.design.lens.shape == "measured":
        warnings.append(
            warning(
                "the lens has its measured shape; "
                f'to export the lens as designed, set lens.shape = "{export.design.lens.designed_shape}"'
            )
        )
    if (pieces := _pieces(export.body)) > 1:
        warnings.append(warning(f"the outlines form {pieces} separate parts"))
    if export.body.separate:
        names = ", ".join(face.name for face in export.body.separate)
        warnings.append(
            note(f"{names}: separate objects in air are contained in the DXF and SVG drawings, but not in the solid")
        )
    if export.part.cuts:
        warnings.append(warning("the ray trace ignores pockets and slots"))
        flat = [kind for kind in formats if FORMATS[kind].flat]
        if flat:
            warnings.append(note(f"the solid contains pockets and slots, but the drawings ({', '.join(flat)}) do not"))
    return warnings
