"""Traced points of sweeps, kept in a folder as they come, so that none is ever traced twice.

A point is named by a digest of its design, the files that the design names, the tolerance, and the code and data of
solen and of packages that extend it. Points are written in blocks; a block is named by its points and renamed into
place, so that a program killed at any moment leaves whole blocks only, and the same command goes on from there to the
same table.

The interface: `Store` of a folder; `Variant`, which names a point.
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
from solen.registry import BODY_KINDS, FINISHES, offered
from solen.sensor import Response, Sensor
from solen.sensor.effects import as_built
from solen.spec import Design, dumps

BLOCKS = "blocks"
"""Folder of the blocks within that of the sweep."""
MOST_BLOCKS = 256
"""Blocks above which opening a folder makes one of all: a search writes many small ones."""
OF_DESIGNS = (BODY_KINDS, FINISHES)
"""Groups of entry points whose code a response depends on."""
SUFFIXES = (".py", ".toml", ".csv")


@dataclass(frozen=True, eq=False)
class Point:
    """Response of one design.

    Attributes
    ----------
    power, u_power
        (A, C) powers and their uncertainties at A angles or states, of the right and the left receiver, or of a network
        of each emitter's receivers in turn; empty where the design cannot be built or traced.
    sd_deg
        (K, 2) standard deviation of an angle from one reading and its uncertainty: where it is worst, or of a network
        of each motion.
    why
        Why there is no response, or why its tolerance was not reached; empty otherwise.
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
        """What is equal for equal responses."""
        return (self.power.tobytes(), self.sd_deg.tobytes())

    def response(self, angle_deg: FloatArray) -> Response:
        """The same as a response of two receivers."""
        right, left = self.power.T
        return Response("power", angle_deg, right, left, self.u_power.max(axis=1), ())


def no_response(why: SolenError) -> Point:
    """Point of a design that cannot be built or traced."""
    nothing = np.empty((0, 2))
    return Point(nothing, nothing, nothing, str(why))


class Store:
    """Points in memory, and in a folder where one is named."""

    def __init__(self, folder: Path | None = None) -> None:
        """Read what the folder holds; `DataError` where a block is damaged."""
        self.folder = None if folder is None else folder / BLOCKS
        self.points: dict[str, Point] = {}
        blocks = [] if self.folder is None else sorted(self.folder.glob("*.npz"))
        for path in blocks:
            self.points |= _read(path)
        if len(blocks) > MOST_BLOCKS:
            kept = self.add(dict(self.points))
            for path in blocks:
                if path != kept:
                    files.remove(path)

    def add(self, points: Mapping[str, Point]) -> Path | None:
        """Keep points, as one block on disk if one of them has a response, and return that."""
        self.points |= points
        if self.folder is None or not any(point.is_traced for point in points.values()):
            return None
        with files.output_folder(self.folder):
            name = hashlib.sha256("".join(points).encode()).hexdigest()[:32]
            return files.write_bytes(self.folder / f"{name}.npz", _block(points))


class Accuracy(NamedTuple):
    """How closely responses are traced: integrated to a tolerance, or by so many rays of the compiled batch.

    Powers of a network are sampled, by the lattice of that number.
    """

    tolerance: float | None = None
    rays: int | None = None
    lattice: int = 0


Chip = tuple[float, float]
"""Width and decentre of an emitter, in mm."""


@dataclass(frozen=True)
class Variant:
    """A design to be traced, how far the built part is off some of its numbers, by their keys, and what prints it.

    With a process it has the lens that this prints, else the designed one. ``chips`` are widths and decentres of its
    emitter that share the rays of the compiled batch with its own; none share them by default.
    """

    design: Design
    off: Mapping[str, float] = field(default_factory=dict)
    printed_by: Settings | None = None
    chips: tuple[Chip, ...] = ()

    def name(self, accuracy: Accuracy) -> str:
        """Name of its response: equal for equal inputs, different for any other."""
        design = self.design.set(name="point")
        process = None if self.printed_by is None else self.printed_by.model_dump(mode="json")
        stated: list[Any] = [engine(), dumps(design), self.files, sorted(self.off.items()), accuracy, process]
        stated += [self.chips] if self.chips else []
        return hashlib.sha256(json.dumps(stated).encode()).hexdigest()

    def shared_name(self, accuracy: Accuracy) -> str:
        """Name that all variants have whose chips are traced with the same rays."""
        width_mm, offset_mm = self.chips[0]
        first = self.design.set({"emitter.width_mm": width_mm, "emitter.offset_mm": offset_mm})
        return replace(self, design=first).name(accuracy)

    @property
    def files(self) -> dict[str, str]:
        """Digests of the files that the design names, by key."""
        return {key: hashlib.sha256(bytes_of(path)).hexdigest() for key, path in sorted(self.design.files.items())}

    def sensor(self) -> Sensor:
        """The sensor as built."""
        built = as_built(Sensor.of(self.design), self.off)
        return built if self.printed_by is None else as_printed(built, self.printed_by)


def bytes_of(path: Path) -> bytes:
    """Content of a file that a design names; `DataError` where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror or bad}", remedy="check the path") from None


@cache
def engine() -> str:
    """Digest of solen's version, code and data, and of those of packages that add bodies or finishes."""
    digest = hashlib.sha256(solen.__version__.encode())
    modules = {entry.module.partition(".")[0] for group in OF_DESIGNS for entry in offered(group).values()}
    for module in ("solen", *sorted(modules)):
        for name, path in _sources(module):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources(module: str) -> list[tuple[str, Path]]:
    """Code and data of a package by their names within it, or of a module in one file."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return []
    path = Path(spec.origin)
    if not spec.submodule_search_locations:
        return [(path.name, path)]
    found = sorted(path for path in path.parent.rglob("*") if path.suffix in SUFFIXES)
    return [(each.relative_to(path.parent).as_posix(), each) for each in found]


def _block(points: Mapping[str, Point]) -> bytes:
    """Bytes of a block: arrays of points one after the other, and the shape of each."""
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
                return {}  # of an earlier solen, whose points are no longer asked for
            shapes = block["shape"]
            powers = np.split(block["power"], np.cumsum(shapes[:, 0] * shapes[:, 1])[:-1])
            sds = np.split(block["sd_deg"], np.cumsum(shapes[:, 2])[:-1])
            rows = zip(block["name"], shapes[:, :2].tolist(), powers, sds, block["why"], strict=True)
            return {
                str(name): Point(power[:, 0].reshape(shape), power[:, 1].reshape(shape), sd, str(why))
                for name, shape, power, sd, why in rows
            }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as bad:
        raise DataError(str(path), limit=f"is not a whole block of a sweep: {bad}", remedy="remove it") from None
