"""Stack of layers as a ``.goo`` file of version 3.0, the open format of Elegoo printers.

The format (github.com/elegooofficial/GOO) uses big-endian numbers. A header of 195,477 bytes contains the printer, the
exposures of the bottom layers and of the other layers, and the moves of the plate. Each layer has 70 bytes of the same
data, followed by its run-length encoded grey levels and a checksum. An end mark closes the file. A printer uses only
the header unless the header enables the settings of individual layers ("advance mode"). Printers were reported to stop,
or to begin too high, in that mode (github.com/sn4k3/UVtools, issues 997 and 1040). Burn-in is therefore written as the
bottom layers of the header, and exposures of individual images are written only for printers whose file cites evidence
that the printer uses them.

The file contains no date, so that the same part always gives the same bytes.
"""

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from solen import __version__
from solen.errors import SpecError
from solen.fabricate.layers.archive import Stack, StackRecorder, Watch
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.printable import Printable
from solen.parts.printer import Lift

MAGIC = bytes([7, 0, 0, 0, 0x44, 0x4C, 0x50, 0])
END = b"\r\n"
SMALL, LARGE = 116, 290
"""Sizes of the two preview images in pixels."""
HEADER_BYTES = 195_477
FULL_LIGHT = 255
MAX_PIXELS = 2**16 - 1


def write_goo(target: Path, job: Job, part: Printable | None = None, watch: Watch = lambda _: None) -> Stack:
    """Write the layers of a job; the file names the resin of ``part``, and ``watch`` is called with each layer.

    Raises
    ------
    SpecError
        If the lift of the printer is unknown, the image is too large, or images have individual exposures without
        evidence that the printer uses them.
    """
    lift = lift_of(job)
    recorder = StackRecorder(job, watch)
    with target.open("wb") as file:
        file.write(_header(job, lift, part))
        for layer, runs in recorder.encoded_layers(encoded):
            _write_layer(file, layer, job, lift, runs)
        file.write(bytes(3) + MAGIC)
    return recorder.stack()


def lift_of(job: Job) -> Lift:
    """Return the lift of a job that can be written as a .goo file; raise the errors of `write_goo`."""
    printer = job.printer
    if printer.lift is None:
        limit = f"requires a lift, which the file of {printer.name} does not contain"
        remedy = "use --format zip, or add a [lift] table to the printer file"
        raise SpecError("--format", value="goo", limit=limit, remedy=remedy)
    if len(job.solid.exposures_s) > 1 and printer.layer_exposures is None:
        limit = f"requires evidence in the file of {printer.name} that the printer uses the exposure of each image"
        remedy = "use --format zip, or print each exposure separately"
        raise SpecError("--format", value="goo", limit=limit, remedy=remedy)
    if max(printer.shape) > MAX_PIXELS:
        limit = f"allows at most {MAX_PIXELS} pixels along a side"
        raise SpecError("--format", value="goo", limit=limit, remedy="use --format zip")
    return printer.lift


def encoded(image: NDArray[np.uint8]) -> bytes:
    """Return grey levels in run-length encoding.

    The first byte of a run contains its kind in two bits (0 dark, 1 grey, 3 full), the number of further length bytes
    in two bits, and the last four bits of the length. The grey level of a grey run follows, then the other bits of the
    length. A mark precedes all runs, and the complement of the sum of their bytes follows them.
    """
    flat = np.ascontiguousarray(image).ravel()
    starts = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1])
    lengths, grey = np.diff(np.append(starts, flat.size)), flat[starts]
    more = np.searchsorted([1 << 4, 1 << 12, 1 << 20], lengths, side="right")
    is_grey = (grey > 0) & (grey < FULL_LIGHT)
    offsets = np.concatenate([[0], np.cumsum(1 + is_grey + more)])
    data = np.zeros(offsets[-1], np.uint8)
    first = offsets[:-1]
    data[first] = np.where(is_grey, 1, np.where(grey == 0, 0, 3)) << 6 | more << 4 | lengths & 15
    data[first[is_grey] + 1] = grey[is_grey]
    for number in range(3):  # bytes of the length, most significant first
        chosen = more > number
        shift = 4 + 8 * (more[chosen] - 1 - number)
        data[first[chosen] + 1 + is_grey[chosen] + number] = lengths[chosen] >> shift & 255
    return b"\x55" + data.tobytes() + bytes([~int(data.sum(dtype=np.int64)) & 255])


