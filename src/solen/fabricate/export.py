"""Export of a design's body: the file formats and the summary of an export.

The idea: an `Export` contains everything that a format may need; its mesh is made on demand. `FORMATS` is the registry:
a new format is one more line.
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
from solen.ranks import Caution, look_at, note
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design


@dataclass(frozen=True, eq=False)
class Export:
    """A design's body for export: the printed part, the label, and the tolerance of meshes."""

    design: Design
    body: Body
    tolerance_mm: float = 1e-3

    @cached_property
    def part(self) -> Part:
        """The printed part: the body extruded to its thickness, with its seats."""
        return sensor_part(self.design, self.body)

    @property
    def outline(self) -> Body:
        """The body with one outline for all heights, for drawings; raises `DesignError` if the outline varies."""
        return self.body.upright('export --step or a mesh, or draw its middle section: lens.shape = "cartesian-oval"')

    @cached_property
    def numbers(self) -> tuple[NumberedPart, ...]:
        """Parts of a network, with their numbers in drawings."""
        return numbered(self.design, self.body)

    @cached_property
    def mesh(self) -> Mesh:
        """The part as triangles."""
        return mesh_of(self.part, self.tolerance_mm)

    @cached_property
    def label(self) -> Label:
        """The label of the files."""
        seats = ", ".join(cut.name for cut in self.part.cuts)
        about = f"thickness {self.design.body.thickness_mm:g} mm" + (f", with {seats}" if seats else "")
        return label_of(self.design, about)


@dataclass(frozen=True)
class Format:
    """A file format: the extension of its files, their writer and the required packages."""

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
USUAL = ("stl", "3mf")
"""Default formats, for slicing programs."""


@dataclass(frozen=True)
class SolidFiles:
    """Contents of a solid's files by name; empty, with the reason, if the design has no solid."""

    contents: dict[str, Content]
    refused: str = ""


def solid_files(design: Design, stem: str) -> SolidFiles:
    """Files of a design's solid in the default formats for slicing programs, with names that begin with a stem."""
    try:
        made = Export(design, Sensor.of(design).body())
        return SolidFiles({f"{stem}{FORMATS[kind].ending}": FORMATS[kind].write(made) for kind in USUAL})
    except SolenError as bad:
        return SolidFiles({}, str(bad))


@dataclass(frozen=True)
class Seat:
    """A pocket or slot and the volume that it removes."""

    name: str
    volume_mm3: float


@dataclass(frozen=True)
class MeshSize:
    """Triangles of a mesh, its extent and volume, and the maximum difference of its volume from the exact solid's."""

    tolerance_mm: float
    size_mm: tuple[float, float, float]
    triangles: int
    volume_mm3: float
    volume_bound_mm3: float

    @classmethod
    def of(cls, mesh: Mesh, part: Part) -> "MeshSize":
        """Measure a part's mesh."""
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
        Thickness of the part, its area (of the middle section) and its volume within the exact curves.
    pieces, faces
        Number of separate pieces, and names of the faces.
    seats
        Pockets and slots.
    mesh
        Size of the mesh; None if no format needs one.
    layers
        Layers for a printer; None if they were not requested.
    warnings
        Properties of the design that the files do not contain.
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
    """Summarise an export in the given formats, optionally with layers for a printer."""
    part = export.part
    meshed = "mesh" in vars(export)
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
        mesh=MeshSize.of(export.mesh, part) if meshed else None,
        layers=layers,
        warnings=(*_warnings(export, formats), *(layers.warnings if layers else ())),
    )


def _pieces(body: Body) -> int:
    """Number of outlines that do not bound holes."""
    return sum(area_mm2([outline]) > 0.0 for outline in body.outlines)


def _warnings(export: Export, formats: Sequence[str]) -> list[Caution]:
    warnings = []
    if export.design.lens.shape == "measured":
        warnings.append(
            look_at(
                "the lens is as it was measured; "
                f'set lens.shape = "{export.design.lens.designed_shape}" for the one to print'
            )
        )
    if (pieces := _pieces(export.body)) > 1:
        warnings.append(look_at(f"the outlines make {pieces} separate pieces"))
    if export.body.apart:
        names = ", ".join(face.name for face in export.body.apart)
        warnings.append(
            note(
                f"{names} are separate objects in the air: the DXF and SVG drawings contain them, "
                "but the solid does not"
            )
        )
    if export.part.cuts:
        warnings.append(look_at("the ray trace ignores pockets and slots"))
        flat = [kind for kind in formats if FORMATS[kind].flat]
        if flat:
            warnings.append(note(f"only the solid contains pockets and slots; the drawings ({', '.join(flat)}) do not"))
    return warnings
