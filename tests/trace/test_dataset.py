"""A trace as a data set: everything that it holds, by name and with a unit, in memory and in a file."""

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
from solen.trace.result import LEG, Crossed

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)

SAME = (
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
WHERE = {
    **{name: f"attribute {name}" for name in ("mode", "method", "why")},
    **{name: name for name in SAME},
    "detectors": "power",
    "monitors": "net_power",
    "legs": "leg_ray",
    "undefined_at_mm": "undefined_x_mm",
    "truncated_at_mm": "truncated_z_mm",
}
"""Where each field of a trace is found."""
OF_RECEIVER = {
    "power": "power",
    "u_power": "power_u",
    "rays": "arrived",
    "power_by_source": "power_by_source",
    "optical_path_mm": "optical_path_mm",
    "power_by_position": "power_by_position",
    "power_by_angle": "power_by_angle",
}
OF_MONITOR = {"power": "net_power", "u_power": "net_power_u", "rays": "crossings", "power_by_bin": "net_power_by_bin"}


def everything() -> Scene:
    """Two sources under two receivers of different make, two mirrors, and a face to a medium that no ray is in."""
    up: list[tuple[str, float, float, str]] = [("left half", 0.0, -2.0, "wide"), ("right half", 2.0, 0.0, "wide")]
    up += [("alone", 4.0, 3.0, "narrow")]
    receivers = [Interface(n, Segment((a, 5.0), (b, 5.0)), "air", "air", "receiver", who) for n, a, b, who in up]
    ends = {"above": ((-3.0, 4.0), (-4.0, 4.0)), "below": ((-10.0, -1.0), (-8.0, -1.0))}
    mirrors = [Interface(name, Segment(a, b), "air", "air", "mirror") for name, (a, b) in ends.items()]
    odd = Interface("odd", Segment((-8.0, -1.0), (-6.0, -1.0)), "glass", "air")
    sources = (Fan((0.0, 0.0), 0.0, 110.0, 200, power=3.0), Beam((1.0, 1.0), (3.5, 1.0), 0.0, 50))
    monitors = (Monitor("fine", (5.0, 2.0), (-5.0, 2.0), 3), Monitor("whole", (-1.0, 3.0), (1.0, 3.0)))
    return Scene((AIR, GLASS), (*receivers, *mirrors, odd), sources, monitors, open_media=True)


@pytest.fixture(scope="module")
def whole() -> Trace:
    """A trace that has something of everything: a ray is cut at the second mirror."""
    return trace(everything(), "power", Limits(max_hits=2), position_bins=4, angle_bins=6, legs=True)


def same(one: object, other: object) -> bool:
    return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float), equal_nan=True))


def test_every_field_of_a_trace_is_there(whole: Trace) -> None:
    found = whole.to_dataset()
    assert {field.name for field in dataclasses.fields(Trace)} == WHERE.keys()
    assert {field.name for field in dataclasses.fields(Detected)} == OF_RECEIVER.keys()
    assert {field.name for field in dataclasses.fields(Crossed)} == OF_MONITOR.keys()
    for name in (*WHERE.values(), *OF_RECEIVER.values(), *OF_MONITOR.values()):
        kind, _, attribute = name.partition(" ")
        assert (attribute in found.attrs) if kind == "attribute" else (name in found), name
    assert {f"leg_{name}" for name in LEG.names or ()} <= set(found)


def test_receivers_are_those_of_the_trace(whole: Trace) -> None:
    found = whole.to_dataset()
    assert set(whole.detectors) == {"wide", "narrow"}
    for name, reading in whole.detectors.items():
        assert reading.power > 0.0
        one = found.sel(receiver=name)
        for field, variable in OF_RECEIVER.items():
            values = one[variable].values
            if field == "power_by_position":
                faces = len(reading.power_by_position)
                assert np.isnan(values[faces:]).all()
                values = values[:faces]
            assert same(values, getattr(reading, field)), (name, field)
    assert found["power_by_position"].dims == ("receiver", "face", "position_bin")
    assert list(found["position_bin"].values) == [0.125, 0.375, 0.625, 0.875]
    assert list(found["angle_bin"].values) == [-75.0, -45.0, -15.0, 15.0, 45.0, 75.0]
    for part, dimension in (("angle", "angle_bin"), ("source", "source"), ("position", ("face", "position_bin"))):
        assert np.allclose(found[f"power_by_{part}"].sum(dimension), found["power"], rtol=0.0, atol=1e-12)


