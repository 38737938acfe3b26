"""Mesh files in the formats STL, 3MF and GLB, written directly from their specifications.

- STL (binary): 32-bit numbers; the format has no unit, but the 80-byte header contains the unit, mm, and the label.
- 3MF (3MF Consortium, core specification 1.3): a ZIP file with the mesh in mm; its metadata contains the label.
- GLB (Khronos Group, glTF 2.0): glTF uses metres with Y up, so a node scales the mesh from mm and rotates Z to Y;
  ``extras`` contains the label.

The files do not depend on the time of writing.
"""

import io
import json
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from solen.fabricate.label import WRITER, Label, ascii_of
from solen.fabricate.mesh import BATCH, Mesh

STL_HEADER = 80
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
MODEL = "3D/3dmodel.model"
TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Id="rel0" Target="/{MODEL}" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)
NO_DATE = (1980, 1, 1, 0, 0, 0)
MM_IN_M = 1e-3
Z_TO_Y_UP = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Quaternion x, y, z, w that rotates Z to Y, which is up in glTF."""
FLOAT, UNSIGNED, VERTICES, INDICES = 5126, 5125, 34962, 34963
"""glTF codes of number types and buffers."""


def as_stl(mesh: Mesh, label: Label) -> bytes:
    """Return a binary STL of a mesh, in mm."""
    return b"".join(stl_pieces(mesh, label))


def stl_pieces(mesh: Mesh, label: Label) -> Iterator[bytes]:
    """Yield a binary STL of a mesh in chunks, without a second copy of a large mesh in memory."""
    head = f"{WRITER}; mm; {ascii_of(label.name, 30)}; sha256 {label.sha256[:16]}"
    yield head.encode()[:STL_HEADER].ljust(STL_HEADER) + struct.pack("<I", len(mesh.triangles))
    for _, corners in mesh.corners():
        a, b, c = corners
        normals = np.cross(b - a, c - a)
        triangles = np.zeros(len(a), TRIANGLE)
        triangles["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        triangles["corners"] = corners.swapaxes(0, 1)
        yield triangles.tobytes()


def as_threemf(mesh: Mesh, label: Label) -> bytes:
    """Return a 3MF file of a mesh."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        files: tuple[tuple[str, Iterable[str]], ...] = (
            ("[Content_Types].xml", [TYPES]),
            ("_rels/.rels", [RELATIONS]),
            (MODEL, _model(mesh, label)),
        )
        for name, lines in files:
            entry = zipfile.ZipInfo(name, NO_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w") as file:
                for line in lines:
                    file.write(line.encode())
    return data.getvalue()


def _model(mesh: Mesh, label: Label) -> Iterator[str]:
    """Yield the XML of a mesh in a 3MF in parts; coordinates are rounded to 0.01 nm."""
    about = {"Title": label.name, "Application": WRITER, "Description": "; ".join(label.lines[2:])}
    yield "\n".join(
        (
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">',
            *(f"<metadata name={quoteattr(key)}>{escape(text)}</metadata>" for key, text in about.items()),
            f'<resources><object id="1" type="model" name={quoteattr(label.name)}><mesh>',
            "<vertices>\n",
        )
    )
    for first in range(0, len(mesh.vertices), BATCH):
        vertices = (mesh.vertices[first : first + BATCH].round(8) + 0.0).tolist()
        yield "".join(f'<vertex x="{x:.8f}" y="{y:.8f}" z="{z:.8f}"/>\n' for x, y, z in vertices)
    yield "</vertices>\n<triangles>\n"
    for first in range(0, len(mesh.triangles), BATCH):
        triangles = mesh.triangles[first : first + BATCH].tolist()
        yield "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>\n' for a, b, c in triangles)
    yield '</triangles>\n</mesh></object></resources><build><item objectid="1"/></build>\n</model>\n'


def as_glb(mesh: Mesh, label: Label) -> bytes:
    """Return a binary glTF file of a mesh, whose coordinates are in mm; its node scales them to metres."""
    vertices = mesh.vertices.astype("<f4")
    corners = mesh.triangles.astype("<u4")
    binary = vertices.tobytes() + corners.tobytes()
    extent = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    about = {"name": label.name, "sha256": label.sha256, "about": label.about, "unit_of_mesh": "mm"}
    document = {
        "asset": {"version": "2.0", "generator": WRITER, "extras": about},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": label.name, "scale": [MM_IN_M] * 3, "rotation": Z_TO_Y_UP}],
        "meshes": [
            {"name": label.name, "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}], "extras": about}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": FLOAT, "count": len(vertices), "type": "VEC3"} | extent,
            {"bufferView": 1, "componentType": UNSIGNED, "count": corners.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": vertices.nbytes, "target": VERTICES},
            {"buffer": 0, "byteOffset": vertices.nbytes, "byteLength": corners.nbytes, "target": INDICES},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = _chunk(b"JSON", text) + _chunk(b"BIN\0", binary)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<I4s", len(data), kind) + data


MESH_WRITERS: dict[str, Callable[[Mesh, Label], bytes]] = {"stl": as_stl, "3mf": as_threemf, "glb": as_glb}
"""Mesh formats by file extension."""
