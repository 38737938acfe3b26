"""A part ready for the printer: oriented for printing, with its STL, label and resin.

A design has exact outlines, and a mesh file has triangles. `printable_design` and `printable_mesh` make a `Printable`
of them, from which a `Job` makes layers.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.label import Label, label_of
from solen.fabricate.layers.options import Slicing
from solen.fabricate.layers.orientation import orientation
from solen.fabricate.layers.solid import Solid, fine_mesh, mesh_solid, solid_of
from solen.fabricate.lens_parts import required_orientation
from solen.fabricate.mesh import Mesh
from solen.fabricate.meshfiles import stl_pieces
from solen.fabricate.part import Part
from solen.fabricate.stl import read_stl
from solen.fabricate.threemf import read_threemf
from solen.material.resin import Resin, resin_of
from solen.ranks import Caution, note, warning
from solen.recording import Provenance
from solen.spec import Design
from solen.spec.design import is_file_path

MESH_READERS: dict[str, Callable[[Path], Mesh]] = {".stl": read_stl, ".3mf": read_threemf}
UNKNOWN_RESIN = "unknown resin"
"""Beginning of the description of an unspecified resin."""


@dataclass(frozen=True, eq=False)
class Printable:
    """A part ready for the printer.

    Attributes
    ----------
    solid
        The oriented part.
    mesh
        Mesh of the oriented part, with its minimum coordinates at the origin.
    label
        Label of exported files.
    source
        The file from which the part was read.
    material, resin
        Description of the resin, and its data if it is specified.
    warnings
        Warnings about the file.
    required_orientation
        Description of the required orientation; None if any orientation is suitable.
    seats
        Names of the pockets and slots; None if the file does not contain them.
    """

    solid: Solid
    mesh: Mesh
    label: Label
    source: Provenance
    material: str
    resin: Resin | None
    warnings: tuple[Caution, ...] = ()
    required_orientation: str | None = None
    seats: tuple[str, ...] | None = None

    @property
    def resin_name(self) -> str:
        """Name of the resin; empty if it is not specified."""
        return "" if self.material.startswith(UNKNOWN_RESIN) else self.material

    def write_stl(self, path: Path) -> None:
        """Write the mesh as STL."""
        with path.open("wb") as file:
            file.writelines(stl_pieces(self.mesh, self.label))


def printable_design(design: Design, part: Part, path: Path, slicing: Slicing) -> Printable:
    """Return the printable part of a design; ``path`` is the design file."""
    rotation = orientation(slicing.orientation, slicing.rotate_deg)
    label = label_of(design, f"thickness {design.body.thickness_mm:g} mm, {slicing.orientation}")
    resin: Resin | None
    if slicing.resin is None and design.material.resin is not None:
        resin = resin_of(design.material.resin, design.files.get("material.resin"))
        material = resin.name
    else:
        index = design.material.index
        material, resin = described_resin(slicing.resin, "" if index is None else f" (n = {index:g} in the design)")
    required, warnings = required_orientation(part, rotation, slicing.layer_um)
    return Printable(
        solid=solid_of(part, rotation),
        mesh=rotated_mesh(fine_mesh(part), rotation),
        label=label,
        source=Provenance(path.name, label.sha256, "design"),
        material=material,
        resin=resin,
        warnings=tuple(warnings),
        required_orientation=required,
        seats=tuple(cut.name for cut in part.cuts if cut.name.startswith(("pocket", "slot"))),
    )


def printable_mesh(path: Path, slicing: Slicing) -> Printable:
    """Return a printable part from a file that contains a closed mesh.

    Raises
    ------
    DataError
        If the file is damaged or not in a format that solen reads, or if the surface is not closed.
    """
    kind = path.suffix.lower()
    if kind not in MESH_READERS:
        limit = "must be a design (.toml) or a mesh (.stl, .3mf)"
        raise DataError(str(path), limit=limit, remedy="export the mesh as STL")
    mesh = MESH_READERS[kind](path)
    warnings: tuple[Caution, ...] = ()
    if mesh.volume_mm3 < 0.0 and not mesh.open_edges():
        mesh = Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy(), mesh.tolerance_mm)
        warnings = (note("the mesh was inside out: the vertex order of its triangles was reversed"),)
    rotation = orientation(slicing.orientation, slicing.rotate_deg)
    solid = mesh_solid(mesh, rotation, str(path))
    if solid.overlap_mm3 > 0.0:
        text = f"shells of the mesh overlap in {solid.overlap_mm3:.4g} mm³, which are printed as one solid"
        warnings = (*warnings, warning(text))
    label = Label(path.stem, hashlib.sha256(path.read_bytes()).hexdigest(), slicing.orientation)
    material, resin = described_resin(slicing.resin)
    source = Provenance(path.name, label.sha256, kind[1:])
    return Printable(solid, rotated_mesh(mesh, rotation), label, source, material, resin, warnings)


def rotated_mesh(mesh: Mesh, rotation: FloatArray) -> Mesh:
    """Return a mesh rotated by a matrix (3, 3), with its minimum coordinates at the origin."""
    vertices = mesh.vertices @ rotation.T
    return Mesh(vertices - vertices.min(axis=0), mesh.triangles, mesh.tolerance_mm)


def described_resin(name: str | None, known: str = "") -> tuple[str, Resin | None]:
    """Return the description and data of a resin; without a name, the description contains ``known``."""
    if name is None:
        return f"{UNKNOWN_RESIN}{known}: specify --resin", None
    resin = resin_of(name, Path(name) if is_file_path(name) else None)
    return resin.name, resin