def test_monitors_ledger_places_and_legs_are_those_of_the_trace(whole: Trace) -> None:
    found = whole.to_dataset()
    for name, crossed in whole.monitors.items():
        one = found.sel(monitor=name)
        for field, variable in OF_MONITOR.items():
            values = np.atleast_1d(one[variable].values)
            wanted = np.atleast_1d(getattr(crossed, field))
            assert same(values[: len(wanted)], wanted), (name, field)
            assert np.isnan(values[len(wanted) :]).all()
    for part in ("detected", "escaped", "absorbed", "truncated"):
        assert float(found["ledger"].sel(fate=part)) == getattr(whole.ledger, part)
    assert float(found["ledger"].sum()) == pytest.approx(1.0, abs=1e-12)
    assert (int(found["rays"]), int(found["hits"])) == (whole.rays, whole.hits)
    for kind, places in (("undefined", whole.undefined_at_mm), ("truncated", whole.truncated_at_mm)):
        assert int(found[kind]) == getattr(whole, kind) > 0
        assert len(places) > 0
        assert same(np.column_stack([found[f"{kind}_x_mm"], found[f"{kind}_z_mm"]]), places)
    assert whole.legs is not None
    for name in LEG.names or ():
        assert same(found[f"leg_{name}"], whole.legs[name])


def test_every_variable_says_what_it_is_and_in_what_unit(whole: Trace) -> None:
    found = whole.to_dataset()
    for name, variable in found.variables.items():
        assert variable.attrs["long_name"], name
        if variable.dtype.kind in "if":
            unit = variable.attrs["units"]
            assert unit == ("mm" if str(name).endswith("_mm") else "degree" if name == "angle_bin" else "1"), name


def test_it_says_that_it_is_simulated_and_by_what(whole: Trace) -> None:
    told = whole.to_dataset({"name": "mine", "angle_deg": 0.5, "simulated": 0}).attrs
    assert (told["simulated"], told["source"]) == (1, f"solen {solen.__version__}")
    assert (told["mode"], told["method"]) == ("power", "fan")
    assert (told["name"], told["angle_deg"]) == ("mine", 0.5)


def test_what_a_trace_has_nothing_of_has_no_dimension() -> None:
    bare = Scene((AIR,), (Interface("wall", Segment((1.0, 5.0), (-1.0, 5.0)), "air", "air", "absorbing"),),
                 (Fan((0.0, 0.0), 0.0, 10.0, 8),))  # fmt: skip
    found = trace(bare).to_dataset()
    assert set(found.sizes) == {"fate"}
    assert np.isnan(float(found["single_error"]))
    assert not set(found) & {"power", "net_power", "leg_ray", "undefined_x_mm", "power_by_position"}


@pytest.mark.parametrize("way", ["integrate", "reference", "single", "sobol"])
def test_traces_of_all_kinds_become_data_sets(way: str, tmp_path: Path) -> None:
    wall = Interface("wall", Segment((1.0, 5.0), (-1.0, 5.0)), "air", "air", "receiver", "right")
    scene = Scene((AIR,), (wall,), (Fan((0.0, 0.0), 0.0, 40.0, 64),))
    done = {
        "integrate": lambda: integrate(scene, "power", 1e-6),
        "reference": lambda: trace_reference(scene, "power"),
        "single": lambda: trace(scene, "power", precision="single"),
        "sobol": lambda: trace(scene, "roulette", sampling="sobol", seed=3),
    }[way]()
    found = to_dataset(done)
    assert found.attrs["method"] == done.method
    assert float(found["power"].sel(receiver="right")) == done.detectors["right"].power
    assert np.isnan(float(found["single_error"])) == (way != "single")
    assert read(save_netcdf(tmp_path / "a.nc", done)).identical(found)


def read(path: Path) -> xr.Dataset:
    return xr.load_dataset(path, engine="h5netcdf")


def test_a_file_gives_back_what_was_written(whole: Trace, tmp_path: Path) -> None:
    about: dict[str, str | int | float] = {"name": "Ω – 1", "angle_deg": -3.0}
    target = tmp_path / "a trace.nc"
    assert save_netcdf(target, whole, about) == target
    assert read(target).identical(whole.to_dataset(about))
    first = target.read_bytes()
    save_netcdf(str(target), whole, about)
    assert target.read_bytes() == first
    assert list(tmp_path.iterdir()) == [target]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    whole: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "a.nc"
    target.write_bytes(b"old")

    def fails(_: xr.Dataset, path: Path, **__: object) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", fails)
    with pytest.raises(OutputError, match="No space left on device"):
        save_netcdf(target, whole)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_is_not_there_is_one_line(whole: Trace, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written") as refusal:
        save_netcdf(tmp_path / "no" / "a.nc", whole)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("missing", ["xarray", "h5netcdf", "h5py"])
def test_what_is_not_installed_is_reported_with_its_remedy(
    whole: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(OutputError, match=f"needs {missing}") as refusal:
        save_netcdf(tmp_path / "a.nc", whole)
    assert str(refusal.value).endswith(PACKAGES[missing].command)
    assert list(tmp_path.iterdir()) == []
