"""Tables of a network: units of their columns, marks beside powers, and true angles at the ends of the range."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis.network import NetworkCalibrations, calibrated_network, network_readings
from solen.analysis.network.file import text_of
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.pipeline.bench.decode import decode
from tests.bench.network_support import EMITTERS, RECEIVERS, light

NAMES = [f"{lit}.{read}" for lit in EMITTERS for read in RECEIVERS]


def rows(states: FloatArray, seed: int) -> FloatArray:
    """Time, angles and readings in V of a network that rests in states for 12 turns each."""
    angle = np.repeat(states, 12, axis=0)
    signal = -light(*angle.T).reshape(len(angle), -1)
    signal = signal + 3e-4 * np.random.default_rng(seed).standard_normal(signal.shape)
    return np.column_stack([np.arange(len(angle)) / 100.0, angle, signal])


def table(path: Path, values: FloatArray, units: tuple[str, ...] = ("V",), **more: Any) -> Path:
    """A table in units, the last one that of all further powers, with further columns by their names."""
    units = (*units, *units[-1:] * (len(NAMES) - len(units)))
    scale = [{"V": 1.0, "mV": 1e3, "uA": 1.0, "mA": 1e-3, "A": 1e-6, "B": 1.0, "": 1.0}[unit] for unit in units]
    head = ["time_s", "lean_deg", "sway_deg", *(f"{n}_{u}".rstrip("_") for n, u in zip(NAMES, units, strict=True))]
    beside = [np.broadcast_to(one, len(values)) for one in more.values()]
    whole = np.column_stack([values[:, :3], values[:, 3:] * scale, *beside])
    np.savetxt(path, whole, "%.9g", ",", header=",".join([*head, *more]), comments="")
    return path


def grid() -> FloatArray:
    mesh = np.meshgrid(np.linspace(-10.0, 10.0, 5), np.linspace(-8.0, 8.0, 5), indexing="ij")
    return np.stack(mesh, axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, NetworkCalibrations]:
    folder = tmp_path_factory.mktemp("table")
    made = calibrated_network([network_readings(table(folder / "known.csv", rows(grid(), 0)))])
    file = folder / "known.calibration.json"
    file.write_text(text_of(made.calibration), encoding="utf-8")
    return file, made


def angles(file: Path, source: Path) -> tuple[list[str], list[str]]:
    """Rows that a table and the same lines are decoded to."""
    outs = source.with_name("file.csv"), source.with_name("lines.csv")
    decode(file, str(source), out=outs[0], force=True)
    decode(file, "-", text=source.read_text(encoding="utf-8").splitlines(), out=outs[1], force=True)
    first, second = (out.read_text(encoding="utf-8").splitlines() for out in outs)
    return first, second


@pytest.mark.parametrize("units", [("mV", "V", "V", "V"), ("V", "V", "mV", "V"), ("mV",)])
def test_each_column_has_its_own_unit(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path, units: tuple[str, ...]
) -> None:
    values = rows(grid()[::6] * 0.7, 1)
    path = table(tmp_path / "mixed.csv", values, units)
    found = network_readings(path)
    assert found.unit == "V"
    assert found.signal.reshape(len(values), -1) == pytest.approx(values[:, 3:], abs=1e-8)
    of_file, of_lines = angles(calibration[0], path)
    assert of_file == of_lines


@pytest.mark.parametrize("units", [("uA", "V", "V", "V"), ("V", "mA", "V", "uA"), ("mV", "", "V", "V")])
def test_units_of_different_quantities_are_refused(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path, units: tuple[str, ...]
) -> None:
    path = table(tmp_path / "odd.csv", rows(grid()[:2], 1), units)
    for call in (
        lambda: network_readings(path),
        lambda: decode(calibration[0], "-", text=path.read_text(encoding="utf-8").splitlines()),
    ):
        with pytest.raises(DataError, match=r"[ab]\.(end|side|right)") as refused:
            call()
        assert "\n" not in str(refused.value)


def test_lines_without_a_unit_are_in_volts_as_a_file_is(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    path = table(tmp_path / "bare.csv", rows(grid()[::6] * 0.7, 1), ("",))
    text = path.read_text(encoding="utf-8").splitlines()
    whole = [decode(calibration[0], source, text=text).result.warnings for source in (str(path), "-")]
    assert all(lines.count("no unit is specified for the powers; V is assumed") == 1 for lines in whole)
    in_A = calibration[1].calibration.model_copy(update={"unit": "A"})
    file = tmp_path / "in_A.json"
    file.write_text(text_of(in_A), encoding="utf-8")
    for source in (str(path), "-"):
        with pytest.raises(DataError, match="contains readings in V, but the calibration is in A"):
            decode(file, source, text=text)


def test_currents_are_taken_to_one_unit(tmp_path: Path) -> None:
    values = rows(grid()[:2], 1)
    found = network_readings(table(tmp_path / "currents.csv", values, ("uA", "mA", "uA", "uA")))
    assert found.unit == "uA"
    assert found.signal.reshape(len(values), -1) == pytest.approx(values[:, 3:], abs=1e-8)


def test_amperes_are_read_where_all_powers_are_in_them(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    values = rows(grid()[:2], 1)
    path = table(tmp_path / "amperes.csv", values, ("A",))
    found = network_readings(path)
    assert (found.unit, found.receivers) == ("A", RECEIVERS)
    assert found.signal.reshape(len(values), -1) == pytest.approx(1e-6 * values[:, 3:], abs=1e-13)
    for source, text in ((str(path), None), ("-", path.read_text(encoding="utf-8").splitlines())):
        with pytest.raises(DataError, match="A"):
            decode(calibration[0], source, text=text)
    lettered = network_readings(table(tmp_path / "letters.csv", values, ("A", "B", "B", "A", "B", "B")))
    assert lettered.unit == "V"  # assumed, since none is stated
    assert all(name.endswith(("_A", "_B")) for name in lettered.receivers)


def test_marks_of_clipping_are_read_and_reported(calibration: tuple[Path, NetworkCalibrations], tmp_path: Path) -> None:
    values = rows(grid()[::6] * 0.7, 1)
    marks = (np.arange(len(values)) % 12 == 6).astype(float)
    path = table(tmp_path / "clipped.csv", values, u_lean_deg=0.01, **{f"{NAMES[0]}_clipped": marks})
    found = network_readings(path)
    assert found.motions == ("lean", "sway")
    assert found.clipped[:, 0, 0].tolist() == (marks == 1.0).tolist()
    assert not found.clipped[:, 1].any()
    for source, text in ((str(path), None), ("-", path.read_text(encoding="utf-8").splitlines())):
        decoded = decode(calibration[0], source, text=text).result
        assert decoded.clipped == marks.sum()
        assert any(f"{marks.sum():.0f} readings" in line for line in decoded.warnings)


def test_ambient_light_beside_powers_is_used_or_refused(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    values = rows(grid()[:2], 1)
    beside: dict[str, Any] = {f"{name}_ambient_V": 0.01 for name in NAMES}
    found = network_readings(table(tmp_path / "all.csv", values, **beside))
    assert (found.ambient, found.receivers) == ("subtracted", RECEIVERS)
    warm: dict[str, Any] = {"ambient (K)": 294.0}
    temperature = network_readings(table(tmp_path / "warm.csv", values, **warm))
    assert temperature.ambient is None
    odd: tuple[dict[str, Any], ...] = {f"{NAMES[0]}_ambient": 0.01}, {"ambient_mV": 0.01}, {"c.left_clipped": 0.0}
    for bad in odd:
        path = table(tmp_path / "some.csv", values, **bad)
        for call in (
            lambda path=path: network_readings(path),
            lambda path=path: decode(calibration[0], "-", text=path.read_text(encoding="utf-8").splitlines()),
        ):
            with pytest.raises(DataError, match=r"ambient|c\.left_clipped"):
                call()


def test_a_stage_that_stops_just_beyond_the_range_is_counted_at_its_end(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    """Bands end where the range ends: a true angle a millionth of the range beyond it lay within none."""
    ends = np.array([[10.0, 8.0], [10.0, 0.0], [0.0, 8.0], [-10.0, -8.0]])
    span = np.array([20.0, 16.0])
    path = table(tmp_path / "end.csv", rows(ends + 8e-7 * span * np.sign(ends), 5))
    for one in decode(calibration[0], str(path)).result.against:  # type: ignore[union-attr]
        assert one.within_95 > 0.85, one
