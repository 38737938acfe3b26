"""A layered lens with profiles from a file, predicted by a print model or drawn for printing.

The file is JSON from `layers_text`: heights of the boundaries of layers, and the depth z of each layer at uniformly
spaced points from the axis to the half width. Profiles are symmetric about the axis.

Public names: `LayeredLensFromFile`, `LayerProfiles`, `read_layers` and `layers_text`.
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
MIN_SAMPLES, MAX_SAMPLES = 9, 4001
DIGITS = 9
SIZE_TOLERANCE_MM = 1e-6
"""Largest difference between the half width and thickness in a file and those of the design."""


@dataclass(frozen=True, eq=False)
class LayerProfiles:
    """Profiles of the layers of a lens.

    Attributes
    ----------
    name
        Name of the lens.
    half_width_mm
        Half the width of the aperture.
    edges_mm
        Heights y (L + 1,) of the boundaries of the layers, from mid-height of the body, in ascending order.
    z_mm
        Depth (L, M) of each layer at M uniformly spaced points from the axis to the half width.
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
        layers, samples = self.z_mm.shape if self.z_mm.ndim == 2 else (0, 0)
        if not 1 <= layers <= MAX_LAYERS:
            raise DataError("number of rows of z_mm", value=layers, limit=f"must be 1 to {MAX_LAYERS}")
        if self.edges_mm.shape != (layers + 1,):
            limit = f"must be {layers + 1}, one more than the {layers} rows of z_mm"
            raise DataError("length of edges_mm", value=self.edges_mm.size, limit=limit)
        if not MIN_SAMPLES <= samples <= MAX_SAMPLES:
            raise DataError("length of a row of z_mm", value=samples, limit=f"must be {MIN_SAMPLES} to {MAX_SAMPLES}")
        if not np.all(np.diff(self.edges_mm) > 0.0):
            raise DataError("edges_mm", limit="must be in ascending order")

    @property
    def thickness_mm(self) -> float:
        """Total height of the layers."""
        return float(np.ptp(self.edges_mm))


class LayeredLensFromFile(LayeredLens, eq=True):
    """A layered lens with profiles from a file."""

    shape_name: ClassVar[str] = "layered"

    file: LayerProfiles = field(kw_only=True, metadata=HIDDEN)

    def __post_init__(self) -> None:
        for key, designed_mm, file_mm in (
            ("lens.half_width_mm", self.half_width_mm, self.file.half_width_mm),
            ("body.thickness_mm", self.thickness_mm, self.file.thickness_mm),
        ):
            if abs(designed_mm - file_mm) > SIZE_TOLERANCE_MM:
                limit = f"must be that of lens.profile {self.file.name!r}, {file_mm:g} mm"
                raise DataError(key, value=designed_mm, limit=limit)
        super().__post_init__()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        return self.file.warnings

    @reported
    def simulated(self) -> bool:
        """Whether its profiles were computed rather than measured."""
        return self.file.simulated

    @cached_property
    def edges_mm(self) -> FloatArray:
        """Heights y (L + 1,) of the boundaries of the layers in ascending order."""
        return self.file.edges_mm

    @cached_property
    def profiles(self) -> tuple[FloatArray, FloatArray]:
        """Depth and slope (L, M) of every layer; the slopes are from cubic splines with slope 0 on the axis."""
        from scipy.interpolate import CubicSpline  # slow to import, and not required by other lenses

        x = np.linspace(0.0, self.half_width_mm, self.file.z_mm.shape[1])
        spline = CubicSpline(x, self.file.z_mm, axis=1, bc_type=((1, np.zeros(len(self.file.z_mm))), "not-a-knot"))
        return self.file.z_mm, np.asarray(spline(x, 1))

    @cached_property
    def sampled_face(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y and z (N, M) of points on the face, on all layers, because these need not be symmetric in y."""
        x, y = np.meshgrid(np.linspace(0.0, self.half_width_mm, self.file.z_mm.shape[1]), self.middles_mm)
        return x, y, self.file.z_mm


@dataclass(frozen=True)
class _LayersFile:
    """Content of a layers file, except its kind and schema."""

    half_width_mm: float
    edges_mm: tuple[float, ...]
    z_mm: tuple[tuple[float, ...], ...]
    simulated: bool
    name: str = ""
    warnings: tuple[str, ...] = ()


def read_layers(path: Path) -> LayerProfiles:
    """Return the profiles in a file; raise `DataError` if it cannot be read or does not contain such profiles."""
    data = parse_json(read_text(path, DataError), str(path))
    if not isinstance(data, dict) or data.pop("solen", None) != KIND:
        limit = f'does not contain the layers of a lens: its key "solen" must be "{KIND}"'
        raise DataError(str(path), limit=limit, remedy="write one with solen print predict --out")
    if (schema := data.pop("schema", None)) != SCHEMA:
        raise DataError(f"{path}: schema", value=schema, limit=f"this version of solen reads {SCHEMA}")
    file = build(_LayersFile, data, str(path))
    with error_context(str(path)):
        z = _table(file.z_mm)
        return LayerProfiles(
            file.name or path.stem, file.half_width_mm, np.array(file.edges_mm), z, file.simulated, file.warnings
        )


def layers_text(profiles: LayerProfiles) -> str:
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
    """Return the rows as an array (L, M); raise `DataError` if they are unequal in length or not finite numbers."""
    if len({len(row) for row in rows}) != 1:
        raise DataError("z_mm", limit="must be rows of equal length")
    table = np.array(rows, dtype=float)
    if not np.isfinite(table).all():
        raise DataError("z_mm", limit="must be finite numbers")
    return table
