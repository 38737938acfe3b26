"""Stress and strain from records: columns, signs, units, lengths, and refusals in one line."""

import numpy as np
import pytest

from solen.errors import DataError, SolenError
from solen.material.stiffness import Dimensions, StressStrain, read_test, specimen_of
from solen.material.stiffness.modes import TestMode
from solen.recording import Channel, Provenance, Recording

STRAIN = np.linspace(0, 0.4, 81)
CUBE = Dimensions(cube_mm=10)


def recording(metadata: dict[str, str] | None = None, **columns: tuple[str, np.ndarray]) -> Recording:
    """Return a recording of columns, each a unit and values, keyed by quantity."""
    return recording_of(columns, metadata)


def recording_of(columns: dict[str, tuple[str, np.ndarray]], metadata: dict[str, str] | None = None) -> Recording:
    """Return a recording of a dictionary of columns."""
    named = {name.replace("_", " "): column for name, column in columns.items()}
    channels = tuple(Channel(name, name, unit, np.asarray(values)) for name, (unit, values) in named.items())
    return Recording(channels, Provenance(file="test.csv", metadata=metadata or {}))


def evaluated(
    source: Recording, dimensions: Dimensions | None = None, mode: TestMode | None = None, compliance: float = 0.0
) -> StressStrain:
    return read_test(source, specimen_of(dimensions or Dimensions(), source.provenance.metadata), mode, compliance)


def force(strain: np.ndarray) -> np.ndarray:
    return np.asarray(120 * strain * (1 + strain))


@pytest.mark.parametrize(("force_sign", "displacement_sign"), [(1, 1), (-1, -1), (1, -1), (-1, 1)])
def test_compression_of_a_cube_is_negative_for_any_sign_convention(force_sign: int, displacement_sign: int) -> None:
    source = recording(force=("N", force_sign * force(STRAIN)), displacement=("mm", displacement_sign * 10 * STRAIN))
    test = evaluated(source, CUBE)
    assert test.loading == "compression"
    np.testing.assert_allclose(test.strain, -STRAIN, atol=1e-15)
    np.testing.assert_allclose(test.stress_MPa, -force(STRAIN) / 100)
    signs = ("negative", "positive")
    assert f"{signs[displacement_sign > 0]} strain and {signs[force_sign > 0]} force" in test.notes[0]
    assert test.from_displacement
    assert test.area_used


def test_signs_and_metadata_determine_the_mode() -> None:
    columns = {"force": ("N", force(STRAIN)), "displacement": ("mm", 10 * STRAIN)}
    negative = recording(force=("N", -force(STRAIN)), displacement=("mm", -10 * STRAIN))
    dimensions = Dimensions(area_mm2=100, length_mm=10)
    assert evaluated(negative, dimensions).loading == "compression"
    assert evaluated(recording_of(columns, {"Type of test": "Compression"}), dimensions).loading == "compression"
    specified = evaluated(recording_of(columns, {"Prüfnorm": "Zugversuch"}), dimensions)
    assert (specified.loading, specified.warnings) == ("tension", ())
    assumed = evaluated(recording_of(columns), dimensions)
    assert assumed.loading == "tension"
    assert "--mode compression" in assumed.warnings[0]
    assert evaluated(recording_of(columns), dimensions, "compression").loading == "compression"


def test_refuses_contradictory_signs_without_a_mode() -> None:
    source = recording(force=("N", force(STRAIN)), displacement=("mm", -10 * STRAIN))
    with pytest.raises(DataError, match="--mode tension or --mode compression"):
        evaluated(source, Dimensions(area_mm2=100, length_mm=10))


def test_tension_and_compression_keep_their_signs() -> None:
    strain = np.linspace(-0.4, 1.0, 141)
    test = evaluated(recording(stress=("MPa", strain), strain=("1", strain)))
    assert test.loading == "both"
    np.testing.assert_array_equal(test.strain, strain)
    with pytest.raises(DataError, match="opposite signs on both sides of zero"):
        evaluated(recording(stress=("MPa", -strain), strain=("1", strain)))


def test_units_are_converted() -> None:
    test = evaluated(
        recording(force=("kN", force(STRAIN) / 1e3), displacement=("µm", 1e4 * STRAIN)),
        Dimensions(area_mm2=100, length_mm=10),
    )
    np.testing.assert_allclose(test.strain, STRAIN)
    np.testing.assert_allclose(test.stress_MPa, force(STRAIN) / 100)
    test = evaluated(recording(stress=("kPa", 1e3 * STRAIN), strain=("%", 100 * STRAIN)))
    np.testing.assert_allclose(test.stress_MPa, STRAIN)
    np.testing.assert_allclose(test.strain, STRAIN)


def test_true_and_engineering() -> None:
    """Incompressible: σ = Pλ and ε = ln λ, and the reverse for a file that contains only true values."""
    test = evaluated(recording(stress=("MPa", STRAIN**2), strain=("1", STRAIN)))
    np.testing.assert_allclose(test.true_strain, np.log1p(STRAIN))
    np.testing.assert_allclose(test.true_stress_MPa, STRAIN**2 * (1 + STRAIN))
    reverse = evaluated(recording(true_stress=("MPa", test.true_stress_MPa), true_strain=("1", test.true_strain)))
    np.testing.assert_allclose(reverse.stress_MPa, test.stress_MPa)
    np.testing.assert_allclose(reverse.strain, STRAIN)
    stretched = evaluated(recording(stress=("MPa", STRAIN**2), stretch=("1", 1 + STRAIN)))
    np.testing.assert_allclose(stretched.strain, STRAIN, atol=1e-15)


