"""Readers of printers' files, written from the descriptions of the formats alone; they share no code with the writers.

``.goo`` V3.0 is the open format of Elegoo's printers: big-endian, a header of 195,477 bytes, for each layer 70
bytes and its runs of grey, and an end mark. The archive is what UVtools (github.com/sn4k3/UVtools, GenericZIPFile)
opens: pictures ``1.png`` to ``N.png`` at the top of the ZIP and an XML ``manifest.uvtools`` with the display's size.
"""

import io
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from PIL import Image

MAGIC = bytes([7, 0, 0, 0, 0x44, 0x4C, 0x50, 0])
HEADER = [
    ("version", "4s"), ("magic", "8s"), ("software", "32s"), ("software_version", "24s"), ("created", "24s"),
    ("printer_name", "32s"), ("printer_type", "32s"), ("profile", "32s"), ("anti_aliasing", "H"), ("grey_level", "H"),
    ("blur", "H"), ("small_preview", "26912s"), ("end_1", "2s"), ("big_preview", "168200s"), ("end_2", "2s"),
    ("layers", "I"), ("columns", "H"), ("rows", "H"), ("mirror_x", "?"), ("mirror_y", "?"), ("width_mm", "f"),
    ("depth_mm", "f"), ("height_mm", "f"), ("layer_mm", "f"), ("exposure_s", "f"), ("wait_mode", "B"),
    ("light_off_s", "f"), ("bottom_after_cure_s", "f"), ("bottom_after_lift_s", "f"), ("bottom_before_cure_s", "f"),
    ("after_cure_s", "f"), ("after_lift_s", "f"), ("before_cure_s", "f"), ("bottom_exposure_s", "f"),
    ("bottom_layers", "I"), ("bottom_lift_mm", "f"), ("bottom_lift_speed", "f"), ("lift_mm", "f"), ("lift_speed", "f"),
    ("bottom_retract_mm", "f"), ("bottom_retract_speed", "f"), ("retract_mm", "f"), ("retract_speed", "f"),
    ("second_moves", "32s"), ("bottom_light", "H"), ("light", "H"), ("each_layer", "?"), ("print_s", "I"),
    ("volume_mm3", "f"), ("grams", "f"), ("price", "f"), ("currency", "8s"), ("first_layer_at", "I"),
    ("full_grey", "B"), ("transition_layers", "H"),
]  # fmt: skip
LAYER = [
    ("pause", "H"), ("pause_mm", "f"), ("z_mm", "f"), ("exposure_s", "f"), ("light_off_s", "f"), ("after_cure_s", "f"),
    ("after_lift_s", "f"), ("before_cure_s", "f"), ("lift_mm", "f"), ("lift_speed", "f"), ("lift_2_mm", "f"),
    ("lift_2_speed", "f"), ("retract_mm", "f"), ("retract_speed", "f"), ("retract_2_mm", "f"),
    ("retract_2_speed", "f"), ("light", "H"), ("end", "2s"), ("bytes", "I"),
]  # fmt: skip


@dataclass(frozen=True)
class Read:
    """Header, and of each layer its entry and its picture (rows, columns), the first row first."""

    header: dict[str, Any]
    layers: list[tuple[dict[str, Any], NDArray[np.uint8]]]


def read_goo(path: Path) -> Read:
    """A .goo file, with every mark, length and checksum asserted."""
    data = path.read_bytes()
    header, at = _fields(data, 0, HEADER)
    assert at == 195477
    assert (header["version"], header["magic"]) == (b"V3.0", MAGIC)
    assert header["end_1"] == header["end_2"] == b"\r\n"
    at = header["first_layer_at"]
    layers = []
    for _ in range(header["layers"]):
        entry, at = _fields(data, at, LAYER)
        runs = data[at : at + entry["bytes"]]
        at += entry["bytes"]
        assert entry["end"] == data[at : at + 2] == b"\r\n"
        at += 2
        layers.append((entry, _picture(runs, header["rows"], header["columns"])))
    assert data[at:] == b"\0\0\0" + MAGIC
    return Read(header, layers)


def _fields(data: bytes, at: int, names: list[tuple[str, str]]) -> tuple[dict[str, Any], int]:
    form = ">" + "".join(kind for _, kind in names)
    values = struct.unpack_from(form, data, at)
    return dict(zip((name for name, _ in names), values, strict=True)), at + struct.calcsize(form)


def _picture(runs: bytes, rows: int, columns: int) -> NDArray[np.uint8]:
    """Grey values of a layer's chunks: 0, a grey, a difference, 255, by the two highest bits of each."""
    assert runs[0] == 0x55
    assert runs[-1] == ~sum(runs[1:-1]) & 0xFF, "checksum"
    at, grey, pieces = 1, 0, []
    while at < len(runs) - 1:
        first = runs[at]
        kind, extra, count = first >> 6, first >> 4 & 3, first & 15
        at += 1
        if kind == 2:
            grey += -count if extra & 2 else count
            count = runs[at] if extra & 1 else 1
            at += extra & 1
        else:
            grey = (0, runs[at], 0, 255)[kind]
            at += kind == 1
            count += int.from_bytes(runs[at : at + extra], "big") << 4
            at += extra
        pieces.append(np.full(count, grey, np.uint8))
    picture = np.concatenate(pieces)
    assert picture.size == rows * columns, "every pixel has a value"
    return picture.reshape(rows, columns)


def read_uvtools_zip(path: Path) -> Read:
    """Pictures and manifest of an archive as UVtools takes it for its own: nothing in it may say otherwise."""
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        assert not [name for name in names if name.endswith((".gcode", ".xml"))], "another program's archive"
        root = ET.fromstring(archive.read("manifest.uvtools"))  # noqa: S314  the test's own file
        assert root.tag == "Manifest"
        numbers = sorted(int(name[:-4]) for name in names if name.endswith(".png") and name[:-4].isdigit())
        assert numbers == list(range(1, len(numbers) + 1))
        pictures = [np.asarray(Image.open(io.BytesIO(archive.read(f"{number}.png")))) for number in numbers]
    return Read({child.tag: child.text for child in root}, [({}, picture) for picture in pictures])