def _write_layer(file: BinaryIO, layer: Layer, job: Job, lift: Lift, runs: bytes) -> None:
    bottom = layer.index < job.burn_in_layers
    height, speed, before, after = lift.moves(bottom=bottom)
    pause, pause_mm, light_off = 0, job.printer.build_height_mm.nominal, 0.0
    waits = (light_off, after, 0.0, before)
    moves = (height, speed, 0.0, 0.0, height, lift.retract_mm_per_min, 0.0, 0.0)
    file.write(struct.pack(">H15fH", pause, pause_mm, layer.to_mm, layer.exposure_s, *waits, *moves, FULL_LIGHT))
    file.write(END + struct.pack(">I", len(runs)) + runs + END)


def _header(job: Job, lift: Lift, part: Printable | None) -> bytes:
    (rows, columns), printer, slicing = job.printer.shape, job.printer, job.slicing
    resin = "" if part is None else part.resin_name
    (height, speed, before, after), (bottom_height, bottom_speed, bottom_before, bottom_after) = (
        lift.moves(bottom=bottom) for bottom in (False, True)
    )
    individual = len(job.solid.exposures_s) > 1
    data = b"V3.0" + MAGIC
    data += _text("solen", 32) + _text(__version__, 24) + bytes(24)
    data += _text(printer.name, 32) + _text("DLP", 32) + _text(resin, 32)
    data += struct.pack(">3H", 1 if slicing.no_anti_aliasing else 8, 0, 0)
    data += _preview(job, SMALL) + END + _preview(job, LARGE) + END
    data += struct.pack(">I2H2?", job.count, columns, rows, job.mirror == "x", job.mirror == "y")
    data += struct.pack(">3f2f", *printer.size_mm, job.layer_mm, (job.solid.exposures_s or (slicing.exposure_s,))[0])
    waits = (bottom_after, 0.0, bottom_before, after, 0.0, before)
    data += struct.pack(">B7f", 1, 0.0, *waits)
    data += struct.pack(">fI", slicing.burn_in_s, job.burn_in_layers)
    retract = lift.retract_mm_per_min
    data += struct.pack(">8f", bottom_height, bottom_speed, height, speed, bottom_height, retract, height, retract)
    data += bytes(32)  # no second lift and retraction
    data += struct.pack(">2H?I", FULL_LIGHT, FULL_LIGHT, individual, round(job.seconds or job.exposures_s))
    data += struct.pack(">3f", job.volume_mm3, 0.0, 0.0) + bytes(8)
    return data + struct.pack(">IBH", HEADER_BYTES, 1, 0)


def _preview(job: Job, side: int) -> bytes:
    """Return a preview of the middle layer of one copy, seen from above, as RGB with 5, 6 and 5 bits."""
    image, (x_pitch_mm, y_pitch_mm) = job.copy_of_layer(job.count // 2)[::-1], job.printer.pitches_mm
    rows, columns = image.shape
    positions_mm = (np.arange(side) + 0.5 - 0.5 * side) / side * max(rows * y_pitch_mm, columns * x_pitch_mm)
    row = np.floor(positions_mm / y_pitch_mm + 0.5 * rows).astype(int)
    column = np.floor(positions_mm / x_pitch_mm + 0.5 * columns).astype(int)
    inside = ((row >= 0) & (row < rows))[:, None] & (column >= 0) & (column < columns)
    sampled = image[np.clip(row, 0, rows - 1)[:, None], np.clip(column, 0, columns - 1)]
    grey = np.where(inside, sampled, 0).astype(np.uint16)
    return (grey >> 3 << 11 | grey >> 2 << 5 | grey >> 3).astype(">u2").tobytes()


def _text(text: str, length: int) -> bytes:
    """Return ASCII text of a fixed length, terminated by a zero."""
    return text.encode("ascii", "replace")[: length - 1].ljust(length, b"\0")