def test_the_crosshead_position_is_relative_to_its_first_point() -> None:
    test = evaluated(
        recording(force=("N", force(STRAIN)), crosshead=("mm", 785 + 10 * STRAIN)),
        Dimensions(area_mm2=100, length_mm=10),
    )
    np.testing.assert_allclose(test.strain, STRAIN, atol=1e-12)


def test_the_strain_in_the_file_is_used_unless_a_length_is_specified() -> None:
    columns = {"force": ("N", force(STRAIN)), "displacement": ("mm", 80 * STRAIN), "strain": ("%", 100 * STRAIN)}
    source = recording_of(columns, {"Einspannlänge": "832 mm"})
    test = evaluated(source, Dimensions(area_mm2=100))
    np.testing.assert_allclose(test.strain, STRAIN)
    assert not test.from_displacement
    assert any("80 mm" in warning and "832 mm" in warning for warning in test.warnings)
    specified = evaluated(source, Dimensions(area_mm2=100, length_mm=40))
    np.testing.assert_allclose(specified.strain, 2 * STRAIN)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_compliance_of_the_machine_is_subtracted(sign: int) -> None:
    """A spring in series with the specimen: displacement u + cF."""
    source = recording(force=("N", sign * force(STRAIN)), displacement=("mm", 10 * STRAIN + 0.002 * force(STRAIN)))
    test = evaluated(source, CUBE, compliance=0.002)
    np.testing.assert_allclose(test.strain, -STRAIN, atol=1e-14)
    assert test.compliance_removed


def test_a_preload_in_the_file_is_reported() -> None:
    columns = {"force": ("N", force(STRAIN)), "strain": ("%", 100 * STRAIN)}
    assert evaluated(recording_of(columns, {"Vorkraft": "0.2 N"}), Dimensions(area_mm2=1)).preload == "Vorkraft 0.2 N"
    assert evaluated(recording_of(columns, {"Pre-load": "0 N"}), Dimensions(area_mm2=1)).preload == ""


def test_missing_values_at_the_end_are_omitted() -> None:
    padded = np.concatenate([STRAIN, [np.nan, np.nan]])
    assert len(evaluated(recording(stress=("MPa", padded), strain=("1", padded))).strain) == len(STRAIN)


GAP = np.where(np.arange(81) == 40, np.nan, STRAIN)


@pytest.mark.parametrize(
    ("columns", "dimensions", "line"),
    [
        (
            {"force": ("N", STRAIN), "displacement": ("mm", STRAIN)},
            Dimensions(length_mm=10),
            "area of the specimen; is not",
        ),
        (
            {"force": ("N", STRAIN), "displacement": ("mm", STRAIN)},
            Dimensions(area_mm2=1),
            "length of the specimen; is not",
        ),
        (
            {"force": ("kg", STRAIN), "strain": ("1", STRAIN)},
            Dimensions(area_mm2=1),
            "unit of force = 'kg'; cannot be converted to N",
        ),
        (
            {"force": ("", STRAIN), "strain": ("1", STRAIN)},
            Dimensions(area_mm2=1),
            "unit of force = 'none'; cannot be converted to N",
        ),
        ({"strain": ("1", STRAIN)}, Dimensions(), "has no column of force or stress; its columns are strain"),
        ({"stress": ("MPa", STRAIN)}, Dimensions(), "has no column of displacement, strain or stretch"),
        (
            {"stress": ("MPa", STRAIN), "strain": ("1", GAP)},
            Dimensions(),
            "has no value in 1 of 81 rows, the first of which is row 41",
        ),
        (
            {"stress": ("MPa", STRAIN), "strain": ("1", 0 * STRAIN + 0.1)},
            Dimensions(),
            "strain = 0.1; is the same in every row",
        ),
        (
            {"stress": ("MPa", 0 * STRAIN), "strain": ("1", STRAIN)},
            Dimensions(),
            "stress = 0.0; is the same in every row",
        ),
        ({"stress": ("GPa", 1e5 * STRAIN), "strain": ("1", STRAIN)}, Dimensions(), "exceeds 1e+06 MPa"),
        (
            {"stress": ("MPa", STRAIN[:4]), "strain": ("1", STRAIN[:4])},
            Dimensions(),
            "points = 4; must be at least 5",
        ),
        ({"stress": ("MPa", -STRAIN), "strain": ("1", -4 * STRAIN)}, Dimensions(), "must be above -1"),
    ],
)
def test_refuses_invalid_records_in_one_line(
    columns: dict[str, tuple[str, np.ndarray]], dimensions: Dimensions, line: str
) -> None:
    with pytest.raises(SolenError) as error:
        evaluated(recording_of(columns), dimensions)
    assert line in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_refuses_several_specimens_in_one_table() -> None:
    channels = tuple(Channel(f"force ({n})" if n > 1 else "force", "force", "N", STRAIN) for n in (1, 2, 3))
    source = Recording((*channels, Channel("strain", "strain", "1", STRAIN)), Provenance(file="three.csv"))
    with pytest.raises(DataError, match=r"three.csv; .*3 columns of force: force, force \(2\), force \(3\)"):
        evaluated(source, Dimensions(area_mm2=1))


def test_warns_of_a_strain_that_is_probably_in_per_cent() -> None:
    test = evaluated(recording(stress=("MPa", STRAIN), strain=("", 100 * STRAIN)))
    assert any("4000 %" in warning for warning in test.warnings)
