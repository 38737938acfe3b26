"""3MF reader (3MF Consortium, core specification 1.3): the meshes to be built, in mm.

A 3MF is a ZIP that contains an XML model with objects, each of which is a mesh or composed of others, and the items to
build, each of which is an object with a transformation. Units are converted; materials, colours and extensions are
ignored, but a file that requires an extension is rejected.
"""

import zipfile
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.fabricate.mesh import Mesh
from solen.fabricate.meshfiles import CORE, MODEL

MM = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
MAX_MB = 500
"""Maximum model size, checked before the model is unpacked."""
MAX_DEPTH, MAX_OBJECTS = 16, 10_000
"""Maximum nesting depth of objects, and maximum number of objects."""
SPACE = f"{CORE} "
PIECE = 1 << 20
"""Number of bytes parsed at a time."""
REMEDY = "export it again, or as STL"


@dataclass
class Pieces:
    """Triangles collected from the meshes."""

    vertices: list[FloatArray] = field(default_factory=list)
    triangles: list[IntArray] = field(default_factory=list)
    count: int = 0
    objects: int = 0

    def add(self, vertices: FloatArray, triangles: IntArray) -> None:
        """Add a mesh."""
        self.vertices.append(vertices)
        self.triangles.append(triangles + self.count)
        self.count += len(vertices)


@dataclass
class MeshObject:
    """An object: corners, corner indices of its triangles, and component objects."""

    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    triangles: "array[int]" = field(default_factory=lambda: array("q"))
    parts: list[dict[str, str]] = field(default_factory=list)


@dataclass
class Model:
    """Contents of a model, collected element by element to avoid storing the entire tree in memory."""

    about: dict[str, str] = field(default_factory=dict)
    objects: dict[str, MeshObject] = field(default_factory=dict)
    items: list[dict[str, str]] = field(default_factory=list)
    _current: MeshObject = field(default_factory=MeshObject)

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element of the core specification."""
        tag = name.removeprefix(SPACE) if name.startswith(SPACE) else ""
        if tag == "vertex":
            self._current.vertices.extend([float(attributes[key]) for key in ("x", "y", "z")])
        elif tag == "triangle":
            self._current.triangles.extend([int(attributes[key]) for key in ("v1", "v2", "v3")])
        elif tag == "object":
            self._current = self.objects.setdefault(str(attributes.get("id")), MeshObject())
        elif tag == "component":
            self._current.parts.append(attributes)
        elif tag == "item":
            self.items.append(attributes)
        elif tag == "model":
            self.about = attributes


def read_threemf(path: Path) -> Mesh:
    """Read the mesh of all items that a 3MF builds, in mm, without checking whether it is closed.

    Raises
    ------
    DataError
        If the file cannot be read, is not a 3MF, is damaged, requires an extension, or builds nothing.
    """
    model = _model(path)
    scale = MM.get(model.about.get("unit", "millimeter"))
    if scale is None:
        raise DataError(f"{path}: unit", value=model.about.get("unit"), limit=f"must be one of {', '.join(MM)}")
    if extensions := model.about.get("requiredextensions"):
        limit = f"requires the extension {extensions}, which solen does not read"
        raise DataError(str(path), limit=limit, remedy="export it as STL")
    pieces = Pieces()
    try:
        for item in model.items:
            _gather(item, model.objects, np.eye(4), pieces, 0)
    except (KeyError, ValueError, IndexError, OverflowError):
        raise _damaged(path) from None
    if not pieces.count or not sum(len(some) for some in pieces.triangles):
        raise DataError(str(path), value="no triangle", limit="is empty", remedy=REMEDY)
    vertices, triangles = np.vstack(pieces.vertices) * scale, np.vstack(pieces.triangles)
    if not np.isfinite(vertices).all() or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise DataError(str(path), value="a vertex that does not exist", limit="is damaged", remedy=REMEDY)
    return Mesh(vertices, triangles, 0.0)


def _damaged(path: Path) -> DataError:
    return DataError(str(path), value="its model", limit="is damaged", remedy=REMEDY)


def _model(path: Path) -> Model:
    """Parse the model."""
    model = Model()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            name = MODEL if MODEL in names else min(names)
            if archive.getinfo(name).file_size > MAX_MB * 1e6:
                raise DataError(
                    str(path), limit=f"contains a model of more than {MAX_MB} MB", remedy="reduce its triangles"
                )
            parser = expat.ParserCreate(namespace_separator=" ")  # expat limits the expansion of entities
            parser.StartElementHandler = _guarded(model, path)
            with archive.open(name) as opened:
                while piece := opened.read(PIECE):
                    parser.Parse(piece, False)
            parser.Parse(b"", True)
    except FileNotFoundError:
        raise DataError(str(path), limit="no such file", remedy="check the path") from None
    except (zipfile.BadZipFile, ValueError, KeyError, zlib.error, EOFError, NotImplementedError, RuntimeError):
        raise DataError(str(path), limit="is damaged, or not a 3MF", remedy=REMEDY) from None
    except expat.ExpatError as bad:
        raise DataError(str(path), limit=f"its model is damaged: {bad}", remedy=REMEDY) from None
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror or bad}", remedy="check it") from None
    return model


def _guarded(model: Model, path: Path) -> Callable[[str, dict[str, str]], None]:
    """Call `Model.start`; if a number is missing or invalid, raise an error that names the file."""

    def start(name: str, attributes: dict[str, str]) -> None:
        try:
            model.start(name, attributes)
        except (KeyError, ValueError, OverflowError):
            raise _damaged(path) from None

    return start


def _gather(
    reference: dict[str, str], objects: dict[str, MeshObject], outer: FloatArray, pieces: Pieces, depth: int
) -> None:
    """Add the object of an item or component, transformed by its own and all outer transformations."""
    pieces.objects += 1
    if depth > MAX_DEPTH or pieces.objects > MAX_OBJECTS:
        raise ValueError("its objects contain one another")
    mesh_object = objects[str(reference.get("objectid"))]
    moved = _transform(reference.get("transform")) @ outer
    if len(mesh_object.vertices) or len(mesh_object.triangles):
        vertices = np.frombuffer(mesh_object.vertices).reshape(-1, 3)
        triangles = np.frombuffer(mesh_object.triangles, np.int64).reshape(-1, 3)
        if not np.isfinite(vertices).all():
            raise ValueError("a number that is not finite")
        if np.linalg.det(moved[:3, :3]) < 0.0:  # a reflection turns the mesh inside out
            triangles = triangles[:, ::-1]
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise IndexError
        pieces.add(vertices @ moved[:3, :3] + moved[3, :3], triangles)
    for part in mesh_object.parts:
        _gather(part, objects, moved, pieces, depth + 1)


def _transform(text: str | None) -> FloatArray:
    """Return a matrix (4, 4) for rows of coordinates, from the twelve numbers in a 3MF."""
    matrix = np.eye(4)
    if text:
        matrix[:, :3] = np.array([float(word) for word in text.split()]).reshape(4, 3)
        if not np.isfinite(matrix).all():
            raise ValueError("a number that is not finite")
    return matrix
