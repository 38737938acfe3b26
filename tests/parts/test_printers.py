"""Printers: the shipped files name the basis of their numbers, and files are checked strictly."""

from pathlib import Path

import pytest

from solen.errors import DataError
from solen.parts import library_printer, load_printer, printer_of, printers

MINE = """
schema = 1
name = "Mine"
maker = "me"
document = "my notes"
[pitch_um]
typical = 47.25
basis = "measured"
source = "a grid of 1000 pixels under the microscope"
[pixels]
columns = 2560
rows = 1440
basis = "datasheet"
source = "panel"
[build_height_mm]
typical = 155
basis = "measured"
source = "ruler"
[layer_um]
typical = 50
basis = "measured"
source = "works"
"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(MINE, encoding="utf-8")
    return path


def test_every_shipped_printer_is_valid_and_names_its_estimates() -> None:
    """Printers from a slicer's profile contain no estimates; the numbers of the others are marked as estimates."""
    profiles = 0
    for name in printers():
        printer = library_printer(name)
        numbers = (printer.pitch_um, printer.pixels, printer.build_height_mm)
        if printer.pitch_um.basis == "profile":
            profiles += 1
            assert "UVtools" in printer.document
            assert printer.unconfirmed == ()
            assert {number.basis for number in numbers} == {"profile"}
            assert printer.mirror is not None
            assert printer.layer_exposures is None
        else:
            assert printer.unconfirmed == ("pixel pitch", "pixel counts", "build height")
        assert all(number.source for number in numbers)
        (rows, columns), (x, y) = printer.shape, printer.pitches_mm
        assert printer.size_mm[:2] == pytest.approx((columns * x, rows * y))
        assert printer.layers_um[0] <= 25.0 <= 100.0 <= printer.layers_um[1], "usual layers must be possible"
    assert profiles >= 12


def test_pixels_need_not_be_square() -> None:
    """15120 × 6230 pixels of 14 × 19 µm: a plate of 211.68 × 118.37 mm."""
    printer = library_printer("elegoo-saturn-4-ultra-16k")
    assert printer.pitches_mm == (0.014, 0.019)
    assert printer.size_mm == pytest.approx((211.68, 118.37, 220.0))
    assert printer.pixel_mm2 == pytest.approx(0.014 * 0.019)
    assert printer.pixel_text == "14 x 19"


def test_the_quoted_plate_sizes_follow_from_pitch_and_pixels() -> None:
    """The number of pixels times their pitch is the size quoted in the notes, to the quoted digits."""
    for name in printers():
        if name == "generic":
            continue
        printer = library_printer(name)
        quoted = [float(word) for word in printer.notes.split("Builds ")[1].split(" mm")[0].split(" x ")]
        assert list(printer.size_mm) == pytest.approx(quoted, abs=0.5), name


def test_a_printer_is_read_from_a_file(mine: Path) -> None:
    printer = load_printer(mine)
    assert printer.pitches_mm == (0.04725, 0.04725)
    assert printer.shape == (1440, 2560)
    assert printer.layers_um == (50.0, 50.0)
    assert printer.unconfirmed == ()
    assert printer.pause_s is None
    assert printer_of(str(mine)) == printer
    assert printer_of("generic") == library_printer("generic")


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("columns = 2560", "columns = 0", "pixels.columns = 0; must be at least 1"),
        ("columns = 2560", "columns = 2560.5", "pixels.columns = 2560.5; must be an integer"),
        ("typical = 47.25", "typical = -1", "pitch_um.typical = -1; must be greater than 0"),
        ("typical = 47.25", "typical = nan", "pitch_um.typical = nan; must be a finite number"),
        ('basis = "datasheet"', 'basis = "guess"', "pixels.basis = 'guess'"),
        ("[layer_um]", "[layers_um]", "layers_um; unknown key; did you mean layer_um?"),
        ("schema = 1", "", "schema is missing"),
        ("rows = 1440", "rows = ", "not valid TOML"),
    ],
)
def test_refuses_invalid_printer_files(mine: Path, old: str, new: str, line: str) -> None:
    mine.write_text(MINE.replace(old, new), encoding="utf-8")
    with pytest.raises(DataError) as refusal:
        load_printer(mine)
    assert line in str(refusal.value)


def test_refuses_unknown_printers() -> None:
    with pytest.raises(DataError, match=r"did you mean asiga-max-x27\?"):
        printer_of("asiga-max-27")
    with pytest.raises(DataError, match="no such file"):
        printer_of("no/such.toml")
