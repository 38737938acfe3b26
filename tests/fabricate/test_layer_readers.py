"""The readers of layer_bytes files read files composed by hand from the specifications, and refuse any violation."""

import struct
import zlib
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest

from tests.fabricate.goo_reader import DELIMITER, ENDING, HEADER, LAYER, MAGIC, RuleError, chunk, decoded, read_goo
from tests.fabricate.zip_reader import SIGNATURE, read_png, read_zip

OFFSETS = {
    "magic": 4,
    "small_preview_end": 194 + 2 * 116**2,
    "big_preview_end": 196 + 2 * 116**2 + 2 * 290**2,
    "total_layers": 195310,
    "bottom_layers": 195373,
    "light_pwm": 195443,
    "layers_begin_at": 195470,
}
"""Offsets of some fields, counted by hand in the table of the manufacturer."""

VALUES = {
    "version": b"V3.0",
    "magic": MAGIC,
    "price_unit": b"$",
    "small_preview": b"\x07\xe0",
    "total_layers": 2,
    "small_preview_end": DELIMITER,
    "big_preview_end": DELIMITER,
    "layers_begin_at": 195477,
    "grey_scale_level": 1,
    "x_resolution": 40,
    "y_resolution": 2,
    "x_size_mm": 4,
    "y_size_mm": 0.4,
    "z_size_mm": 9,
    "bottom_layers": 1,
    "layer_thickness_mm": 0.25,
    "exposure_s": 2,
    "bottom_exposure_s": 3,
    "exposure_delay_mode": 1,
    "bottom_lift_mm": 5,
    "bottom_lift_mm_per_min": 60,
    "bottom_retract_mm": 5,
    "bottom_retract_mm_per_min": 60,
}
RUNS = bytes([0b11_01_0101, 2, 0b01_00_0010, 0x80, 0b10_10_1111, 0b10_01_0001, 2, 0b00_01_0110, 2])
"""Two rows of 40 pixels: 37 white, two of 128, one of 113, two of 114, 38 black."""
LAYERS: list[dict[str, Any]] = [
    {
        "position_mm": 0.25,
        "exposure_s": 3,
        "lift_mm": 5,
        "lift_mm_per_min": 60,
        "retract_mm": 5,
        "retract_mm_per_min": 60,
    },
    {"position_mm": 0.5, "exposure_s": 2},
]


def pack(table: list[tuple[str, str]], values: dict[str, Any]) -> bytes:
    blank = {name: b"" if code.endswith("s") else 0 for name, code in table}
    return b"".join(struct.pack(f">{code}", values.get(name, blank[name])) for name, code in table)


def layer_bytes(values: dict[str, Any], runs: bytes = RUNS) -> bytes:
    data = b"\x55" + runs + bytes([0xFF & ~sum(runs)])
    return pack(LAYER, {"definition_end": DELIMITER, "data_size": len(data), **values}) + data + DELIMITER


def goo_file(folder: Path, header: dict[str, Any] | None = None, layers: list[dict[str, Any]] = LAYERS) -> Path:
    path = folder / "layers.goo"
    body = b"".join(layer_bytes(values) for values in layers)
    path.write_bytes(pack(HEADER, VALUES | (header or {})) + body + ENDING)
    return path


def test_reads_a_goo_file(tmp_path: Path) -> None:
    stack = read_goo(goo_file(tmp_path))
    image = stack.layers[0].image
    assert image.tolist() == [[255] * 37 + [128] * 2 + [113], [114] * 2 + [0] * 38]
    assert stack.pixel_mm == pytest.approx((0.1, 0.2))
    assert stack.areas_mm2 == pytest.approx([image.sum() / 255 * 0.02] * 2)
    assert stack.preview("small_preview")[0, 0].tolist() == [0, 1, 0]


@pytest.mark.parametrize("name", OFFSETS)
def test_offsets_of_header_fields(name: str) -> None:
    names = [field for field, _ in HEADER]
    codes = [code for _, code in HEADER[: names.index(name)]]
    assert struct.calcsize(">" + "".join(codes)) == OFFSETS[name]


