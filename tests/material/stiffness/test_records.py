"""From records to stress and strain: columns, signs, units, lengths, and every bad record refused in one line."""

import numpy as np
import pytest

from solen.errors import DataError, SolenError
from solen.material.stiffness import Dimensions, StressStrain, read_test, specimen_of
from solen.material.stiffness.modes import TestMode
from solen.recording import Channel, Provenance, Recording

STRAIN = np.linspace(0, 0.4, 81)
CUBE = Dimensions(cube_mm=10)


def recording(metadata: dict[str, str] | None = None, **columns: tuple[str, np.ndarray]) -> Recording:
    """Columns, each with its unit, named by their quantity."""
    return recorded(columns, metadata)


def recorded(columns: dict[str, tuple[str, np.ndarray]], metadata: dict[str, str] | None = None) -> Recording:
    """The same of a dictionary."""
    named = {name.replace("_", " "): column for name, column in columns.items()}
    channels = tuple(Channel(name, name, unit, np.asarray(values)) for name, (unit, values) in named.items())
    return Recording(channels, Provenance(file="test.csv", metadata=metadata or {}))


def of(
    made: Recording, stated: Dimensions | None = None, mode: TestMode | None = None, compliance: float = 0.0
) -> StressStrain:
    return read_test(made, specimen_of(stated or Dimensions(), made.provenance.metadata), mode, compliance)


def force(strain: np.ndarray) -> np.ndarray:
    return np.asarray(120 * strain * (1 + strain))


@pytest.mark.parametrize(("of_force", "of_travel"), [(1, 1), (-1, -1), (1, -1), (-1, 1)])
def test_a_compressed_cube_is_negative_whatever_the_export(of_force: int, of_travel: int) -> None:
    made = recording(force=("N", of_force * force(STRAIN)), displacement=("mm", of_travel * 10 * STRAIN))
    found = of(made, CUBE)
    assert found.loading == "compression"
    np.testing.assert_allclose(found.strain, -STRAIN, atol=1e-15)
    np.testing.assert_allclose(found.stress_MPa, -force(STRAIN) / 100)
    exported = ("negative", "positive")
    assert f"{exported[of_travel > 0]} strain and {exported[of_force > 0]} force" in found.notes[0]
    assert found.from_displacement
    assert found.area_used


def test_signs_tell_compression_and_words_do() -> None:
    both = {"force": ("N", force(STRAIN)), "displacement": ("mm", 10 * STRAIN)}
    negative = recording(force=("N", -force(STRAIN)), displacement=("mm", -10 * STRAIN))
    sized = Dimensions(area_mm2=100, length_mm=10)
    assert of(negative, sized).loading == "compression"
    assert of(recorded(both, {"Type of test": "Compression"}), sized).loading == "compression"
    told = of(recorded(both, {"Prüfnorm": "Zugversuch"}), sized)
    assert (told.loading, told.warnings) == ("tension", ())
    silent = of(recorded(both), sized)
    assert silent.loading == "tension"
    assert "--mode compression" in silent.warnings[0]
    assert of(recorded(both), sized, "compression").loading == "compression"


def test_signs_that_contradict_are_asked_about() -> None:
    made = recording(force=("N", force(STRAIN)), displacement=("mm", -10 * STRAIN))
    with pytest.raises(
        DataError, match="may be tension or compression; specify it: --mode tension or --mode compression"
    ):
        of(made, Dimensions(area_mm2=100, length_mm=10))


def test_both_directions_keep_their_signs() -> None:
    strain = np.linspace(-0.4, 1.0, 141)
    found = of(recording(stress=("MPa", strain), strain=("1", strain)))
    assert found.loading == "both"
    np.testing.assert_array_equal(found.strain, strain)
    with pytest.raises(DataError, match="opposite signs on both sides of zero"):
        of(recording(stress=("MPa", -strain), strain=("1", strain)))


def test_units_are_converted() -> None:
    found = of(
        recording(force=("kN", force(STRAIN) / 1e3), displacement=("µm", 1e4 * STRAIN)),
        Dimensions(area_mm2=100, length_mm=10),
    )
    np.testing.assert_allclose(found.strain, STRAIN)
    np.testing.assert_allclose(found.stress_MPa, force(STRAIN) / 100)
    found = of(recording(stress=("kPa", 1e3 * STRAIN), strain=("%", 100 * STRAIN)))
    np.testing.assert_allclose(found.stress_MPa, STRAIN)
    np.testing.assert_allclose(found.strain, STRAIN)


