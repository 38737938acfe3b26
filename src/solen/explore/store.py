"""Traced points of sweeps, stored in a folder as they are traced, so that none is traced twice.

The name of a point is a digest of its design, the files named by the design, the accuracy, and the code and data of
solen and of packages that extend it. Points are written in blocks. A block is named after its points, written under a
temporary name and renamed. A program that is killed at any moment therefore leaves only complete blocks; if the command
is run again, it continues from them and gives the same table.

Public names: `Store` and `Variant`.
"""

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import solen
from solen import files
from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.explore.printed_lens import as_printed
from solen.fabricate.process import Settings
from solen.registry import BODY_KINDS, FINISHES, plugin_entries
from solen.sensor import Response, Sensor
from solen.sensor.effects import with_deviations
from solen.spec import Design, dumps

BLOCKS = "blocks"
"""Name of the folder of blocks in the folder of a sweep."""
MAX_BLOCKS = 256
"""Number of blocks above which they are merged when a folder is opened, since a search writes many small ones."""
EXTENSION_GROUPS = (BODY_KINDS, FINISHES)
"""Groups of entry points whose code affects a response."""
HASHED_SUFFIXES = (".py", ".toml", ".csv")


@dataclass(frozen=True, eq=False)
class Point:
    """Response of one design.

    Attributes
    ----------
    power, u_power
        (A, C) powers and their uncertainties at A angles or states: those of the right and the left receiver or, for a
        network, those of all receivers for the first emitter, then for the next; empty if the design cannot be built
        or traced.
    sd_deg
        (K, 2) standard deviation of an angle determined from one reading, and its uncertainty: the worst one over the
        motion or, for a network, that of each motion.
    why
        Reason why there is no response or the tolerance was not reached; otherwise empty.
    """

    power: FloatArray
    u_power: FloatArray
    sd_deg: FloatArray
    why: str = ""

    @property
    def is_traced(self) -> bool:
        """Whether there is a response."""
        return bool(self.power.size)

    @property
    def content(self) -> tuple[bytes, ...]:
        """Arrays of the response as bytes, equal for equal responses."""
        return (self.power.tobytes(), self.sd_deg.tobytes())

    def response(self, angle_deg: FloatArray) -> Response:
        """Return the response of two receivers."""
        right, left = self.power.T
        return Response("power", angle_deg, right, left, self.u_power.max(axis=1), ())


def no_response(why: SolenError) -> Point:
    """Return the point of a design that cannot be built or traced."""
    empty = np.empty((0, 2))
    return Point(empty, empty, empty, str(why))


class Store:
    """Points in memory and, if a folder is specified, on disk."""

    def __init__(self, folder: Path | None = None) -> None:
        """Read the blocks in the folder; raise `DataError` if a block is damaged."""
        self.folder = None if folder is None else folder / BLOCKS
        self.points: dict[str, Point] = {}
        blocks = [] if self.folder is None else sorted(self.folder.glob("*.npz"))
        for path in blocks:
            self.points |= _read(path)
        if len(blocks) > MAX_BLOCKS:
            merged = self.add(dict(self.points))
            for path in blocks:
                if path != merged:
                    files.remove(path)

    def add(self, points: Mapping[str, Point]) -> Path | None:
        """Store points, as one block on disk if any of them has a response, and return the path of the block."""
        self.points |= points
        if self.folder is None or not any(point.is_traced for point in points.values()):
            return None
        with files.output_folder(self.folder):
            name = hashlib.sha256("".join(points).encode()).hexdigest()[:32]
            return files.write_bytes(self.folder / f"{name}.npz", _block(points))


class Accuracy(NamedTuple):
    """Accuracy of tracing: integration to a tolerance, or a number of rays of the compiled batch.

    A network is sampled with the randomised lattice of index ``lattice``.
    """

    tolerance: float | None = None
    rays: int | None = None
    lattice: int = 0


Chip = tuple[float, float]
"""Width and decentre of an emitter, in mm."""


