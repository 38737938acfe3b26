"""A reader of `.goo` V3.0, written from the specification alone by an author who had not seen the writer.

The specification is the table of fields published by Elegoo (github.com/elegooofficial/GOO), as implemented by
independent programs: UVtools (`GooFile.cs`, with the manufacturer's comments on runs) and mslicer (`goo_format`, which
adds that numbers are big-endian, that the checksum is the inverted sum of the payload, and that runs cover every
pixel). A file that violates a rule is refused; nothing is repaired.
"""

import math
import re
import struct
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = bytes.fromhex("07 00 00 00 44 4C 50 00")
DELIMITER = b"\r\n"
ENDING = bytes(3) + MAGIC
PREVIEWS = {"small_preview": 116, "big_preview": 290}
"""Side of each preview in pixels of two bytes: red 5 bits, green 6, blue 5, big-endian."""

HEADER = [
    *(("version", "4s"), ("magic", "8s"), ("software", "32s"), ("software_version", "24s"), ("file_time", "24s")),
    *(("printer_name", "32s"), ("printer_type", "32s"), ("profile_name", "32s")),
    *(("anti_aliasing_level", "H"), ("grey_level", "H"), ("blur_level", "H")),
    *(("small_preview", f"{116 * 116 * 2}s"), ("small_preview_end", "2s")),
    *(("big_preview", f"{290 * 290 * 2}s"), ("big_preview_end", "2s")),
    *(("total_layers", "I"), ("x_resolution", "H"), ("y_resolution", "H"), ("x_mirror", "B"), ("y_mirror", "B")),
    *(("x_size_mm", "f"), ("y_size_mm", "f"), ("z_size_mm", "f"), ("layer_thickness_mm", "f")),
    *(("exposure_s", "f"), ("exposure_delay_mode", "B"), ("turn_off_s", "f")),
    *(("bottom_before_lift_s", "f"), ("bottom_after_lift_s", "f"), ("bottom_after_retract_s", "f")),
    *(("before_lift_s", "f"), ("after_lift_s", "f"), ("after_retract_s", "f")),
    *(("bottom_exposure_s", "f"), ("bottom_layers", "I")),
    *(("bottom_lift_mm", "f"), ("bottom_lift_mm_per_min", "f"), ("lift_mm", "f"), ("lift_mm_per_min", "f")),
    *(("bottom_retract_mm", "f"), ("bottom_retract_mm_per_min", "f"), ("retract_mm", "f"), ("retract_mm_per_min", "f")),
    *(("bottom_second_lift_mm", "f"), ("bottom_second_lift_mm_per_min", "f")),
    *(("second_lift_mm", "f"), ("second_lift_mm_per_min", "f")),
    *(("bottom_second_retract_mm", "f"), ("bottom_second_retract_mm_per_min", "f")),
    *(("second_retract_mm", "f"), ("second_retract_mm_per_min", "f")),
    *(("bottom_light_pwm", "H"), ("light_pwm", "H"), ("advance_mode", "B"), ("printing_time_s", "I")),
    *(("total_volume_mm3", "f"), ("total_weight_g", "f"), ("total_price", "f"), ("price_unit", "8s")),
    *(("layers_begin_at", "I"), ("grey_scale_level", "B"), ("transition_layers", "H")),
]
LAYER = [
    *(("pause_flag", "H"), ("pause_position_mm", "f"), ("position_mm", "f"), ("exposure_s", "f"), ("turn_off_s", "f")),
    *(("before_lift_s", "f"), ("after_lift_s", "f"), ("after_retract_s", "f")),
    *(("lift_mm", "f"), ("lift_mm_per_min", "f"), ("second_lift_mm", "f"), ("second_lift_mm_per_min", "f")),
    *(("retract_mm", "f"), ("retract_mm_per_min", "f"), ("second_retract_mm", "f"), ("second_retract_mm_per_min", "f")),
    *(("light_pwm", "H"), ("definition_end", "2s"), ("data_size", "I")),
]
FLAGS = {"x_mirror", "y_mirror", "exposure_delay_mode", "advance_mode", "grey_scale_level", "pause_flag"}
POSITIVE = {
    *("total_layers", "x_resolution", "y_resolution", "x_size_mm", "y_size_mm", "z_size_mm"),
    *("layer_thickness_mm", "exposure_s", "bottom_exposure_s", "position_mm"),
}
STRINGS = {"software", "software_version", "file_time", "printer_name", "printer_type", "profile_name", "price_unit"}
REPEATED = ["exposure_s", "light_pwm", *(name for name, _ in LAYER if name.endswith(("lift_s", "retract_s")))]
REPEATED += [name for name, _ in LAYER if "lift_mm" in name or "retract_mm" in name]
"""Fields that the header has twice, for bottom layers (`bottom_…`) and for the others."""


