"""3MF files read (3MF Consortium, core specification 1.3): the meshes of what is to be built, in mm.

A 3MF is a ZIP with a model in XML: objects, each a mesh or made of others, and the items to build, each an object and a
transformation. Units are converted; materials, colours, and what extensions add are not looked at, but an extension
that the file requires is refused.
"""

import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.fabricate.mesh import Mesh
from solen.fabricate.meshfiles import CORE, MODEL

MM = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
LARGEST_MB = 500
"""A model beyond this is refused before it is unpacked."""
DEEPEST, MOST_OBJECTS = 16, 10_000
"""Objects made of objects, at most so deep, and so many of them in all."""
SPACE = f"{{{CORE}}}"
REMEDY = "export it again, or as STL"


@dataclass
class Pieces:
    """Triangles that were gathered so far."""

    vertices: list[FloatArray] = field(default_factory=list)
    triangles: list[IntArray] = field(default_factory=list)
    count: int = 0
    objects: int = 0

    def add(self, vertices: FloatArray, triangles: IntArray) -> None:
        """Add a mesh."""
        self.vertices.append(vertices)
        self.triangles.append(triangles + self.count)
        self.count += len(vertices)


def read_threemf(path: Path) -> Mesh:
    """Mesh of all that a 3MF builds, in mm; whether it is closed is not checked.

    Raises
    ------
    DataError
        Where the file cannot be read, is not a 3MF, is damaged, needs an extension, or builds nothing.
    """
    model = _model(path)
    scale = MM.get(model.get("unit", "millimeter"))
    if scale is None:
        raise DataError(f"{path}: unit", value=model.get("unit"), limit=f"must be one of {', '.join(MM)}")
    if model.get("requiredextensions"):
        limit = f"needs the extension {model.get('requiredextensions')}, which solen does not read"
        raise DataError(str(path), limit=limit, remedy="export it as STL")
    objects = {str(element.get("id")): element for element in model.iter(f"{SPACE}object")}
    pieces = Pieces()
    try:
        for item in model.iter(f"{SPACE}item"):
            _gather(item, objects, np.eye(4), pieces, 0)
    except (KeyError, ValueError, IndexError, OverflowError):
        raise DataError(str(path), value="its model", limit="is damaged", remedy=REMEDY) from None
    if not pieces.count or not sum(len(some) for some in pieces.triangles):
        raise DataError(str(path), value="no triangle", limit="is empty", remedy=REMEDY)
    vertices, triangles = np.vstack(pieces.vertices) * scale, np.vstack(pieces.triangles)
    if not np.isfinite(vertices).all() or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise DataError(str(path), value="a corner that does not exist", limit="is damaged", remedy=REMEDY)
    return Mesh(vertices, triangles, 0.0)


def _model(path: Path) -> ET.Element:
    """The model's root."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            name = MODEL if MODEL in names else min(names)
            if archive.getinfo(name).file_size > LARGEST_MB * 1e6:
                raise DataError(str(path), limit=f"holds a model of more than {LARGEST_MB} MB", remedy="coarsen it")
            return ET.fromstring(archive.read(name))  # noqa: S314  expat bounds what entities grow to
    except FileNotFoundError:
        raise DataError(str(path), limit="no such file", remedy="check the path") from None
    except (zipfile.BadZipFile, ValueError, KeyError, zlib.error, EOFError, NotImplementedError, RuntimeError):
        raise DataError(str(path), limit="is not a 3MF, or damaged", remedy=REMEDY) from None
    except ET.ParseError as bad:
        raise DataError(str(path), limit=f"its model is damaged: {bad}", remedy=REMEDY) from None
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror or bad}", remedy="check it") from None


def _gather(
    reference: ET.Element, objects: dict[str, ET.Element], outer: FloatArray, pieces: Pieces, depth: int
) -> None:
    """Add what an item or a component refers to, moved by its transformation and those around it."""
    pieces.objects += 1
    if depth > DEEPEST or pieces.objects > MOST_OBJECTS:
        raise ValueError("objects in a circle, or without end")
    element = objects[str(reference.get("objectid"))]
    moved = _transform(reference.get("transform")) @ outer
    mesh = element.find(f"{SPACE}mesh")
    if mesh is not None:
        vertices = _numbers(mesh, "vertex", ("x", "y", "z"))
        triangles = _numbers(mesh, "triangle", ("v1", "v2", "v3")).astype(np.int64)
        if np.linalg.det(moved[:3, :3]) < 0.0:  # a mirror turns the outside in
            triangles = triangles[:, ::-1]
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise IndexError
        pieces.add(vertices @ moved[:3, :3] + moved[3, :3], triangles)
    for component in element.iter(f"{SPACE}component"):
        _gather(component, objects, moved, pieces, depth + 1)


def _numbers(mesh: ET.Element, name: str, keys: tuple[str, str, str]) -> FloatArray:
    """Numbers (N, 3) of a mesh's vertices or triangles."""
    rows = [[float(element.attrib[key]) for key in keys] for element in mesh.iter(f"{SPACE}{name}")]
    numbers = np.array(rows, float).reshape(-1, 3)
    if not np.isfinite(numbers).all():
        raise ValueError("a number that is not finite")
    return numbers


def _transform(text: str | None) -> FloatArray:
    """Matrix (4, 4) for rows of coordinates, of the twelve numbers that a 3MF gives."""
    matrix = np.eye(4)
    if text:
        matrix[:, :3] = np.array([float(word) for word in text.split()]).reshape(4, 3)
        if not np.isfinite(matrix).all():
            raise ValueError("a number that is not finite")
    return matrix
