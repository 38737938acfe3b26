"""A trace as a data set, in memory and as a netCDF file."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import solen
from solen.curve import Segment
from solen.errors import OutputError
from solen.extras import PACKAGES
from solen.scene import Beam, Fan, Interface, Monitor, Region, Scene
from solen.trace import Detected, Limits, Trace, integrate, save_netcdf, to_dataset, trace, trace_reference
from solen.trace.result import SEGMENT_FIELDS, Crossed

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)

SAME_NAME = (
    "rays",
    "ledger",
    "missed",
    "leaked",
    "reflected",
    "u_ledger",
    "u_missed",
    "u_leaked",
    "hits",
    "undefined",
    "truncated",
    "pieces",
    "reached",
    "single_error",
)
VARIABLES = {
    **{name: f"attribute {name}" for name in ("mode", "method", "why")},
    **{name: name for name in SAME_NAME},
    "detectors": "power",
    "monitors": "net_power",
    "segments": "segment_ray",
    "undefined_at_mm": "undefined_x_mm",
    "truncated_at_mm": "truncated_z_mm",
}
"""Variable or attribute for each field of a trace."""
RECEIVER_VARIABLES = {
    "power": "power",
    "u_power": "power_u",
    "rays": "arrived",
    "power_by_source": "power_by_source",
    "optical_path_mm": "optical_path_mm",
    "power_by_position": "power_by_position",
    "power_by_angle": "power_by_angle",
}
MONITOR_VARIABLES = {
    "power": "net_power",
    "u_power": "net_power_u",
    "rays": "crossings",
    "power_by_bin": "net_power_by_bin",
}


def scene() -> Scene:
    """Return two sources, receivers with different numbers of faces, two mirrors, and a face to an unknown medium."""
    faces = [("left half", 0.0, -2.0, "wide"), ("right half", 2.0, 0.0, "wide"), ("single", 4.0, 3.0, "narrow")]
    receivers = [
        Interface(name, Segment((a, 5.0), (b, 5.0)), "air", "air", "receiver", receiver)
        for name, a, b, receiver in faces
    ]
    ends = {"above": ((-3.0, 4.0), (-4.0, 4.0)), "below": ((-10.0, -1.0), (-8.0, -1.0))}
    mirrors = [Interface(name, Segment(a, b), "air", "air", "mirror") for name, (a, b) in ends.items()]
    glass = Interface("glass", Segment((-8.0, -1.0), (-6.0, -1.0)), "glass", "air")
    sources = (Fan((0.0, 0.0), 0.0, 110.0, 200, power=3.0), Beam((1.0, 1.0), (3.5, 1.0), 0.0, 50))
    monitors = (Monitor("with bins", (5.0, 2.0), (-5.0, 2.0), 3), Monitor("without bins", (-1.0, 3.0), (1.0, 3.0)))
    return Scene((AIR, GLASS), (*receivers, *mirrors, glass), sources, monitors, open_media=True)


@pytest.fixture(scope="module")
def traced() -> Trace:
    """A trace with data in all fields; a ray is truncated at the second mirror."""
    return trace(scene(), "power", Limits(max_hits=2), position_bins=4, angle_bins=6, segments=True)


def equal(a: object, b: object) -> bool:
    return bool(np.array_equal(np.asarray(a, dtype=float), np.asarray(b, dtype=float), equal_nan=True))


def test_every_field_has_a_variable(traced: Trace) -> None:
    dataset = traced.to_dataset()
    assert {field.name for field in dataclasses.fields(Trace)} == VARIABLES.keys()
    assert {field.name for field in dataclasses.fields(Detected)} == RECEIVER_VARIABLES.keys()
    assert {field.name for field in dataclasses.fields(Crossed)} == MONITOR_VARIABLES.keys()
    for name in (*VARIABLES.values(), *RECEIVER_VARIABLES.values(), *MONITOR_VARIABLES.values()):
        kind, _, attribute = name.partition(" ")
        assert (attribute in dataset.attrs) if kind == "attribute" else (name in dataset), name
    assert {f"segment_{name}" for name in SEGMENT_FIELDS.names or ()} <= set(dataset)


def test_receivers(traced: Trace) -> None:
    dataset = traced.to_dataset()
    assert set(traced.detectors) == {"wide", "narrow"}
    for name, reading in traced.detectors.items():
        assert reading.power > 0.0
        receiver = dataset.sel(receiver=name)
        for field, variable in RECEIVER_VARIABLES.items():
            values = receiver[variable].values
            if field == "power_by_position":
                faces = len(reading.power_by_position)
                assert np.isnan(values[faces:]).all()
                values = values[:faces]
            assert equal(values, getattr(reading, field)), (name, field)
    assert dataset["power_by_position"].dims == ("receiver", "face", "position_bin")
    assert list(dataset["position_bin"].values) == [0.125, 0.375, 0.625, 0.875]
    assert list(dataset["angle_bin"].values) == [-75.0, -45.0, -15.0, 15.0, 45.0, 75.0]
    for name, dimension in (("angle", "angle_bin"), ("source", "source"), ("position", ("face", "position_bin"))):
        assert np.allclose(dataset[f"power_by_{name}"].sum(dimension), dataset["power"], rtol=0.0, atol=1e-12)


def test_monitors(traced: Trace) -> None:
    dataset = traced.to_dataset()
    for name, crossed in traced.monitors.items():
        monitor = dataset.sel(monitor=name)
        for field, variable in MONITOR_VARIABLES.items():
            values = np.atleast_1d(monitor[variable].values)
            expected = np.atleast_1d(getattr(crossed, field))
            assert equal(values[: len(expected)], expected), (name, field)
            assert np.isnan(values[len(expected) :]).all()


def test_ledger_locations_and_segments(traced: Trace) -> None:
    dataset = traced.to_dataset()
    for fate in ("detected", "escaped", "absorbed", "truncated"):
        assert float(dataset["ledger"].sel(fate=fate)) == getattr(traced.ledger, fate)
    assert float(dataset["ledger"].sum()) == pytest.approx(1.0, abs=1e-12)
    assert (int(dataset["rays"]), int(dataset["hits"])) == (traced.rays, traced.hits)
    for kind, locations in (("undefined", traced.undefined_at_mm), ("truncated", traced.truncated_at_mm)):
        assert int(dataset[kind]) == getattr(traced, kind) > 0
        assert len(locations) > 0
        assert equal(np.column_stack([dataset[f"{kind}_x_mm"], dataset[f"{kind}_z_mm"]]), locations)
    assert traced.segments is not None
    for name in SEGMENT_FIELDS.names or ():
        assert equal(dataset[f"segment_{name}"], traced.segments[name])


def test_variables_have_descriptions_and_units(traced: Trace) -> None:
    for name, variable in traced.to_dataset().variables.items():
        assert variable.attrs["long_name"], name
        if variable.dtype.kind in "if":
            unit = variable.attrs["units"]
            assert unit == ("mm" if str(name).endswith("_mm") else "degree" if name == "angle_bin" else "1"), name


def test_attributes(traced: Trace) -> None:
    attributes = traced.to_dataset({"name": "own", "angle_deg": 0.5, "simulated": 0}).attrs
    assert (attributes["simulated"], attributes["source"]) == (1, f"solen {solen.__version__}")
    assert (attributes["mode"], attributes["method"]) == ("power", "fan")
    assert (attributes["name"], attributes["angle_deg"]) == ("own", 0.5)


def test_missing_data_have_no_dimension() -> None:
    wall = Interface("wall", Segment((1.0, 5.0), (-1.0, 5.0)), "air", "air", "absorbing")
    dataset = trace(Scene((AIR,), (wall,), (Fan((0.0, 0.0), 0.0, 10.0, 8),))).to_dataset()
    assert set(dataset.sizes) == {"fate"}
    assert np.isnan(float(dataset["single_error"]))
    assert not set(dataset) & {"power", "net_power", "segment_ray", "undefined_x_mm", "power_by_position"}


@pytest.mark.parametrize("tracer", ["integrate", "reference", "single", "sobol"])
def test_all_tracers(tracer: str, tmp_path: Path) -> None:
    wall = Interface("wall", Segment((1.0, 5.0), (-1.0, 5.0)), "air", "air", "receiver", "right")
    scene = Scene((AIR,), (wall,), (Fan((0.0, 0.0), 0.0, 40.0, 64),))
    result = {
        "integrate": lambda: integrate(scene, "power", 1e-6),
        "reference": lambda: trace_reference(scene, "power"),
        "single": lambda: trace(scene, "power", precision="single"),
        "sobol": lambda: trace(scene, "roulette", sampling="sobol", seed=3),
    }[tracer]()
    dataset = to_dataset(result)
    assert dataset.attrs["method"] == result.method
    assert float(dataset["power"].sel(receiver="right")) == result.detectors["right"].power
    assert np.isnan(float(dataset["single_error"])) == (tracer != "single")
    assert read(save_netcdf(tmp_path / "a.nc", result)).identical(dataset)


def read(path: Path) -> xr.Dataset:
    return xr.load_dataset(path, engine="h5netcdf")


def test_file_round_trip(traced: Trace, tmp_path: Path) -> None:
    attributes: dict[str, str | int | float] = {"name": "Ω – 1", "angle_deg": -3.0}
    target = tmp_path / "a trace.nc"
    assert save_netcdf(target, traced, attributes) == target
    assert read(target).identical(traced.to_dataset(attributes))
    first = target.read_bytes()
    save_netcdf(str(target), traced, attributes)
    assert target.read_bytes() == first
    assert list(tmp_path.iterdir()) == [target]


def test_failed_write_keeps_the_old_file(traced: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.nc"
    target.write_bytes(b"old")

    def fails(_: xr.Dataset, path: Path, **__: object) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", fails)
    with pytest.raises(OutputError, match="No space left on device"):
        save_netcdf(target, traced)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_missing_folder_is_reported_in_one_line(traced: Trace, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written") as error:
        save_netcdf(tmp_path / "no" / "a.nc", traced)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("missing", ["xarray", "h5netcdf", "h5py"])
def test_missing_package_is_reported_with_its_remedy(
    traced: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(OutputError, match=missing) as error:
        save_netcdf(tmp_path / "a.nc", traced)
    assert str(error.value).endswith(PACKAGES[missing].command)
    assert list(tmp_path.iterdir()) == []
