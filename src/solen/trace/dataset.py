"""A trace as an `xarray.Dataset` with named dimensions, and as a netCDF file.

Each quantity in a trace becomes a variable with a unit (``units``) and a description (``long_name``). The dimensions
are ``receiver``, ``source``, ``face`` (an interface of a receiver), ``position_bin``, ``angle_bin``, ``monitor``,
``monitor_bin``, ``fate``, ``undefined_place``, ``truncated_place`` and ``segment``. If receivers differ in their number
of interfaces, or monitors in their number of bins, missing entries are NaN. Variables and dimensions are omitted for
data that the trace does not contain (monitors, bins, locations or segments).

xarray and the netCDF library that it uses are not part of the default installation: ``pip install ".[netcdf]"``.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import solen
from solen import files
from solen.arrays import FloatArray
from solen.extras import need
from solen.trace.result import SEGMENT_FIELDS, Crossed, Detected, Trace

if TYPE_CHECKING:
    import xarray as xr

Attributes = Mapping[str, str | int | float]
_Variable = tuple[tuple[str, ...], Any, dict[str, str]]

DIMENSIONLESS = "1"
"""Unit of a count, and of a power, which is a fraction of the emitted power."""
_SEGMENTS = {
    "ray": (DIMENSIONLESS, "number of the launched ray"),
    "branch": (DIMENSIONLESS, "number of the branch within its ray"),
    "parent": (DIMENSIONLESS, "parent branch from which this branch was split, -1 for none"),
    "hit": (DIMENSIONLESS, "number of interfaces met before this segment"),
    "interface": (DIMENSIONLESS, "scene index of the interface at the end of the segment, -1 for none"),
    "fate": (
        DIMENSIONLESS,
        "fate at the end of the segment: 0 continues, 1 detected, 2 escaped, 3 absorbed, 4 truncated",
    ),
    "x_mm": ("mm", "start, x"),
    "z_mm": ("mm", "start, z"),
    "dx": (DIMENSIONLESS, "direction, x"),
    "dz": (DIMENSIONLESS, "direction, z"),
    "length_mm": ("mm", "length, infinite if the segment escapes"),
    "power_s": (
        DIMENSIONLESS,
        "power at the start of the segment polarised out of the plane, as a fraction of the emitted power",
    ),
    "power_p": (
        DIMENSIONLESS,
        "power at the start of the segment polarised in the plane, as a fraction of the emitted power",
    ),
    "kept": (DIMENSIONLESS, "fraction of the power at the start of the segment that remains at its end"),
    "optical_path_mm": ("mm", "optical path length from the source to the start of the segment"),
}


def check_installed() -> None:
    """Raise `OutputError` if the netCDF libraries are not installed."""
    need("xarray", "h5netcdf", "h5py", what="netCDF")


def to_dataset(trace: Trace, attributes: Attributes | None = None) -> "xr.Dataset":
    """Return a trace as an `xarray.Dataset`.

    Parameters
    ----------
    trace
        Result of any of the tracers.
    attributes
        Further attributes of the data set, for example the name of the design.

    Returns
    -------
    xarray.Dataset
        A data set with the variables listed above. Its attributes give the version of solen, the mode and the sampling
        method, and mark the data as simulated.

    Raises
    ------
    OutputError
        If xarray is not installed.
    """
    check_installed()
    import xarray as xr

    variables: dict[str, _Variable] = {}
    coordinates: dict[str, _Variable] = {}
    for part in (_totals(trace), _receivers(trace), _monitors(trace), _locations(trace), _segments(trace)):
        for name, variable in part.items():
            (coordinates if variable[0] == (name,) else variables)[name] = variable
    all_attributes: dict[str, str | int | float] = {
        "title": "Light traced through a scene",
        "comment": "Simulated, not measured. Powers are fractions of the emitted power.",
        "source": f"solen {solen.__version__}",
        "mode": trace.mode,
        "method": trace.method,
        "why": trace.why,
        **(attributes or {}),
        "simulated": 1,
    }
    return xr.Dataset(variables, coordinates, all_attributes)


def save_netcdf(path: Path | str, trace: Trace, attributes: Attributes | None = None) -> Path:
    """Write a trace to a netCDF-4 file, first under a temporary name; equal traces give identical files.

    The parameters are those of `to_dataset`. ``xarray.load_dataset(path, engine="h5netcdf")`` reads the file.

    Raises
    ------
    OutputError
        If the file cannot be written, or a library is not installed.
    """
    return files.write_all({Path(path): writer(trace, attributes)})[0]


def writer(trace: Trace, attributes: Attributes | None = None) -> Callable[[Path], object]:
    """Return a function that writes a trace to a netCDF file, for `solen.files.write_all`."""
    return netcdf_writer(to_dataset(trace, attributes))


def netcdf_writer(dataset: "xr.Dataset") -> Callable[[Path], object]:
    """Return a function that writes a data set to a netCDF file."""
    return lambda path: dataset.to_netcdf(path, engine="h5netcdf")


def _totals(trace: Trace) -> dict[str, _Variable]:
    fates = [field.name for field in fields(trace.ledger)]
    ledger, u_ledger = ([getattr(entry, fate) for fate in fates] for entry in (trace.ledger, trace.u_ledger))
    single = math.nan if trace.single_error is None else trace.single_error
    return {
        "fate": (("fate",), fates, {"long_name": "fate of the power"}),
        "ledger": _real(("fate",), ledger, DIMENSIONLESS, "fraction of the emitted power; the sum is 1"),
        "u_ledger": _real(("fate",), u_ledger, DIMENSIONLESS, "uncertainty of the fraction of the emitted power"),
        "u_missed": _real((), trace.u_missed, DIMENSIONLESS, "uncertainty of missed"),
        "u_leaked": _real((), trace.u_leaked, DIMENSIONLESS, "uncertainty of leaked"),
        "missed": _real((), trace.missed, DIMENSIONLESS, "escaped power that passed above or below all bodies"),
        "reflected": _real((), trace.reflected, DIMENSIONLESS, "power reflected by a lens that is not cylindrical"),
        "leaked": _real((), trace.leaked, DIMENSIONLESS, "escaped power that left bodies through their top or bottom"),
        "rays": _count((), trace.rays, "rays traced"),
        "hits": _count((), trace.hits, "number of times that light met an interface"),
        "undefined": _count(
            (), trace.undefined, "rays that met an interface from a medium other than the one they were in"
        ),
        "truncated": _count((), trace.truncated, "truncated branches"),
        "pieces": _count((), trace.pieces, "number of cone segments in adaptive integration"),
        "reached": ((), trace.reached, {"long_name": "whether adaptive integration reached its tolerance"}),
        "single_error": _real(
            (),
            single,
            DIMENSIONLESS,
            "largest power difference between single and double precision; NaN in double precision",
        ),
    }


def _receivers(trace: Trace) -> dict[str, _Variable]:
    readings: list[Detected] = list(trace.detectors.values())
    if not readings:
        return {}
    receiver = ("receiver",)
    variables: dict[str, _Variable] = {
        "receiver": (receiver, list(trace.detectors), {"long_name": "name of the receiver"}),
        "power": _real(receiver, [r.power for r in readings], DIMENSIONLESS, "power detected"),
        "power_u": _real(
            receiver, [r.u_power for r in readings], DIMENSIONLESS, "uncertainty of the power, NaN if unknown"
        ),
        "arrived": _count(receiver, [r.rays for r in readings], "number of rays or branches that arrived"),
        "optical_path_mm": _real(
            receiver,
            [r.optical_path_mm for r in readings],
            "mm",
            "power-weighted mean optical path length of the light that arrived",
        ),
    }
    sources = max(len(r.power_by_source) for r in readings)
    if sources:
        by_source = _padded([np.array(r.power_by_source) for r in readings], (sources,))
        variables["source"] = _count(("source",), np.arange(sources), "index of the source in the scene")
        variables["power_by_source"] = _real(
            (*receiver, "source"), by_source, DIMENSIONLESS, "power detected from each source"
        )
    faces, bins = (max(sizes) for sizes in zip(*(r.power_by_position.shape for r in readings), strict=True))
    if bins:
        by_position = _padded([r.power_by_position for r in readings], (faces, bins))
        middle = (np.arange(bins) + 0.5) / bins
        variables["face"] = _count(("face",), np.arange(faces), "index of the interface within its receiver")
        variables["position_bin"] = _real(
            ("position_bin",), middle, "1", "bin centre, from 0 at the start of the interface to 1 at its end"
        )
        dims = (*receiver, "face", "position_bin")
        variables["power_by_position"] = _real(
            dims, by_position, DIMENSIONLESS, "power detected in each position bin of an interface"
        )
    angles = max(len(r.power_by_angle) for r in readings)
    if angles:
        middle = -90.0 + 180.0 * (np.arange(angles) + 0.5) / angles
        variables["angle_bin"] = _real(
            ("angle_bin",),
            middle,
            "degree",
            "centre of the incidence-angle bin, positive if light travels towards the end of the interface",
        )
        by_angle = _padded([r.power_by_angle for r in readings], (angles,))
        variables["power_by_angle"] = _real(
            (*receiver, "angle_bin"), by_angle, DIMENSIONLESS, "power detected in each incidence-angle bin"
        )
    return variables


def _monitors(trace: Trace) -> dict[str, _Variable]:
    readings: list[Crossed] = list(trace.monitors.values())
    if not readings:
        return {}
    monitor = ("monitor",)
    bins = max(len(r.power_by_bin) for r in readings)
    by_bin = _padded([r.power_by_bin for r in readings], (bins,))
    maps = {
        "monitor_bin": _count(("monitor_bin",), np.arange(bins), "bin index, counted from the start of the monitor"),
        "net_power_by_bin": _real((*monitor, "monitor_bin"), by_bin, DIMENSIONLESS, "net power in each bin"),
    }
    return {
        "monitor": (monitor, list(trace.monitors), {"long_name": "name of the monitor"}),
        "net_power": _real(
            monitor, [r.power for r in readings], DIMENSIONLESS, "net power towards the left side of the monitor"
        ),
        "net_power_u": _real(
            monitor, [r.u_power for r in readings], DIMENSIONLESS, "uncertainty of the net power, NaN if unknown"
        ),
        "crossings": _count(monitor, [r.rays for r in readings], "number of times light crossed the monitor"),
        **(maps if bins else {}),
    }


def _locations(trace: Trace) -> dict[str, _Variable]:
    variables: dict[str, _Variable] = {}
    kinds = {"undefined": trace.undefined_at_mm, "truncated": trace.truncated_at_mm}
    for kind, locations in kinds.items():
        for axis, values in zip("xz", zip(*locations, strict=True), strict=False):
            description = f"where {kind} light was first encountered, {axis}"
            variables[f"{kind}_{axis}_mm"] = _real((f"{kind}_place",), values, "mm", description)
    return variables


def _segments(trace: Trace) -> dict[str, _Variable]:
    if trace.segments is None:
        return {}
    return {
        f"segment_{name}": (
            ("segment",),
            trace.segments[name],
            {"units": _SEGMENTS[name][0], "long_name": f"segment: {_SEGMENTS[name][1]}"},
        )
        for name in SEGMENT_FIELDS.names or ()
    }


def _real(dims: tuple[str, ...], values: Iterable[float] | float, units: str, name: str) -> _Variable:
    return dims, np.asarray(values, dtype=np.float64), {"units": units, "long_name": name}


def _count(dims: tuple[str, ...], values: Iterable[int] | int, name: str) -> _Variable:
    return dims, np.asarray(values, dtype=np.int64), {"units": DIMENSIONLESS, "long_name": name}


def _padded(parts: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Stack arrays into one array, each padded with NaN to the common shape."""
    padded = np.full((len(parts), *shape), math.nan)
    for row, part in zip(padded, parts, strict=True):
        row[tuple(slice(size) for size in part.shape)] = part
    return padded
