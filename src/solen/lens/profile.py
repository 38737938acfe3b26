"""Lens profile from an image, a scan or a print model: points with uncertainties.

Measurements and predictions of a printed lens have a common form, a :class:`MeasuredProfile` in the frame of the
designed lens: x lateral, z into the body, the designed vertex at the origin. A profile is z as a function of x; one
that folds back on itself cannot be compared with a designed lens. Its file is JSON from `profile_text`, or any table
with the columns x and z, and u if the uncertainty is known.

`read_profile` reads a file, `profile_of` makes a profile from columns of numbers, and `profile_text` formats one as
text.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from solen import recording
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.files import read_text
from solen.results import Result, plain
from solen.spec.objects import build, parse_json
from solen.spec.strict import error_context

KIND = "lens profile"
SCHEMA = 1
EDGES = ("top", "bottom", "mean", "predicted")
"""Edge of the part on which points were measured: a thick transparent part shows two; a print model predicts one."""

MIN_POINTS, MAX_POINTS = 16, 100_000
MIN_WIDTH_MM, MAX_WIDTH_MM = 0.02, 200.0
"""Plausible widths of a lens; other widths suggest a wrong unit."""
MAX_U_MM = 1.0

_GAUSS_MAD = 1.4826
"""Ratio of the standard deviation to the median absolute deviation of normally distributed numbers."""


class MeasuredProfile(Result):
    """Measured profile of a lens in the sensor's frame, with the designed vertex at the origin.

    Profiles compare by identity: two measurements of one lens are different profiles.

    Attributes
    ----------
    x_mm, z_mm
        Points (N,), in strictly ascending order of x; z increases into the body.
    u_mm
        Standard uncertainty (N,) of each point along the profile's normal, without errors of scale and position, which
        are common to all points; 0 for exact points.
    simulated
        Whether the profile was computed, as by a print model or from a rendered image, rather than measured.
    name
        Name of the lens or the part.
    edge
        Edge of the part: ``top``, ``bottom``, ``mean``, or ``predicted``.
    sources
        Provenance of the source files, as plain data.
    warnings
        Warnings about the profile.
    """

    x_mm: FloatArray
    z_mm: FloatArray
    u_mm: FloatArray
    simulated: bool
    name: str
    edge: str
    sources: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in ("x_mm", "z_mm", "u_mm"):
            object.__setattr__(self, key, _column(key, getattr(self, key)))
        if self.edge not in EDGES:
            raise DataError("edge", value=self.edge, limit=f"must be one of {', '.join(EDGES)}")
        _check(self.x_mm, self.z_mm, self.u_mm)

    @property
    def width_mm(self) -> tuple[float, float]:
        """Lateral positions of the two ends."""
        return (float(self.x_mm[0]), float(self.x_mm[-1]))


def read_profile(path: Path | str) -> MeasuredProfile:
    """Read the profile in a file: JSON as `profile_text` writes it, or a table with columns x and z, and u if known.

    Raises
    ------
    DataError
        If the file cannot be read, has other keys or columns, or contains no valid profile: points that are not
        numbers, too few, not in order or folded back, or of an implausible size for a lens.
    """
    path = Path(path)
    if _is_json(path):
        return _from_json(read_text(path, DataError), str(path))
    return _from_table(path)


def profile_of(
    x_mm: ArrayLike,
    z_mm: ArrayLike,
    u_mm: ArrayLike | float | None = None,
    *,
    name: str = "lens",
    simulated: bool = False,
    edge: str = "mean",
    sources: tuple[dict[str, Any], ...] = (),
) -> MeasuredProfile:
    """Return the profile defined by columns of numbers (N,), which are reversed if they run from right to left.

    If no uncertainty is specified, it is estimated from the scatter of neighbouring points, with a warning: the
    estimate does not include errors common to all points.
    """
    x, z = _column("x_mm", x_mm), _column("z_mm", z_mm)
    if x.shape != z.shape:
        raise DataError("length of z_mm", value=z.size, limit=f"must be that of x_mm, {x.size}")
    backwards = x.size > 1 and bool(np.all(np.diff(x) < 0.0))
    _check_order(x[::-1] if backwards else x)
    warnings: tuple[str, ...] = ()
    if u_mm is None:
        u_mm = scatter_mm(x, z)
        warnings = (
            f"the profile specifies no uncertainty; {1e3 * u_mm:.2g} µm is assumed, the scatter "
            "of neighbouring points, which does not include errors of scale or position",
        )
    u = np.full_like(x, u_mm) if np.ndim(u_mm) == 0 else _column("u_mm", u_mm)
    if backwards:
        x, z, u = x[::-1], z[::-1], u[::-1]
    return MeasuredProfile(x, z, u, simulated, name, edge, sources, warnings)


def profile_text(profile: MeasuredProfile) -> str:
    """Return the JSON text of a profile; `read_profile` restores the same numbers to the last digit."""
    data = {"solen": KIND, "schema": SCHEMA} | profile.to_dict()
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def scatter_mm(x_mm: FloatArray, z_mm: FloatArray, slope: FloatArray | None = None) -> float:
    """Return the standard deviation, along the normal, of independent errors of neighbouring points.

    Each point is compared with the straight line through its neighbours. The median of the absolute deviations, 0.6745
    standard deviations if they are normally distributed, is robust against outliers, such as at a step. If z is the
    deviation from a profile rather than a profile, ``slope`` (N,) is the slope of that profile.
    """
    if x_mm.size < 3:
        return 0.0
    weight = (x_mm[1:-1] - x_mm[:-2]) / (x_mm[2:] - x_mm[:-2])
    deviation = z_mm[1:-1] - (1.0 - weight) * z_mm[:-2] - weight * z_mm[2:]
    deviation = deviation - _running_median(deviation)  # which is due to the curvature of the profile
    inner_slope = _running_median((z_mm[2:] - z_mm[:-2]) / (x_mm[2:] - x_mm[:-2])) if slope is None else slope[1:-1]
    size = np.abs(deviation) / np.sqrt(1.0 + weight**2 + (1.0 - weight) ** 2) / np.hypot(1.0, inner_slope)
    return float(_GAUSS_MAD * np.median(size))


def _running_median(values: FloatArray, reach: int = 10) -> FloatArray:
    """Return the running median over up to ``reach`` neighbours on either side."""
    reach = min(reach, (values.size - 1) // 2)
    padded = np.pad(values, reach, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1))


def _is_json(path: Path) -> bool:
    """Return whether a file begins like a JSON object; a file that cannot be opened is judged by its name."""
    try:
        with path.open("rb") as file:
            return file.read(64).removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"["))
    except (OSError, ValueError):
        return path.suffix.lower() == ".json"


@dataclass(frozen=True)
class _ProfileFile:
    """Content of a profile's JSON file, except its kind and schema."""

    x_mm: tuple[float, ...]
    z_mm: tuple[float, ...]
    u_mm: tuple[float, ...]
    simulated: bool
    edge: str
    name: str = ""
    sources: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()