@dataclass(frozen=True)
class Variant:
    """A design to be traced, the deviations of the built part from it, keyed by parameter, and the printing process.

    With a process, the sensor has the printed lens, otherwise the designed one. ``chips`` are the widths and decentres
    of all emitters, including this one, that share the rays of the compiled batch; empty if rays are not shared.
    """

    design: Design
    deviations: Mapping[str, float] = field(default_factory=dict)
    printed_by: Settings | None = None
    chips: tuple[Chip, ...] = ()

    def name(self, accuracy: Accuracy) -> str:
        """Return the name under which its response is stored: a hash of everything that affects the response."""
        design = self.design.set(name="point")
        process = None if self.printed_by is None else self.printed_by.model_dump(mode="json")
        deviations = sorted(self.deviations.items())
        inputs: list[Any] = [code_digest(), dumps(design), self.files, deviations, accuracy, process]
        inputs += [self.chips] if self.chips else []
        return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()

    def shared_name(self, accuracy: Accuracy) -> str:
        """Return the name common to all variants whose chips are traced with the same rays."""
        width_mm, offset_mm = self.chips[0]
        first = self.design.set({"emitter.width_mm": width_mm, "emitter.offset_mm": offset_mm})
        return replace(self, design=first).name(accuracy)

    @property
    def files(self) -> dict[str, str]:
        """Digests of the files that the design names, keyed by design key."""
        return {key: hashlib.sha256(file_bytes(path)).hexdigest() for key, path in sorted(self.design.files.items())}

    def sensor(self) -> Sensor:
        """Return the sensor as built."""
        built = with_deviations(Sensor.of(self.design), self.deviations)
        return built if self.printed_by is None else as_printed(built, self.printed_by)


def file_bytes(path: Path) -> bytes:
    """Return the content of a file named by a design; raise `DataError` if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        limit = f"cannot be read: {error.strerror or error}"
        raise DataError(str(path), limit=limit, remedy="check the path") from None


@cache
def code_digest() -> str:
    """Return a digest of the version, code and data of solen and of packages that add bodies or finishes."""
    digest = hashlib.sha256(solen.__version__.encode())
    modules = {entry.module.partition(".")[0] for group in EXTENSION_GROUPS for entry in plugin_entries(group).values()}
    for module in ("solen", *sorted(modules)):
        for name, path in _sources(module):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources(module: str) -> list[tuple[str, Path]]:
    """Return the names and paths of the code and data files of a package or of a single-file module."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return []
    path = Path(spec.origin)
    if not spec.submodule_search_locations:
        return [(path.name, path)]
    sources = sorted(source for source in path.parent.rglob("*") if source.suffix in HASHED_SUFFIXES)
    return [(source.relative_to(path.parent).as_posix(), source) for source in sources]


def _block(points: Mapping[str, Point]) -> bytes:
    """Return the bytes of a block: the arrays of all points in order, and the shape of each."""
    values = list(points.values())
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        name=np.array(list(points)),
        shape=np.array([(*point.power.shape, len(point.sd_deg)) for point in values]),
        power=np.concatenate([np.stack([point.power, point.u_power], axis=-1).reshape(-1, 2) for point in values]),
        sd_deg=np.concatenate([point.sd_deg for point in values]),
        why=np.array([point.why for point in values]),
    )
    return buffer.getvalue()


def _read(path: Path) -> dict[str, Point]:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as block:
            if "shape" not in block:
                return {}  # written by an earlier version of solen, whose points are not used
            shapes = block["shape"]
            powers = np.split(block["power"], np.cumsum(shapes[:, 0] * shapes[:, 1])[:-1])
            sds = np.split(block["sd_deg"], np.cumsum(shapes[:, 2])[:-1])
            rows = zip(block["name"], shapes[:, :2].tolist(), powers, sds, block["why"], strict=True)
            return {
                str(name): Point(power[:, 0].reshape(shape), power[:, 1].reshape(shape), sd, str(why))
                for name, shape, power, sd, why in rows
            }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DataError(str(path), limit=f"is not a complete block of a sweep: {error}", remedy="remove it") from None
