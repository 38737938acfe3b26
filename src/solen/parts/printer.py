"""Printers that project one layer at a time, as files, and a small library of them.

The idea: to cut a part into layers one needs little of a printer: its pixels, how high it builds, how thin and thick
its layers may be; its wavelength and the time between exposures are optional. Each number states its basis, as in the
datasheets of parts: `Printer.unconfirmed` names those that no document of the maker confirms.

The interface: `load_printer` reads a TOML file with ``schema = 1``, `printers` lists the library, `library_printer`
opens one of it; each gives a `Printer`. `printer_of` takes either, as a user types it.
"""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from solen.errors import DataError, SolenError
from solen.parts.datasheet import PART_MIGRATIONS, PART_SCHEMA, Quantity, Sourced
from solen.registry import PRINTERS
from solen.results import Result
from solen.spec.shipped import Library
from solen.spec.strict import Strict, Text

MOST_PIXELS = 20_000
"""Along one side."""
SURE = ("datasheet", "measured")

Count = Annotated[int, Field(strict=True, ge=1, le=MOST_PIXELS)]


class Pixels(Sourced):
    """How many pixels the projector has."""

    columns: Count = Field(description="pixels along X, a whole number.")
    rows: Count = Field(description="pixels along Y, a whole number.")


class Printer(Strict):
    """What layers need of a printer."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="the printer's name, one line.")
    maker: Text = Field(description="who makes it, one line.")
    document: Text = Field(description="the document that the numbers are taken from, one line.")
    notes: str = Field("", description="Anything worth knowing.")
    pitch_um: Quantity = Field(description="a table with the side of a pixel on the plate in µm.")
    pixels: Pixels = Field(description="a table with the pixels' columns and rows.")
    build_height_mm: Quantity = Field(description="a table with the height that it builds, in mm.")
    layer_um: Quantity = Field(description="a table with the least and the most thickness of a layer in µm.")
    wavelength_nm: Quantity | None = Field(None, description="Wavelength of its light in nm.")
    irradiance_mw_per_cm2: Quantity | None = Field(None, description="Irradiance at the window in mW/cm².")
    pause_s: Quantity | None = Field(None, description="Time between two exposures in s: parting, lift, settling.")

    @property
    def pitch_mm(self) -> float:
        """Side of a pixel on the plate."""
        return self.pitch_um.usual / 1000.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.pixels.rows, self.pixels.columns

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """What it builds along X, Y and Z."""
        rows, columns = self.shape
        return columns * self.pitch_mm, rows * self.pitch_mm, self.build_height_mm.usual

    @property
    def layers_um(self) -> tuple[float, float]:
        """Thinnest and thickest layer."""
        stated = self.layer_um
        least, most = stated.least or stated.usual, stated.most or stated.usual
        return least, most

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Names of the numbers that decide the layers and are estimates."""
        deciding: dict[str, Sourced] = {
            "pixel pitch": self.pitch_um,
            "pixel counts": self.pixels,
            "build height": self.build_height_mm,
        }
        return tuple(name for name, number in deciding.items() if number.basis not in SURE)


def _library() -> Library[Printer]:
    return Library(files("solen.parts") / "printers", "printer", Printer, PART_SCHEMA, PART_MIGRATIONS, PRINTERS)


def printers() -> tuple[str, ...]:
    """Names of the printers that solen and other packages ship, sorted."""
    return _library().names()


def library_printer(name: str) -> Printer:
    """Printer of the library; `DataError` with the nearest name where there is none of that name."""
    return _library().shipped(name)


def load_printer(path: Path | str) -> Printer:
    """Printer of a file.

    Raises
    ------
    DataError
        Where the file cannot be read, is not TOML, has another schema, or is not a valid printer.
    """
    return _library().load(path)


def printer_of(text: str) -> Printer:
    """Printer of the library by its name, or of a file: then ``text`` ends in .toml or holds a slash."""
    is_file = text.endswith(".toml") or "/" in text or "\\" in text
    return load_printer(text) if is_file else library_printer(text)


@dataclass(frozen=True, eq=False, repr=False)
class PrinterSummary(Result):
    """What layers need of a printer: its pixels, what it builds, and which of these numbers are estimates."""

    printer: str
    name: str
    pitch_um: float
    columns: int
    rows: int
    size_mm: tuple[float, float, float]
    wavelength_nm: float | None
    least_layer_um: float
    most_layer_um: float
    unconfirmed: tuple[str, ...]
    file: Printer

    @classmethod
    def of(cls, text: str) -> "PrinterSummary":
        """Summary of a printer of the library, or of a file."""
        printer = printer_of(text)
        rows, columns = printer.shape
        x, y, z = (round(length, 9) for length in printer.size_mm)
        wavelength_nm = None if printer.wavelength_nm is None else printer.wavelength_nm.usual
        pixels = (printer.pitch_um.usual, columns, rows, (x, y, z), wavelength_nm)
        return cls(text, printer.name, *pixels, *printer.layers_um, printer.unconfirmed, printer)


@dataclass(frozen=True, eq=False, repr=False)
class PrinterList(Result):
    """The printers of the library."""

    printers: tuple[PrinterSummary, ...]
