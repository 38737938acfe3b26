"""Tables of a network: units, columns for clipping and ambient light, and angles at the ends of the range."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis.network import NetworkCalibrations, calibrated_network, network_readings
from solen.analysis.network.file import text_of
from solen.analysis.network.stream_decoder import NetworkDecoding
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.pipeline.bench.decode import decode
from tests.bench.network_support import EMITTERS, RECEIVERS, light

NAMES = [f"{lit}.{read}" for lit in EMITTERS for read in RECEIVERS]


def rows(states: FloatArray, seed: int) -> FloatArray:
    """Return time, angles and readings in V of a network that is in each state for 12 switching cycles."""
    angle = np.repeat(states, 12, axis=0)
    signal = -light(*angle.T).reshape(len(angle), -1)
    signal = signal + 3e-4 * np.random.default_rng(seed).standard_normal(signal.shape)
    return np.column_stack([np.arange(len(angle)) / 100.0, angle, signal])


def table(path: Path, values: FloatArray, units: tuple[str, ...] = ("V",), **more: Any) -> Path:
    """Write a table with given units, the last of which applies to all further powers, and further columns."""
    units = (*units, *units[-1:] * (len(NAMES) - len(units)))
    scale = [{"V": 1.0, "mV": 1e3, "uA": 1.0, "mA": 1e-3, "A": 1e-6, "B": 1.0, "": 1.0}[unit] for unit in units]
    head = ["time_s", "lean_deg", "sway_deg", *(f"{n}_{u}".rstrip("_") for n, u in zip(NAMES, units, strict=True))]
    columns = [np.broadcast_to(column, len(values)) for column in more.values()]
    body = np.column_stack([values[:, :3], values[:, 3:] * scale, *columns])
    np.savetxt(path, body, "%.9g", ",", header=",".join([*head, *more]), comments="")
    return path


def grid() -> FloatArray:
    """Return a grid of 5 × 5 states."""
    mesh = np.meshgrid(np.linspace(-10.0, 10.0, 5), np.linspace(-8.0, 8.0, 5), indexing="ij")
    return np.stack(mesh, axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, NetworkCalibrations]:
    folder = tmp_path_factory.mktemp("table")
    calibrations = calibrated_network([network_readings(table(folder / "states.csv", rows(grid(), 0)))])
    file = folder / "states.calibration.json"
    file.write_text(text_of(calibrations.calibration), encoding="utf-8")
    return file, calibrations


def decoded_rows(file: Path, source: Path) -> tuple[list[str], list[str]]:
    """Return the decoded rows of a table, and of the same lines on standard input."""
    outs = source.with_name("file.csv"), source.with_name("lines.csv")
    decode(file, str(source), out=outs[0], force=True)
    decode(file, "-", text=source.read_text(encoding="utf-8").splitlines(), out=outs[1], force=True)
    of_file, of_lines = (out.read_text(encoding="utf-8").splitlines() for out in outs)
    return of_file, of_lines


@pytest.mark.parametrize("units", [("mV", "V", "V", "V"), ("V", "V", "mV", "V"), ("mV",)])
def test_columns_may_have_different_units(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path, units: tuple[str, ...]
) -> None:
    values = rows(grid()[::6] * 0.7, 1)
    path = table(tmp_path / "mixed.csv", values, units)
    readings = network_readings(path)
    assert readings.unit == "V"
    assert readings.signal.reshape(len(values), -1) == pytest.approx(values[:, 3:], abs=1e-8)
    of_file, of_lines = decoded_rows(calibration[0], path)
    assert of_file == of_lines


@pytest.mark.parametrize("units", [("uA", "V", "V", "V"), ("V", "mA", "V", "uA"), ("mV", "", "V", "V")])
def test_refuses_units_of_different_quantities(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path, units: tuple[str, ...]
) -> None:
    path = table(tmp_path / "mixed.csv", rows(grid()[:2], 1), units)
    for call in (
        lambda: network_readings(path),
        lambda: decode(calibration[0], "-", text=path.read_text(encoding="utf-8").splitlines()),
    ):
        with pytest.raises(DataError, match=r"[ab]\.(end|side|right)") as refused:
            call()
        assert "\n" not in str(refused.value)


def test_assumes_volts_if_no_unit_is_specified(calibration: tuple[Path, NetworkCalibrations], tmp_path: Path) -> None:
    path = table(tmp_path / "without.csv", rows(grid()[::6] * 0.7, 1), ("",))
    text = path.read_text(encoding="utf-8").splitlines()
    warnings = [decode(calibration[0], source, text=text).result.warnings for source in (str(path), "-")]
    assert all(lines.count("no unit is specified for the powers; V is assumed") == 1 for lines in warnings)
    in_A = calibration[1].calibration.model_copy(update={"unit": "A"})
    file = tmp_path / "in_A.json"
    file.write_text(text_of(in_A), encoding="utf-8")
    for source in (str(path), "-"):
        with pytest.raises(DataError, match="contains readings in V, but the calibration is in A"):
            decode(file, source, text=text)


def test_converts_currents_to_one_unit(tmp_path: Path) -> None:
    values = rows(grid()[:2], 1)
    readings = network_readings(table(tmp_path / "currents.csv", values, ("uA", "mA", "uA", "uA")))
    assert readings.unit == "uA"
    assert readings.signal.reshape(len(values), -1) == pytest.approx(values[:, 3:], abs=1e-8)


def test_suffix_A_is_a_unit_only_if_all_powers_have_it(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    values = rows(grid()[:2], 1)
    path = table(tmp_path / "amperes.csv", values, ("A",))
    readings = network_readings(path)
    assert (readings.unit, readings.receivers) == ("A", RECEIVERS)
    assert readings.signal.reshape(len(values), -1) == pytest.approx(1e-6 * values[:, 3:], abs=1e-13)
    for source, text in ((str(path), None), ("-", path.read_text(encoding="utf-8").splitlines())):
        with pytest.raises(DataError, match="A"):
            decode(calibration[0], source, text=text)
    lettered = network_readings(table(tmp_path / "letters.csv", values, ("A", "B", "B", "A", "B", "B")))
    assert lettered.unit == "V"  # assumed, because none is specified
    assert all(name.endswith(("_A", "_B")) for name in lettered.receivers)


def test_reports_clipped_readings(calibration: tuple[Path, NetworkCalibrations], tmp_path: Path) -> None:
    values = rows(grid()[::6] * 0.7, 1)
    clipped = (np.arange(len(values)) % 12 == 6).astype(float)
    path = table(tmp_path / "clipped.csv", values, u_lean_deg=0.01, **{f"{NAMES[0]}_clipped": clipped})
    readings = network_readings(path)
    assert readings.motions == ("lean", "sway")
    assert readings.clipped[:, 0, 0].tolist() == (clipped == 1.0).tolist()
    assert not readings.clipped[:, 1].any()
    for source, text in ((str(path), None), ("-", path.read_text(encoding="utf-8").splitlines())):
        decoded = decode(calibration[0], source, text=text).result
        assert decoded.clipped == clipped.sum()
        assert any(f"{clipped.sum():.0f} readings" in line for line in decoded.warnings)


def test_columns_of_ambient_light_are_complete_or_refused(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    values = rows(grid()[:2], 1)
    complete: dict[str, Any] = {f"{name}_ambient_V": 0.01 for name in NAMES}
    readings = network_readings(table(tmp_path / "all.csv", values, **complete))
    assert (readings.ambient, readings.receivers) == ("subtracted", RECEIVERS)
    temperature: dict[str, Any] = {"ambient (K)": 294.0}
    assert network_readings(table(tmp_path / "temperature.csv", values, **temperature)).ambient is None
    invalid: tuple[dict[str, Any], ...] = {f"{NAMES[0]}_ambient": 0.01}, {"ambient_mV": 0.01}, {"c.left_clipped": 0.0}
    for columns in invalid:
        path = table(tmp_path / "some.csv", values, **columns)
        for call in (
            lambda path=path: network_readings(path),
            lambda path=path: decode(calibration[0], "-", text=path.read_text(encoding="utf-8").splitlines()),
        ):
            with pytest.raises(DataError, match=r"ambient|c\.left_clipped"):
                call()


def test_angle_slightly_outside_the_range_is_compared_as_at_its_end(
    calibration: tuple[Path, NetworkCalibrations], tmp_path: Path
) -> None:
    """Bands end where the range ends, so no band contains an angle that is a millionth of the range outside it."""
    ends = np.array([[10.0, 8.0], [10.0, 0.0], [0.0, 8.0], [-10.0, -8.0]])
    span = np.array([20.0, 16.0])
    path = table(tmp_path / "end.csv", rows(ends + 8e-7 * span * np.sign(ends), 5))
    decoding = decode(calibration[0], str(path)).result
    assert isinstance(decoding, NetworkDecoding)
    for check in decoding.against:
        assert check.within_95 > 0.85, check
