"""A trace as an `xarray.Dataset` with named dimensions, and as a netCDF file.

Each quantity in a trace becomes a variable with a unit (``units``) and a description (``long_name``). The dimensions
are ``receiver``, ``source``, ``face`` (an interface of a receiver), ``position_bin``, ``angle_bin``, ``monitor``,
``monitor_bin``, ``fate``, ``undefined_place``, ``truncated_place`` and ``leg``. If receivers differ in their number of
interfaces, or monitors in their number of bins, missing entries are NaN. Variables and dimensions are omitted for data
that the trace does not contain (monitors, bins, places or legs).

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
from solen.trace.result import LEG, Crossed, Detected, Trace

if TYPE_CHECKING:
    import xarray as xr

Attributes = Mapping[str, str | int | float]
_Variable = tuple[tuple[str, ...], Any, dict[str, str]]

SHARE = "1"
"""Unit of a count, and of a power, which is a fraction of the emitted power."""
_LEGS = {
    "ray": (SHARE, "number of the launched ray"),
    "branch": (SHARE, "number of the branch within its ray"),
    "parent": (SHARE, "parent branch from which this branch was split, -1 for none"),
    "hit": (SHARE, "number of interfaces met before this leg"),
    "interface": (SHARE, "scene index of the interface at the end of the leg, -1 for none"),
    "fate": (SHARE, "fate at the end of the leg: 0 continues, 1 detected, 2 escaped, 3 absorbed, 4 truncated"),
    "x_mm": ("mm", "start, x"),
    "z_mm": ("mm", "start, z"),
    "dx": (SHARE, "direction, x"),
    "dz": (SHARE, "direction, z"),
    "length_mm": ("mm", "length, infinite if the leg escapes"),
    "power_s": (SHARE, "power at the start of the leg polarised out of the plane, as a fraction of the emitted power"),
    "power_p": (SHARE, "power at the start of the leg polarised in the plane, as a fraction of the emitted power"),
    "kept": (SHARE, "fraction of that power remaining at the end of the leg"),
    "optical_path_mm": ("mm", "optical path length from the source to the start of the leg"),
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
    for part in (_whole(trace), _receivers(trace), _monitors(trace), _places(trace), _legs(trace)):
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


def _whole(trace: Trace) -> dict[str, _Variable]:
    fates = [field.name for field in fields(trace.ledger)]
    ledger, u_ledger = ([getattr(of, name) for name in fates] for of in (trace.ledger, trace.u_ledger))
    single = math.nan if trace.single_error is None else trace.single_error
    return {
        "fate": (("fate",), fates, {"long_name": "where power went"}),
        "ledger": _real(("fate",), ledger, SHARE, "fraction of the emitted power; the sum is 1"),
        "u_ledger": _real(("fate",), u_ledger, SHARE, "uncertainty of that fraction"),
        "u_missed": _real((), trace.u_missed, SHARE, "uncertainty of missed"),
        "u_leaked": _real((), trace.u_leaked, SHARE, "uncertainty of leaked"),
        "missed": _real((), trace.missed, SHARE, "escaped power that passed above or below all bodies"),
        "reflected": _real((), trace.reflected, SHARE, "power reflected by a lens that is not cylindrical"),
        "leaked": _real((), trace.leaked, SHARE, "escaped power that left bodies through their top or bottom"),
        "rays": _count((), trace.rays, "rays traced"),
        "hits": _count((), trace.hits, "number of encounters between light and interfaces"),
        "undefined": _count(
            (), trace.undefined, "rays that met an interface from a medium other than the one they were in"
        ),
        "truncated": _count((), trace.truncated, "branches cut off"),
        "pieces": _count((), trace.pieces, "number of cone segments in adaptive integration"),
        "reached": ((), trace.reached, {"long_name": "whether adaptive integration reached its tolerance"}),
        "single_error": _real(
            (), single, SHARE, "largest power difference between single and double precision; NaN in double precision"
        ),
    }


def _receivers(trace: Trace) -> dict[str, _Variable]:
    readings: list[Detected] = list(trace.detectors.values())
    if not readings:
        return {}
    one = ("receiver",)
    variables: dict[str, _Variable] = {
        "receiver": (one, list(trace.detectors), {"long_name": "name of the receiver"}),
        "power": _real(one, [r.power for r in readings], SHARE, "power detected"),
        "power_u": _real(one, [r.u_power for r in readings], SHARE, "uncertainty of the power, NaN if unknown"),
        "arrived": _count(one, [r.rays for r in readings], "number of rays or branches that arrived"),
        "optical_path_mm": _real(
            one,
            [r.optical_path_mm for r in readings],
            "mm",
            "power-weighted mean optical path length of the light that arrived",
        ),
    }
    sources = max(len(r.power_by_source) for r in readings)
    if sources:
        by_source = _padded([np.array(r.power_by_source) for r in readings], (sources,))
        variables["source"] = _count(("source",), np.arange(sources), "index of the source in the scene")
        variables["power_by_source"] = _real((*one, "source"), by_source, SHARE, "power detected from each source")
    faces, bins = (max(sizes) for sizes in zip(*(r.power_by_position.shape for r in readings), strict=True))
    if bins:
        by_position = _padded([r.power_by_position for r in readings], (faces, bins))
        middle = (np.arange(bins) + 0.5) / bins
        variables["face"] = _count(("face",), np.arange(faces), "index of the interface within its receiver")
        variables["position_bin"] = _real(
            ("position_bin",), middle, "1", "bin centre, from 0 at the start of the interface to 1 at its end"
        )
        dims = (*one, "face", "position_bin")
        variables["power_by_position"] = _real(
            dims, by_position, SHARE, "power detected in each position bin of an interface"
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
            (*one, "angle_bin"), by_angle, SHARE, "power detected in each incidence-angle bin"
        )
    return variables


def _monitors(trace: Trace) -> dict[str, _Variable]:
    readings: list[Crossed] = list(trace.monitors.values())
    if not readings:
        return {}
    one = ("monitor",)
    bins = max(len(r.power_by_bin) for r in readings)
    by_bin = _padded([r.power_by_bin for r in readings], (bins,))
    maps = {
        "monitor_bin": _count(("monitor_bin",), np.arange(bins), "bin index, counted from the start of the monitor"),
        "net_power_by_bin": _real((*one, "monitor_bin"), by_bin, SHARE, "net power in each bin"),
    }
    return {
        "monitor": (one, list(trace.monitors), {"long_name": "name of the monitor"}),
        "net_power": _real(one, [r.power for r in readings], SHARE, "net power towards the left side of the monitor"),
        "net_power_u": _real(one, [r.u_power for r in readings], SHARE, "uncertainty of the net power, NaN if unknown"),
        "crossings": _count(one, [r.rays for r in readings], "number of times light crossed the monitor"),
        **(maps if bins else {}),
    }


def _places(trace: Trace) -> dict[str, _Variable]:
    variables: dict[str, _Variable] = {}
    kinds = {"undefined": trace.undefined_at_mm, "truncated": trace.truncated_at_mm}
    for kind, places in kinds.items():
        for axis, values in zip("xz", zip(*places, strict=True), strict=False):
            what = f"location of the first {kind} light, {axis}"
            variables[f"{kind}_{axis}_mm"] = _real((f"{kind}_place",), values, "mm", what)
    return variables


def _legs(trace: Trace) -> dict[str, _Variable]:
    if trace.legs is None:
        return {}
    return {
        f"leg_{name}": (("leg",), trace.legs[name], {"units": _LEGS[name][0], "long_name": f"leg: {_LEGS[name][1]}"})
        for name in LEG.names or ()
    }


def _real(dims: tuple[str, ...], values: Iterable[float] | float, units: str, name: str) -> _Variable:
    return dims, np.asarray(values, dtype=np.float64), {"units": units, "long_name": name}


def _count(dims: tuple[str, ...], values: Iterable[int] | int, name: str) -> _Variable:
    return dims, np.asarray(values, dtype=np.int64), {"units": SHARE, "long_name": name}


def _padded(parts: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Stack arrays into one array, each padded with NaN to the common shape."""
    whole = np.full((len(parts), *shape), math.nan)
    for row, part in zip(whole, parts, strict=True):
        row[tuple(slice(size) for size in part.shape)] = part
    return whole
