"""A layered lens with profiles from a file, predicted by a print model or drawn for printing.

The file is JSON from `layers_text`: heights of the boundaries between layers, and the depth z of each layer at
equidistant points from the axis to the half width. Profiles are symmetric about the axis.

Public names: `GivenLayers`, `Profiles`, `read_layers` and `layers_text`.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.files import read_text
from solen.lens.layered import MAX_LAYERS, LayeredLens
from solen.results import HIDDEN, reported
from solen.spec.objects import build, parse_json
from solen.spec.strict import error_context

KIND, SCHEMA = "layers of a lens", 1
MIN_PLACES, MAX_PLACES = 9, 4001
DIGITS = 9
CLOSE_MM = 1e-6
"""Tolerance of the half width and thickness in a file relative to the design."""


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles of layers.

    Attributes
    ----------
    name
        Name of the lens.
    half_width_mm
        Half the width of the aperture.
    edges_mm
        Heights y (L + 1,) of the boundaries between layers, from mid-height of the body, ascending.
    z_mm
        Depth (L, M) of each layer at M equidistant points from the axis to the half width.
    simulated
        Whether the profiles were computed rather than measured.
    warnings
        Warnings about the profiles.
    """

    name: str
    half_width_mm: float
    edges_mm: FloatArray
    z_mm: FloatArray
    simulated: bool
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        layers, places = self.z_mm.shape if self.z_mm.ndim == 2 else (0, 0)
        if self.edges_mm.shape != (layers + 1,) or not 1 <= layers <= MAX_LAYERS:
            limit = f"must be 2 to {MAX_LAYERS + 1} heights, one more than the rows of z_mm"
            raise DataError("edges_mm", value=f"{self.edges_mm.size} heights and {layers} rows", limit=limit)
        if not MIN_PLACES <= places <= MAX_PLACES:
            raise DataError("z_mm", value=f"{places} places", limit=f"must be {MIN_PLACES} to {MAX_PLACES} in a row")
        if not np.all(np.diff(self.edges_mm) > 0.0):
            raise DataError("edges_mm", limit="must ascend")


class GivenLayers(LayeredLens, eq=True):
    """A layered lens with profiles from a file."""

    shape_name: ClassVar[str] = "layered"

    given: Profiles = field(kw_only=True, metadata=HIDDEN)

    def __post_init__(self) -> None:
        wanted, found = (self.half_width_mm, self.thickness_mm), (self.given.half_width_mm, self._height_mm)
        for key, own, its in zip(("lens.half_width_mm", "body.thickness_mm"), wanted, found, strict=True):
            if abs(own - its) > CLOSE_MM:
                raise DataError(f"lens.profile: {self.given.name}", value=f"{its:g} mm", limit=f"{key} is {own:g} mm")
        super().__post_init__()

    @property
    def _height_mm(self) -> float:
        return float(np.ptp(self.given.edges_mm))

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`solen.lens.base.Lens.warnings`."""
        return self.given.warnings

    @reported
    def simulated(self) -> bool:
        """Whether its profiles were computed by a print model."""
        return self.given.simulated

    @cached_property
    def edges_mm(self) -> FloatArray:
        """Heights of the boundaries between layers, ascending, (L + 1,)."""
        return self.given.edges_mm

    @cached_property
    def profiles(self) -> tuple[FloatArray, FloatArray]:
        """Depth and slope (L, M) of every layer; the slopes are from cubic splines with slope 0 on the axis."""
        from scipy.interpolate import CubicSpline  # slow to import, and not required by other lenses

        x = np.linspace(0.0, self.half_width_mm, self.given.z_mm.shape[1])
        spline = CubicSpline(x, self.given.z_mm, axis=1, bc_type=((1, np.zeros(len(self.given.z_mm))), "not-a-knot"))
        return self.given.z_mm, np.asarray(spline(x, 1))

    @cached_property
    def checked(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :attr:`solen.lens.in_space.LensInSpace.checked`: all layers, as they may differ above and below."""
        x, y = np.meshgrid(np.linspace(0.0, self.half_width_mm, self.given.z_mm.shape[1]), self.middles_mm)
        return x, y, self.given.z_mm


@dataclass(frozen=True)
class _LayersFile:
    """Content of a layers file, except its kind and schema."""

    half_width_mm: float
    edges_mm: tuple[float, ...]
    z_mm: tuple[tuple[float, ...], ...]
    simulated: bool
    name: str = ""
    warnings: tuple[str, ...] = ()


def read_layers(path: Path) -> Profiles:
    """Return the profiles in a file; raise `DataError` if it cannot be read or contains no profiles."""
    data = parse_json(read_text(path, DataError), str(path))
    if not isinstance(data, dict) or data.pop("solen", None) != KIND:
        limit = f'does not contain the layers of a lens: it has no "solen": "{KIND}"'
        raise DataError(str(path), limit=limit, remedy="write one with solen print predict --out")
    if (schema := data.pop("schema", None)) != SCHEMA:
        raise DataError(f"{path}: schema", value=schema, limit=f"this version of solen reads {SCHEMA}")
    found = build(_LayersFile, data, str(path))
    with error_context(str(path)):
        z = _table(found.z_mm)
        return Profiles(
            found.name or path.stem, found.half_width_mm, np.array(found.edges_mm), z, found.simulated, found.warnings
        )


def layers_text(profiles: Profiles) -> str:
    """Return profiles as JSON text, rounded to `DIGITS` decimal places of a mm."""
    rows = [json.dumps(row) for row in np.round(profiles.z_mm, DIGITS).tolist()]
    head: dict[str, Any] = {
        "solen": KIND,
        "schema": SCHEMA,
        "name": profiles.name,
        "simulated": profiles.simulated,
        "warnings": list(profiles.warnings),
        "half_width_mm": profiles.half_width_mm,
        "edges_mm": np.round(profiles.edges_mm, DIGITS).tolist(),
    }
    text = json.dumps(head, indent=1, allow_nan=False)
    return text[: text.rindex("\n}")] + ',\n "z_mm": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"


def _table(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Check that the values are finite numbers and return them as an array (L, M)."""
    if len({len(row) for row in rows}) != 1:
        raise DataError("z_mm", limit="must be rows of equal length")
    table = np.array(rows, dtype=float)
    if not np.isfinite(table).all():
        raise DataError("z_mm", limit="must be finite numbers")
    return table
