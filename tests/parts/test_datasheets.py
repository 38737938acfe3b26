"""Parts: the shipped datasheets are valid, files are checked strictly, and a part defines a design's emitter."""

import math
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError, SpecError
from solen.parts import EmitterPart, Light, ReceiverPart, library, library_part, light_of, load_part
from solen.parts.light import FWHM_PER_SIGMA, gaussian_lines
from solen.scene import PatternTable
from solen.spec import Design, dumps, load, loads, save, with_values

PART = """
schema = 1
name = "Mine"
kind = "emitter"
maker = "me"
document = "my notes"

[peak_nm]
typical = 940
basis = "measured"
source = "spectrometer"

[width_mm]
min = 0.2
max = 0.3
basis = "measured"
source = "microscope"

[pattern]
angle_deg = [0, 45, 90]
relative = [1, 0.6, 0]
basis = "measured"
source = "goniometer"
"""


def design(**emitter: object) -> Design:
    return Design(name="one", material={"index": 1.44}, emitter=emitter)


def test_every_shipped_part_is_valid_and_names_its_document() -> None:
    by_vishay = {"TEMT7000X01", "TEMT7100X01", "VSMY1850"}
    emitters = {"SFH4250", "generic-500", "generic-450"}
    assert set(library()) == by_vishay | emitters | {"ATmega328P", "TC33X-2-202E", "USB-6218", "mcu-12bit"}
    for name in library():
        part = library_part(name)
        assert part.name == name
        assert "Vishay document" in part.document or name not in by_vishay


def test_the_emitter_has_side_light() -> None:
    """Half of the axial intensity at 60°, and 5.0 sr in total (50 mW at 10 mW/sr); a Lambertian emitter has 3.14 sr."""
    part = library_part("VSMY1850")
    assert isinstance(part, EmitterPart)
    pattern = PatternTable(part.pattern.angle_deg, part.pattern.relative)
    assert float(pattern.intensity(np.radians([60.0]))[0]) == pytest.approx(0.5, abs=1e-12)
    assert part.power_mw is not None
    assert part.intensity_mw_per_sr is not None
    solid_angle_sr = part.power_mw.nominal / part.intensity_mw_per_sr.nominal
    assert pattern.solid_angle_sr(math.pi) == pytest.approx(solid_angle_sr, abs=0.01)
    assert (part.peak_nm.nominal, part.pattern.basis) == (850.0, "estimate")


def test_the_sensitivity_of_receivers_varies_by_a_factor_of_three() -> None:
    part = library_part("TEMT7100X01")
    assert isinstance(part, ReceiverPart)
    current = part.current_ua_per_mw_cm2
    assert current.min is not None
    assert current.max is not None
    assert (current.max / current.min, current.nominal) == pytest.approx((3.0, 450.0))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "emitter"', 'kind = "lamp"', "kind = 'lamp'; must be one of emitter, receiver, adc, trimmer"),
        ('kind = "emitter"\n', "", "kind; must be one of emitter, receiver, adc, trimmer; add for example kind"),
        ('maker = "me"\n', "", "maker; is missing"),
        ("typical = 940\n", "", "peak_nm; has no value"),
        (
            "typical = 940",
            "typical = 940\nmin = 950",
            "[950.0, 940.0]; min, typical and max must be in ascending order",
        ),
        ("typical = 940", 'typical = "red"', "peak_nm.typical = 'red'; must be a number"),
        ("typical = 940", "typical = -1", "must be greater than 0"),
        ("[peak_nm]", "[peak]", "peak; unknown key"),
        ('basis = "measured"\nsource = "goniometer"', 'source = "goniometer"', "pattern.basis; is missing"),
        ('basis = "measured"\nsource = "goniometer"', 'basis = "guess"\nsource = "x"', "pattern.basis = 'guess'"),
        ("[0, 45, 90]", "[0, 45]", "pattern.relative; has 3 values, but must have 2, as many as angle_deg"),
        ("[0, 45, 90]", "[5, 45, 90]", "angles must be in ascending order from 0"),
        ("[0, 45, 90]", "[0, 90, 45]", "angles must be in ascending order from 0"),
        ("[1, 0.6, 0]", "[0, 0, 0]", "cannot all be 0"),
        ("[1, 0.6, 0]", "[1, -0.6, 0]", "must be at least 0"),
        ("schema = 1", "schema = 2", "written by a newer solen"),
    ],
)
def test_refuses_invalid_part_files(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in PART
    path = tmp_path / "mine.toml"
    path.write_text(PART.replace(old, new), encoding="utf-8")
    with pytest.raises(DataError) as refusal:
        load_part(path)
    line = str(refusal.value)
    assert words in line
    assert "mine.toml" in line
    assert len(line.splitlines()) == 1


def test_a_part_is_given_by_its_name_or_its_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="did you mean VSMY1850"):
        light_of(design(part="VSMY185"))
    with pytest.raises(DataError, match="is a receiver, not an emitter"):
        light_of(design(part="TEMT7100X01"))
    (tmp_path / "mine.toml").write_text(PART, encoding="utf-8")
    mine = light_of(design(part="mine.toml").in_folder(tmp_path))
    assert (mine.wavelength_nm, mine.width_mm, mine.height_mm) == (940.0, 0.25, 0.0)
    assert mine.table == ((0.0, 1.0), (45.0, 0.6), (90.0, 0.0))
    assert (mine.pattern, mine.cone_deg, mine.spectrum) == ("table", 360.0, ())
    with pytest.raises(DataError, match="no such file"):
        light_of(design(part="mine.toml").in_folder(tmp_path / "elsewhere"))


