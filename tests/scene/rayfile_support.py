"""Writers of ray files, based on the specifications of both formats and independent of the reader."""

import struct
from pathlib import Path

import numpy as np

from solen.arrays import FloatArray


def zemax(
    path: Path,
    rays: FloatArray,
    *,
    unit: int = 4,
    kind: int = 0,
    flux: int = 0,
    wavelength_um: float = 0.85,
) -> Path:
    """Binary Zemax source file of rays (N, 7), or (N, 8) with wavelengths in µm for ``kind`` 2."""
    head = struct.pack("<iI", 1010, len(rays)) + b"a source".ljust(100, b"\0")
    head += struct.pack("<7f", 1.0, 1.0, wavelength_um, 0.0, 90.0, 0.0, 360.0)
    head += struct.pack("<I9f", unit, *(0.0,) * 6, 1.0, 1.0, 1.0) + struct.pack("<4f", 0, 0, 0, 0)
    head += struct.pack("<4i", kind, flux, 0, 0)
    assert len(head) == 208
    path.write_bytes(head + rays.astype("<f4").tobytes())
    return path


def tm25(
    path: Path,
    rays: FloatArray,
    *,
    spectral: int = 1,
    wavelength_nm: float = 850.0,
    flags: tuple[int, ...] = (1, 1, 1, 0, 0, 0, 0, 0),
    table: tuple[tuple[float, float], ...] = (),
    text: bytes = b"",
) -> Path:
    """TM-25 file of rays with the columns that the flags specify."""
    head = b"TM25" + struct.pack("<iiff", 2013, 0, float("nan"), 1.0) + struct.pack("<Q", len(rays))
    head += b"2020-01-01T00:00:00+00:00".ljust(28, b"\0")
    head += struct.pack("<iifff", 0, spectral, wavelength_nm, 400.0, 900.0)
    head += struct.pack("<iii", 1 if table else 0, 0, len(text)) + bytes(168)
    assert len(head) == 256
    head += struct.pack("<8i", *flags) + bytes(36_000)
    if table:
        block = struct.pack("<i", len(table)) + np.array(table, "<f4").tobytes()
        head += block + bytes(-len(block) % 32)
    path.write_bytes(head + text + rays.astype("<f4").tobytes())
    return path


def lambertian(count: int, size_mm: float = 0.2, seed: int = 5) -> FloatArray:
    """Rays (N, 7) of a Lambertian square about +z: x, y, z in mm, direction, flux."""
    u = np.random.default_rng(seed).random((count, 4))
    sine, phi = np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
    position = size_mm * (u[:, 2:] - 0.5)
    direction = np.column_stack([sine * np.cos(phi), sine * np.sin(phi), np.sqrt(1.0 - u[:, 0])])
    return np.column_stack([position, np.zeros(count), direction, np.full(count, 1.0 / count)])