def test_true_and_engineering() -> None:
    """Incompressible: σ = Pλ and ε = ln λ, and back from a file that holds only true ones."""
    found = of(recording(stress=("MPa", STRAIN**2), strain=("1", STRAIN)))
    np.testing.assert_allclose(found.true_strain, np.log1p(STRAIN))
    np.testing.assert_allclose(found.true_stress_MPa, STRAIN**2 * (1 + STRAIN))
    back = of(recording(true_stress=("MPa", found.true_stress_MPa), true_strain=("1", found.true_strain)))
    np.testing.assert_allclose(back.stress_MPa, found.stress_MPa)
    np.testing.assert_allclose(back.strain, STRAIN)
    stretched = of(recording(stress=("MPa", STRAIN**2), stretch=("1", 1 + STRAIN)))
    np.testing.assert_allclose(stretched.strain, STRAIN, atol=1e-15)


def test_a_crossheads_position_counts_from_its_first_point() -> None:
    found = of(
        recording(force=("N", force(STRAIN)), crosshead=("mm", 785 + 10 * STRAIN)),
        Dimensions(area_mm2=100, length_mm=10),
    )
    np.testing.assert_allclose(found.strain, STRAIN, atol=1e-12)


def test_the_files_strain_is_used_unless_the_user_states_a_length() -> None:
    columns = {"force": ("N", force(STRAIN)), "displacement": ("mm", 80 * STRAIN), "strain": ("%", 100 * STRAIN)}
    made = recorded(columns, {"Einspannlänge": "832 mm"})
    found = of(made, Dimensions(area_mm2=100))
    np.testing.assert_allclose(found.strain, STRAIN)
    assert not found.from_displacement
    assert "strain is displacement over 80 mm, but the file specifies a length of 832 mm" in " ".join(found.warnings)
    stated = of(made, Dimensions(area_mm2=100, length_mm=40))
    np.testing.assert_allclose(stated.strain, 2 * STRAIN)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_the_machine_gives_way_is_taken_off(sign: int) -> None:
    """A spring in series with the specimen: displacement u + cF."""
    pressed = sign * force(STRAIN)
    made = recording(force=("N", pressed), displacement=("mm", 10 * STRAIN + 0.002 * force(STRAIN)))
    found = of(made, CUBE, compliance=0.002)
    np.testing.assert_allclose(found.strain, -STRAIN, atol=1e-14)
    assert found.compliance_removed


def test_a_preload_is_found() -> None:
    columns = {"force": ("N", force(STRAIN)), "strain": ("%", 100 * STRAIN)}
    assert of(recorded(columns, {"Vorkraft": "0.2 N"}), Dimensions(area_mm2=1)).preload == "Vorkraft 0.2 N"
    assert of(recorded(columns, {"Pre-load": "0 N"}), Dimensions(area_mm2=1)).preload == ""


def test_missing_numbers_at_the_end_are_left_out() -> None:
    longer = np.concatenate([STRAIN, [np.nan, np.nan]])
    assert len(of(recording(stress=("MPa", longer), strain=("1", longer))).strain) == len(STRAIN)


GAP = np.where(np.arange(81) == 40, np.nan, STRAIN)


@pytest.mark.parametrize(
    ("columns", "stated", "told"),
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
        ({"stress": ("GPa", 1e5 * STRAIN), "strain": ("1", STRAIN)}, Dimensions(), "is beyond 1e+06 MPa"),
        (
            {"stress": ("MPa", STRAIN[:4]), "strain": ("1", STRAIN[:4])},
            Dimensions(),
            "points = 4; at least 5 are needed",
        ),
        ({"stress": ("MPa", -STRAIN), "strain": ("1", -4 * STRAIN)}, Dimensions(), "must remain above -1"),
    ],
)
def test_bad_records_are_refused_in_one_line(
    columns: dict[str, tuple[str, np.ndarray]], stated: Dimensions, told: str
) -> None:
    with pytest.raises(SolenError) as refused:
        of(recorded(columns), stated)
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_two_specimens_side_by_side_are_not_mixed_up() -> None:
    channels = tuple(Channel(f"force ({n})" if n > 1 else "force", "force", "N", STRAIN) for n in (1, 2, 3))
    made = Recording((*channels, Channel("strain", "strain", "1", STRAIN)), Provenance(file="three.csv"))
    with pytest.raises(DataError, match=r"three.csv; has 3 columns of force: force, force \(2\), force \(3\)"):
        of(made, Dimensions(area_mm2=1))


def test_a_strain_in_per_cent_without_its_unit_is_warned_of() -> None:
    found = of(recording(stress=("MPa", STRAIN), strain=("", 100 * STRAIN)))
    assert "4000 %: check that it is not in per cent" in " ".join(found.warnings)