def _from_json(text: str, where: str) -> MeasuredProfile:
    data = parse_json(text, where)
    if not isinstance(data, dict) or data.pop("solen", None) != KIND:
        limit = f'is not a lens profile: its key "solen" must be "{KIND}"'
        raise DataError(where, limit=limit, remedy="write one with solen print inspect")
    if (schema := data.pop("schema", None)) != SCHEMA:
        raise DataError(f"{where}: schema", value=schema, limit=f"this version of solen reads {SCHEMA}")
    fields = vars(build(_ProfileFile, data, where))
    with error_context(where):
        return MeasuredProfile(
            **{"name": Path(where).stem} | {key: value for key, value in fields.items() if value != ""}
        )


def _from_table(path: Path) -> MeasuredProfile:
    table = recording.read(path)
    x, z = (table.need(key, f"{key}_mm").to("mm") for key in ("x", "z"))
    u = table.find("u", "u_mm", "uncertainty")
    with error_context(str(path)):
        return profile_of(
            x,
            z,
            None if u is None else u.to("mm"),
            name=path.stem,
            simulated=table.provenance.simulated,
            sources=(plain(table.provenance),),
        )


def _column(key: str, values: ArrayLike) -> FloatArray:
    """Return finite numbers (N,), read-only; raise `DataError` if they are not."""
    try:
        column = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError(key, limit="must be a list of numbers") from None
    if column.ndim != 1:
        raise DataError(key, limit=f"must be a list of numbers, not an array of {column.ndim} dimensions")
    invalid = np.flatnonzero(~np.isfinite(column))
    if invalid.size:
        i = int(invalid[0])
        raise DataError(f"{key}[{i}]", value=float(column[i]), limit="must be a finite number", remedy="omit the point")
    column.setflags(write=False)
    return column


def _check(x: FloatArray, z: FloatArray, u: FloatArray) -> None:
    for key, column in (("z_mm", z), ("u_mm", u)):
        if column.size != x.size:
            limit = f"must be that of x_mm, {x.size}"
            raise DataError(f"length of {key}", value=column.size, limit=limit, remedy="restore the missing numbers")
    if not MIN_POINTS <= x.size <= MAX_POINTS:
        limit = f"must be {MIN_POINTS} to {MAX_POINTS:,}"
        remedy = f"sample the outline more {'finely' if x.size < MIN_POINTS else 'coarsely'}"
        raise DataError("number of points", value=x.size, limit=limit, remedy=remedy)
    _check_order(x)
    _check_size(x, z)
    invalid = np.flatnonzero((u < 0.0) | (u > MAX_U_MM))
    if invalid.size:
        i, limit = int(invalid[0]), f"must be 0 to {MAX_U_MM:g} mm"
        raise DataError(f"u_mm[{i}]", value=float(u[i]), limit=limit, remedy="give it in mm")


def _check_order(x: FloatArray) -> None:
    step = np.diff(x)
    wrong = np.flatnonzero(step <= 0.0)
    if not wrong.size:
        return
    i = int(wrong[0])
    if np.all(step < 0.0):
        limit = "must be in ascending order"
        raise DataError("x_mm", value=f"{x[0]:g} to {x[-1]:g}", limit=limit, remedy="reverse the lists")
    raise DataError(
        f"x_mm[{i + 1}]",
        value=float(x[i + 1]),
        limit=f"must be above the preceding {x[i]:.9g}; the profile folds back or repeats a point",
        remedy="keep only the face of the lens, with one z for each x",
    )


def _check_size(x: FloatArray, z: FloatArray) -> None:
    width_mm = float(x[-1] - x[0])
    if not MIN_WIDTH_MM <= width_mm <= MAX_WIDTH_MM:
        limit = f"must be {MIN_WIDTH_MM:g} to {MAX_WIDTH_MM:g} mm"
        raise DataError("width of the profile", value=width_mm, limit=limit, remedy="give x and z in mm")
    largest_mm = max(float(np.abs(column).max()) for column in (x, z))
    if largest_mm > MAX_WIDTH_MM:
        limit = f"must be at most {MAX_WIDTH_MM:g} mm from the designed vertex"
        remedy = "give the profile in mm, registered to the design"
        raise DataError("largest coordinate of the profile", value=largest_mm, limit=limit, remedy=remedy)