@pytest.mark.parametrize(("data", "length"), [("c7", 7), ("d701", 23), ("e70102", 0x1027), ("f7010203", 0x102037)])
def test_run_lengths_of_one_to_four_bytes(data: str, length: int) -> None:
    assert chunk(bytes.fromhex(data), 0, None) == (255, length, len(data) // 2)


@pytest.mark.parametrize(
    "change",
    [
        *(
            {"version": b"V2.0"},
            {"magic": b"DLP"},
            {"small_preview_end": b"\n\r"},
            {"total_layers": 1},
            {"total_layers": 3},
        ),
        *({"x_resolution": 41}, {"z_size_mm": 0.4}, {"x_mirror": 2}, {"exposure_s": 0}, {"exposure_s": float("nan")}),
        *({"light_pwm": 256}, {"layers_begin_at": 195461}, {"software": b"a" * 32}, {"file_time": b"today"}),
        *({"bottom_layers": 2}, {"layer_thickness_mm": 0.3}, {"lift_mm": 5}, {"bottom_retract_mm": 4}),
        *({"bottom_light_pwm": 255}, {"grey_scale_level": 0}, {"before_lift_s": -1}),
    ],
    ids=str,
)
def test_refuses_an_invalid_header(tmp_path: Path, change: dict[str, Any]) -> None:
    with pytest.raises(RuleError):
        read_goo(goo_file(tmp_path, change)).areas_mm2  # noqa: B018 - the runs are read on demand


@pytest.mark.parametrize(
    "change",
    [
        *({"position_mm": 0.4}, {"exposure_s": 2.5}, {"definition_end": b"\0\0"}, {"data_size": 4}, {"data_size": 1}),
        *({"pause_flag": 2}, {"light_pwm": 999}, {"retract_mm": 4}, {"second_lift_mm": 1}),
    ],
    ids=str,
)
def test_refuses_an_invalid_layer(tmp_path: Path, change: dict[str, Any]) -> None:
    with pytest.raises(RuleError):
        read_goo(goo_file(tmp_path, layers=[LAYERS[0] | change, LAYERS[1]]))


@pytest.mark.parametrize(
    "runs",
    ["", "df", "df04", "df0400", "df04c2", "8f", "c041", "4200df04", "42ffdf04", "c15fbfdf04", "40df04df04", "cf4180"],
)
def test_refuses_invalid_runs(runs: str) -> None:
    with pytest.raises(RuleError):
        decoded(bytes.fromhex(runs), 80, 255)


@pytest.mark.parametrize("offset", [195477 + 70, -20, -12, -1])
def test_refuses_a_changed_byte(tmp_path: Path, offset: int) -> None:
    path = goo_file(tmp_path)
    content = bytearray(path.read_bytes())
    content[offset] ^= 1
    path.write_bytes(content)
    with pytest.raises(RuleError):
        read_goo(path)


def png_chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")


def png(rows: list[list[int]], depth: int = 8, colour: int = 0) -> bytes:
    head = struct.pack(">IIBBBBB", len(rows[0]) - 1, len(rows), depth, colour, 0, 0, 0)
    data = zlib.compress(b"".join(map(bytes, rows)))
    return SIGNATURE + png_chunk(b"IHDR", head) + png_chunk(b"IDAT", data) + png_chunk(b"IEND", b"")


def test_reads_png_rows_of_all_filters() -> None:
    rows = [[0, 9, 8, 250], [1, 9, 255, 242], [2, 0, 0, 0], [3, 5, 0, 121], [4, 0, 0, 0]]
    assert read_png(png(rows)).image.tolist() == [[9, 8, 250]] * 5


MANIFEST = {
    "LayerHeight": "0.025",
    "ResolutionX": "3",
    "ResolutionY": "1",
    "DisplayWidth": "0.3",
    "DisplayHeight": "0.1",
}


def archive(
    folder: Path,
    manifest: dict[str, str] | None = None,
    names: tuple[str, ...] = ("1.png", "2.png", "manifest.uvtools"),
    image: bytes = b"",
) -> Path:
    path, values = folder / "layers.zip", MANIFEST | {"MachineZ": "9"} | (manifest or {})
    xml = "".join(f"<{name}>{value}</{name}>" for name, value in values.items())
    with ZipFile(path, "w") as zipped:
        for name in names:
            zipped.writestr(
                name, image or png([[0, 255, 51, 0]]) if name.endswith("png") else f"<Manifest>{xml}</Manifest>"
            )
    return path


def test_reads_an_archive(tmp_path: Path) -> None:
    assert read_zip(archive(tmp_path)).areas_mm2 == pytest.approx([0.012, 0.012])


@pytest.mark.parametrize(
    "change",
    [
        *(
            {"manifest": {"ResolutionX": "4"}},
            {"manifest": {"LayerHeight": "0,025"}},
            {"manifest": {"MachineZ": "0.04"}},
        ),
        *({"manifest": {"Resolution": "4"}}, {"names": ("1.png", "3.png", "manifest.uvtools")}, {"names": ("1.png",)}),
        *({"names": ("0.png", "1.png", "manifest.uvtools")}, {"names": ("1.png", "a/2.png", "manifest.uvtools")}),
        *({"names": ("run.gcode", "1.png", "manifest.uvtools")}, {"names": ("manifest.uvtools",)}),
        *({"image": png([[0, 1, 2, 3]], depth=16)}, {"image": png([[0, 1, 2, 3]], colour=3)}),
        *({"image": png([[5, 1, 2, 3]])}, {"image": png([[0, 1, 2]])}, {"image": png([[0, 1, 2, 3]])[:-13]}),
    ],
    ids=lambda change: str(change)[:60],
)
def test_refuses_an_invalid_archive(tmp_path: Path, change: dict[str, Any]) -> None:
    with pytest.raises(RuleError):
        read_zip(archive(tmp_path, **change)).areas_mm2  # noqa: B018 - the images are read on demand
