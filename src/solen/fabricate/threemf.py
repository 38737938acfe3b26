"""Reader of 3MF files (3MF Consortium, core specification 1.3): the meshes to be built, in mm.

A 3MF is a ZIP file with an XML model. The model contains objects, each of which is a mesh or is composed of other
objects, and the items to be built, each of which is an object with a transformation. Units are converted; materials,
colours and extensions are ignored, but a file that requires an extension is rejected.
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
"""Maximum size of the model, which is checked before it is unpacked."""
MAX_DEPTH, MAX_OBJECTS = 16, 10_000
"""Maximum nesting depth of objects, and maximum number of objects."""
NAMESPACE = f"{CORE} "
CHUNK = 1 << 20
"""Number of bytes parsed at a time."""
REMEDY = "export it again, or as STL"


@dataclass
class CollectedMeshes:
    """Vertices and triangles of all meshes, the number of vertices, and the number of objects."""

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
    """An object: its vertices, the vertex indices of its triangles, and its components."""

    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    triangles: "array[int]" = field(default_factory=lambda: array("q"))
    components: list[dict[str, str]] = field(default_factory=list)


@dataclass
class Model:
    """Contents of a model, collected element by element, so that its tree need not be in memory."""

    attributes: dict[str, str] = field(default_factory=dict)
    objects: dict[str, MeshObject] = field(default_factory=dict)
    items: list[dict[str, str]] = field(default_factory=list)
    _current: MeshObject = field(default_factory=MeshObject)

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element of the core specification."""
        tag = name.removeprefix(NAMESPACE) if name.startswith(NAMESPACE) else ""
        if tag == "vertex":
            self._current.vertices.extend([float(attributes[key]) for key in ("x", "y", "z")])
        elif tag == "triangle":
            self._current.triangles.extend([int(attributes[key]) for key in ("v1", "v2", "v3")])
        elif tag == "object":
            self._current = self.objects.setdefault(str(attributes.get("id")), MeshObject())
        elif tag == "component":
            self._current.components.append(attributes)
        elif tag == "item":
            self.items.append(attributes)
        elif tag == "model":
            self.attributes = attributes


def read_threemf(path: Path) -> Mesh:
    """Read the mesh of all items of a 3MF in mm, without checking whether it is closed.

    Raises
    ------
    DataError
        If the file cannot be read, is not a 3MF, is damaged, requires an extension, or has no triangles.
    """
    model = _model(path)
    scale = MM.get(model.attributes.get("unit", "millimeter"))
    if scale is None:
        raise DataError(f"{path}: unit", value=model.attributes.get("unit"), limit=f"must be one of {', '.join(MM)}")
    if extensions := model.attributes.get("requiredextensions"):
        limit = f"requires the extension {extensions}, which solen does not read"
        raise DataError(str(path), limit=limit, remedy="export it as STL")
    meshes = CollectedMeshes()
    try:
        for item in model.items:
            _collect(item, model.objects, np.eye(4), meshes, 0)
    except (KeyError, ValueError, IndexError, OverflowError):
        raise _damaged(path) from None
    if not any(len(triangles) for triangles in meshes.triangles):
        raise DataError(str(path), limit="contains no triangles", remedy=REMEDY)
    vertices = np.vstack(meshes.vertices) * scale
    if not np.isfinite(vertices).all():
        raise _damaged(path)
    return Mesh(vertices, np.vstack(meshes.triangles), 0.0)


def _damaged(path: Path) -> DataError:
    return DataError(str(path), limit="its model is damaged", remedy=REMEDY)


def _model(path: Path) -> Model:
    """Return the parsed model of a 3MF file; raise `DataError` if it cannot be read or is damaged."""
    model = Model()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".model")]
            name = MODEL if MODEL in names else min(names)
            if archive.getinfo(name).file_size > MAX_MB * 1e6:
                limit = f"contains a model of more than {MAX_MB} MB"
                raise DataError(str(path), limit=limit, remedy="reduce the number of triangles")
            parser = expat.ParserCreate(namespace_separator=" ")  # expat limits the expansion of entities
            parser.StartElementHandler = _guarded(model, path)
            with archive.open(name) as file:
                while chunk := file.read(CHUNK):
                    parser.Parse(chunk, False)
            parser.Parse(b"", True)
    except FileNotFoundError:
        raise DataError(str(path), limit="no such file", remedy="check the path") from None
    except (zipfile.BadZipFile, ValueError, KeyError, zlib.error, EOFError, NotImplementedError, RuntimeError):
        raise DataError(str(path), limit="is damaged, or not a 3MF", remedy=REMEDY) from None
    except expat.ExpatError as error:
        raise DataError(str(path), limit=f"its model is damaged: {error}", remedy=REMEDY) from None
    except OSError as error:
        limit = f"cannot be read: {error.strerror or error}"
        raise DataError(str(path), limit=limit, remedy="check the path and its permissions") from None
    return model


def _guarded(model: Model, path: Path) -> Callable[[str, dict[str, str]], None]:
    """Return `Model.start` with an error that names the file if a number is missing or invalid."""

    def start(name: str, attributes: dict[str, str]) -> None:
        try:
            model.start(name, attributes)
        except (KeyError, ValueError, OverflowError):
            raise _damaged(path) from None

    return start


def _collect(
    reference: dict[str, str], objects: dict[str, MeshObject], outer: FloatArray, meshes: CollectedMeshes, depth: int
) -> None:
    """Add the object of an item or component, with its own transformation followed by the outer ones."""
    meshes.objects += 1
    if depth > MAX_DEPTH or meshes.objects > MAX_OBJECTS:
        raise ValueError("objects contain one another")
    mesh_object = objects[str(reference.get("objectid"))]
    transform = _transform(reference.get("transform")) @ outer
    if len(mesh_object.vertices) or len(mesh_object.triangles):
        vertices = np.frombuffer(mesh_object.vertices).reshape(-1, 3)
        triangles = np.frombuffer(mesh_object.triangles, np.int64).reshape(-1, 3)
        if not np.isfinite(vertices).all():
            raise ValueError("a number is not finite")
        if np.linalg.det(transform[:3, :3]) < 0.0:  # a reflection turns the mesh inside out
            triangles = triangles[:, ::-1]
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise IndexError
        meshes.add(vertices @ transform[:3, :3] + transform[3, :3], triangles)
    for component in mesh_object.components:
        _collect(component, objects, transform, meshes, depth + 1)


def _transform(text: str | None) -> FloatArray:
    """Return the matrix (4, 4), which multiplies rows of coordinates, from its twelve numbers in a 3MF."""
    matrix = np.eye(4)
    if text:
        matrix[:, :3] = np.array([float(word) for word in text.split()]).reshape(4, 3)
        if not np.isfinite(matrix).all():
            raise ValueError("a number is not finite")
    return matrix
