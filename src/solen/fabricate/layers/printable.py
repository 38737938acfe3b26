"""A part ready for the printer: oriented for printing, with its STL, label and resin.

A design gives exact outlines and a mesh file gives triangles. `printable_design` and `printable_mesh` turn either into
a `Printable`, from which a `Job` makes layers.
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
from solen.fabricate.layers.solid import MESH_MM, Solid, mesh_solid, solid_of
from solen.fabricate.lens_parts import lies_flat
from solen.fabricate.mesh import Mesh, mesh_of
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

UNNAMED = "not named"
"""Beginning of the description if the resin has no name."""


@dataclass(frozen=True, eq=False)
class Printable:
    """A part ready for the printer.

    Attributes
    ----------
    solid
        The part as placed on the plate.
    placed
        Mesh of the part, with the lowest corner at the origin.
    label
        Description in exported files.
    source
        The file that it was read from.
    material, stated_resin
        Description of the resin, and its data if it is named.
    warnings
        Warnings about the file.
    lies
        Required orientation on the plate, in words; None if any orientation is suitable.
    seats
        Names of the pockets and slots; None if the file does not list them.
    """

    solid: Solid
    placed: Mesh
    label: Label
    source: Provenance
    material: str
    stated_resin: Resin | None
    warnings: tuple[Caution, ...] = ()
    lies: str | None = None
    seats: tuple[str, ...] | None = None

    @property
    def resin(self) -> str:
        """Name of the resin; empty if no resin is named."""
        return "" if self.material.startswith(UNNAMED) else self.material

    def write_stl(self, path: Path) -> None:
        """Write the mesh as STL."""
        with path.open("wb") as file:
            file.writelines(stl_pieces(self.placed, self.label))


def printable_design(design: Design, part: Part, path: Path, slicing: Slicing) -> Printable:
    """Prepare the part of a design; ``path`` is the design file."""
    rotation = orientation(slicing.orientation, slicing.rotate_deg)
    label = label_of(design, f"thickness {design.body.thickness_mm:g} mm, {slicing.orientation}")
    resin: Resin | None
    if slicing.resin is None and design.material.resin is not None:
        named = resin_of(design.material.resin, design.files.get("material.resin"))
        material, resin = named.name, named
    else:
        index = design.material.index
        material, resin = resin_named(slicing.resin, "" if index is None else f" (n = {index:g} in the design)")
    source = Provenance(path.name, label.sha256, "design")
    placed = placed_mesh(mesh_of(part, MESH_MM), rotation)
    lies, warnings = lies_flat(part, rotation, slicing.layer_um)
    seats = tuple(cut.name for cut in part.cuts if cut.name.startswith(("pocket", "slot")))
    return Printable(solid_of(part, rotation), placed, label, source, material, resin, tuple(warnings), lies, seats)


def printable_mesh(path: Path, slicing: Slicing) -> Printable:
    """Prepare a closed mesh read from a file.

    Raises
    ------
    DataError
        If the file is not a mesh in a format that solen reads or is damaged, or if the surface is not closed.
    """
    kind = path.suffix.lower()
    if kind not in MESH_READERS:
        raise DataError(
            str(path), limit="must be a design (.toml) or a mesh (.stl, .3mf)", remedy="export the mesh as STL"
        )
    mesh = MESH_READERS[kind](path)
    warnings: tuple[Caution, ...] = ()
    if mesh.volume_mm3 < 0.0 and not mesh.open_edges():
        mesh = Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy(), mesh.tolerance_mm)
        warnings = (note("the mesh was inside out; the vertex order of its triangles was reversed"),)
    rotation = orientation(slicing.orientation, slicing.rotate_deg)
    solid = mesh_solid(mesh, rotation, str(path))
    if solid.overlap_mm3 > 0.0:
        overlap = f"shells of the mesh overlap: the common volume of {solid.overlap_mm3:.4g} mm³ is counted once"
        warnings = (*warnings, warning(overlap))
    label = Label(path.stem, hashlib.sha256(path.read_bytes()).hexdigest(), slicing.orientation)
    material, resin = resin_named(slicing.resin)
    source = Provenance(path.name, label.sha256, kind[1:])
    return Printable(solid, placed_mesh(mesh, rotation), label, source, material, resin, warnings)


def placed_mesh(mesh: Mesh, rotation: FloatArray) -> Mesh:
    """Return a mesh rotated by a matrix (3, 3), with its lowest corner at the origin."""
    turned = mesh.vertices @ rotation.T
    return Mesh(turned - turned.min(axis=0), mesh.triangles, mesh.tolerance_mm)


def resin_named(name: str | None, known: str = "") -> tuple[str, Resin | None]:
    """Return the name and data of a resin from the library or a file; without a name, the ``known`` description."""
    if name is None:
        return f"{UNNAMED}{known}: give --resin", None
    resin = resin_of(name, Path(name) if is_file_path(name) else None)
    return resin.name, resin