class RuleError(ValueError):
    """A file violates a rule of the specification."""


def need(holds: bool, rule: str) -> None:
    if not holds:
        raise RuleError(rule)


@dataclass(frozen=True)
class GooLayer:
    """A layer: its definition and its runs."""

    fields: dict[str, Any]
    data: bytes = field(repr=False)
    shape: tuple[int, int]
    """Rows and columns."""
    top: int
    """Grey level of full light."""

    @cached_property
    def runs(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Grey level and length of each run."""
        return decoded(self.data, self.shape[0] * self.shape[1], self.top)

    @property
    def lit_pixels(self) -> float:
        """Covered area in pixels: the sum of grey levels as fractions of full light."""
        greys, lengths = self.runs
        return float(np.dot(greys.astype(float), lengths)) / self.top

    @property
    def image(self) -> NDArray[Any]:
        """Greys, shape (rows, columns)."""
        return np.repeat(*self.runs).reshape(self.shape)


@dataclass(frozen=True)
class GooFile:
    """A file that satisfies all rules."""

    header: dict[str, Any]
    layers: list[GooLayer]

    @property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel on the plate."""
        header = self.header
        return header["x_size_mm"] / header["x_resolution"], header["y_size_mm"] / header["y_resolution"]

    @property
    def areas_mm2(self) -> NDArray[Any]:
        """Covered area of each layer."""
        width, height = self.pixel_mm
        return np.array([layer.lit_pixels for layer in self.layers]) * width * height

    def preview(self, name: str) -> NDArray[Any]:
        """Return red, green and blue of a preview, 0 to 1."""
        words = np.frombuffer(self.header[name], ">u2").reshape(PREVIEWS[name], -1)
        return np.stack([(words >> 11) / 31, (words >> 5 & 63) / 63, (words & 31) / 31], axis=-1)


def read_goo(path: str | Path) -> GooFile:
    """Read and check a file."""
    content = Path(path).read_bytes()
    header, offset = fields_of(content, 0, HEADER)
    check_header(header, offset)
    layers = []
    for index in range(header["total_layers"]):
        layer, offset = layer_at(content, offset, header, index)
        layers.append(layer)
    need(
        content[offset:] == ENDING,
        f"the last layer is followed by {content[offset:][:16].hex()}, not by the ending string",
    )
    stack = GooFile(header, layers)
    check_order(stack)
    return stack


def fields_of(content: bytes, offset: int, table: list[tuple[str, str]]) -> tuple[dict[str, Any], int]:
    layout = struct.Struct(">" + "".join(code for _, code in table))
    need(len(content) >= offset + layout.size, f"the file ends at byte {len(content)}, within a table at {offset}")
    fields = dict(zip((name for name, _ in table), layout.unpack_from(content, offset), strict=True))
    for name, value in fields.items():
        check_value(name, value)
    return fields, offset + layout.size


def check_value(name: str, value: Any) -> None:
    if name in FLAGS:
        need(value in (0, 1), f"{name} is {value}, neither 0 nor 1")
    if name.endswith("_pwm"):
        need(value <= 255, f"{name} is {value}, above 255")
    if name.endswith("_end"):
        need(value == DELIMITER, f"{name} is {value!r}")
    if name in POSITIVE:
        need(value > 0, f"{name} is {value}, not positive")
    if isinstance(value, float):
        need(math.isfinite(value) and value >= 0, f"{name} is {value}")
    if name in STRINGS:
        check_string(name, value)


def check_string(name: str, value: bytes) -> None:
    """Check that a string ends with a zero byte, as C code expects, and that only zeros follow."""
    string, zero, rest = value.partition(b"\0")
    need(bool(zero) and not any(rest), f"{name} is not terminated by zeros: {value!r}")
    need(string.decode("utf-8", "replace").isprintable() and string.isascii(), f"{name} is not text: {string!r}")


def check_header(header: dict[str, Any], size: int) -> None:
    need(header["version"] == b"V3.0", f"version is {header['version']!r}")
    need(header["magic"] == MAGIC, f"magic is {header['magic'].hex()}")
    need(
        header["layers_begin_at"] == size == 195477,
        f"layers begin at {header['layers_begin_at']}, not at {size}",
    )
    time = header["file_time"].rstrip(b"\0").decode()
    need(not time or bool(re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d", time)), f"file_time is {time!r}")
    need(
        header["total_layers"] * header["layer_thickness_mm"] <= header["z_size_mm"] * (1 + 1e-6),
        "higher than the printer",
    )
    for kind in ("bottom_", ""):
        check_motion(kind or "common ", {name: header[kind + name] for name in REPEATED})


def check_motion(which: str, motion: dict[str, Any]) -> None:
    """Check that each motion has a speed, and that the plate returns to its position."""
    for name in ("lift", "second_lift", "retract", "second_retract"):
        need(motion[f"{name}_mm"] == 0 or motion[f"{name}_mm_per_min"] > 0, f"{which}{name} has no speed")
    up, down = (motion[f"{name}_mm"] + motion[f"second_{name}_mm"] for name in ("lift", "retract"))
    need(math.isclose(up, down, rel_tol=1e-6), f"{which}lifts {up} mm and retracts {down} mm")


def layer_at(content: bytes, offset: int, header: dict[str, Any], index: int) -> tuple[GooLayer, int]:
    fields, offset = fields_of(content, offset, LAYER)
    check_motion(f"layer {index}: ", fields)
    data = content[offset : offset + fields["data_size"]]
    need(len(data) == fields["data_size"] >= 2, f"layer {index} has {len(data)} of {fields['data_size']} bytes")
    offset += len(data)
    need(content[offset : offset + 2] == DELIMITER, f"layer {index} does not end with the delimiter")
    need(data[0] == 0x55, f"layer {index} begins with {data[0]:#04x}")
    need(data[-1] == 0xFF & ~sum(data[1:-1]), f"layer {index} does not have the checksum {data[-1]:#04x}")
    top = 0xFF if header["grey_scale_level"] else 0xF
    return GooLayer(fields, data[1:-1], (header["y_resolution"], header["x_resolution"]), top), offset + 2


@lru_cache(maxsize=8)
def decoded(data: bytes, pixels: int, top: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return grey levels and lengths of the runs of a layer, which must cover every pixel once."""
    greys: list[int] = []
    lengths: list[int] = []
    offset = 0
    while offset < len(data):
        try:
            grey, length, offset = chunk(data, offset, greys[-1] if greys else None)
        except IndexError:
            raise RuleError(f"the chunk at byte {offset} ends after the data") from None
        need(length > 0, f"the chunk that ends at byte {offset} has no length")
        need(0 <= grey <= top, f"the chunk that ends at byte {offset} has the grey level {grey}")
        greys.append(grey)
        lengths.append(length)
    need(sum(lengths) == pixels, f"the runs cover {sum(lengths)} of {pixels} pixels")
    return np.array(greys, np.uint8), np.array(lengths, np.int64)


def chunk(data: bytes, offset: int, before: int | None) -> tuple[int, int, int]:
    """Return grey level and length of the chunk at `offset`, and the start of the next one."""
    head = data[offset]
    kind, flags, low = head >> 6, head >> 4 & 3, head & 15
    offset += 1
    if kind == 2:
        if before is None:
            raise RuleError("a difference without a preceding pixel")
        grey = before - low if flags & 2 else before + low
        return (grey, data[offset], offset + 1) if flags & 1 else (grey, 1, offset)
    grey = 0xFF if kind == 3 else 0
    if kind == 1:
        grey = data[offset]
        offset += 1
        need(0 < grey < 0xFF, f"a chunk of grey has the level {grey:#04x}")
    length = 0
    for _ in range(flags):
        length = length << 8 | data[offset]
        offset += 1
    return grey, length << 4 | low, offset


def check_order(stack: GooFile) -> None:
    """Check that heights ascend and, unless the advance mode is on, that the layers repeat the values of the header."""
    header, heights = stack.header, [layer.fields["position_mm"] for layer in stack.layers]
    need(heights == sorted(heights), "the layers are not in ascending order")
    need(heights[-1] <= header["z_size_mm"] * (1 + 1e-6), f"a layer is at {heights[-1]} mm, above the printer")
    for index, layer in enumerate(stack.layers if not header["advance_mode"] else []):
        height = header["layer_thickness_mm"] * (index + 1)
        need(math.isclose(heights[index], height, rel_tol=1e-5), f"layer {index} is at {heights[index]}, not {height}")
        check_repeated(layer.fields, header, index)


def check_repeated(layer: dict[str, Any], header: dict[str, Any], index: int) -> None:
    if header["bottom_layers"] <= index < header["bottom_layers"] + header["transition_layers"]:
        ends = sorted([header["bottom_exposure_s"], header["exposure_s"]])
        need(ends[0] <= layer["exposure_s"] <= ends[1], f"transition layer {index} has {layer['exposure_s']} s")
        return
    kind = "bottom_" if index < header["bottom_layers"] else ""
    for name in REPEATED:
        need(layer[name] == header[kind + name], f"layer {index}: {name} {layer[name]}, header {header[kind + name]}")
    need(layer["turn_off_s"] == header["turn_off_s"], f"layer {index}: turn_off_s is {layer['turn_off_s']}")