def test_the_design_overrides_the_part() -> None:
    part = light_of(design(part="VSMY1850"))
    assert (part.wavelength_nm, part.cone_deg, part.width_mm, part.pattern) == (850.0, 360.0, 0.2, "table")
    assert len(part.spectrum) == 5
    own = light_of(
        design(part="VSMY1850", wavelength_nm=860.0, cone_deg=120.0, width_mm=0.2, pattern="lambertian", fwhm_nm=20.0)
    )
    assert (own.wavelength_nm, own.cone_deg, own.width_mm) == (860.0, 120.0, 0.2)
    assert (own.pattern, own.table) == ("lambertian", ())
    assert own.spectrum == gaussian_lines(860.0, 20.0)


def test_the_default_light_is_the_fan_of_the_paper() -> None:
    assert light_of(design()) == Light(860.0)
    assert [light_of(design(pattern=name)).cone_deg for name in ("fan", "uniform", "lambertian")] == [120, 180, 180]


def test_lines_of_a_gaussian_spectrum_have_its_moments() -> None:
    lines = np.array(gaussian_lines(850.0, 30.0))
    weight, offset = lines[:, 1], (lines[:, 0] - 850.0) / (30.0 / FWHM_PER_SIGMA)
    moments = [float(weight @ offset**k) for k in range(10)]
    assert moments == pytest.approx([1, 0, 1, 0, 3, 0, 15, 0, 105, 0], abs=1e-9)


def test_the_default_wavelength_is_the_mean_of_the_spectrum() -> None:
    lines = ((450.0, 1.0), (620.0, 3.0))
    assert light_of(design(spectrum=lines)).wavelength_nm == pytest.approx(577.5)
    assert light_of(design(spectrum=lines, wavelength_nm=500.0)).wavelength_nm == 500.0


def test_a_pattern_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "pattern.csv"
    path.write_text("# angle, intensity\n0, 1\n60; 0.5\n\n90\t0 # dark\n", encoding="utf-8")
    original = design(pattern="table", pattern_file="pattern.csv").in_folder(tmp_path)
    assert light_of(original).table == ((0.0, 1.0), (60.0, 0.5), (90.0, 0.0))
    for text, words in (("0 1\n5 x\n", "line 2 = '5 x'"), ("0 1 2\n", "line 1"), ("5 1\n9 0\n", "ascend"), ("", "2")):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(DataError, match=words):
            light_of(original)


def test_a_design_saved_in_another_folder_keeps_its_files(tmp_path: Path) -> None:
    """A design saved in another folder still refers to the same files."""
    original = design(part="parts/mine.toml", pattern="table", pattern_file="pattern.csv").in_folder(tmp_path)
    (tmp_path / "below").mkdir()
    saved = load(save(tmp_path / "below" / "a.toml", original))
    assert saved.emitter.part == "../parts/mine.toml"
    assert saved.emitter.pattern_file == "../pattern.csv"
    assert {key: path.resolve() for key, path in saved.files.items()} == {
        key: path.resolve() for key, path in original.files.items()
    }


@pytest.mark.parametrize(
    "emitter",
    [
        {"part": "VSMY1850", "wavelength_nm": 860.0, "cone_deg": 120.0},
        {"part": "VSMY1850", "pattern": "fan", "width_mm": 0.0},
        {"part": "VSMY1850"},
        {"pattern": "lambertian", "exponent": 2.0, "height_mm": 0.1, "cone_deg": 120.0},
        {"pattern": "uniform"},
        {"pattern": "table", "pattern_table": ((0.0, 1.0), (90.0, 0.0))},
        {"spectrum": ((450.0, 1.0), (620.0, 3.0)), "wavelength_nm": 860.0},
        {"fwhm_nm": 30.0},
        {},
    ],
    ids=str,
)
def test_a_design_that_is_written_and_read_has_the_same_light(emitter: dict[str, object]) -> None:
    original = design(**emitter)
    again = loads(dumps(original))
    assert again == original
    assert light_of(again) == light_of(original)
    assert light_of(with_values(original, {"name": "two"})) == light_of(original)


@pytest.mark.parametrize(
    ("emitter", "words"),
    [
        ({"pattern": "table"}, "emitter.pattern_table; is missing"),
        ({"pattern_table": ((0.0, 1.0), (90.0, 0.0))}, 'does not apply with pattern = "fan"'),
        ({"pattern": "table", "pattern_table": ((1.0, 1.0), (90.0, 0.0))}, "ascending order from 0"),
        ({"pattern": "table", "pattern_table": ((0.0, 1.0),)}, "at least 2 entries"),
        ({"pattern": "lambert"}, "emitter.pattern = 'lambert'; must be 'fan', 'uniform', 'lambertian' or 'table'"),
        ({"exponent": 2.0}, "emitter.exponent = 2.0; does not apply with pattern"),
        ({"height_mm": 0.2}, 'emitter.height_mm = 0.2; does not apply with pattern = "fan"'),
        ({"width_mm": -0.1}, "emitter.width_mm = -0.1; must be at least 0"),
        ({"spectrum": ()}, "emitter.spectrum = (); must have at least 1"),
        ({"spectrum": ((850.0, 0.0),)}, "emitter.spectrum[0][1] = 0.0; must be greater than 0"),
        ({"spectrum": ((850.0, 1.0),), "fwhm_nm": 30.0}, "emitter.fwhm_nm = 30.0; cannot be combined with spectrum"),
        ({"ray_file": "a.dat", "width_mm": 0.2}, "emitter.width_mm; cannot be combined with ray_file"),
        ({"ray_file": "a.dat", "part": "VSMY1850"}, "emitter.part; cannot be combined with ray_file"),
        ({"cone_deg": 361.0}, "emitter.cone_deg = 361.0; must be at most 360"),
    ],
    ids=str,
)
def test_refuses_contradictory_emitter_keys(emitter: dict[str, object], words: str) -> None:
    with pytest.raises(SpecError) as refusal:
        design(**emitter)
    assert words in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_refuses_ambient_light_given_twice() -> None:
    with pytest.raises(SpecError, match=r"irradiance_per_mm = 0\.1; cannot be combined with power"):
        Design(name="one", material={"index": 1.44}, ambient={"power": 1.0, "irradiance_per_mm": 0.1})


@pytest.mark.parametrize(
    ("name", "chip_mm", "basis", "peak_nm"),
    [
        ("VSMY1850", 0.2, "estimate", 850.0),
        ("SFH4250", 0.3, "sibling", 860.0),
        ("generic-500", 0.25, "estimate", 500.0),
        ("generic-450", 0.25, "estimate", 450.0),
    ],
)
def test_every_emitter_has_a_chip_size_with_its_basis(name: str, chip_mm: float, basis: str, peak_nm: float) -> None:
    part = library_part(name)
    assert isinstance(part, EmitterPart)
    for side in (part.width_mm, part.height_mm):
        assert side is not None
        assert (side.nominal, side.basis) == (chip_mm, basis)
    assert part.peak_nm.nominal == peak_nm
