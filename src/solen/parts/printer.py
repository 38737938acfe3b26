"""Resin printers that expose a whole layer at once: printer files, and a small library.

Slicing requires few properties of a printer: its pixels, its build height and the limits of its layer thickness.
Wavelength, mirroring of the images, plate lift and time between exposures are optional. As in part files, each number
has a basis; `Printer.unconfirmed` names the estimates.

`load_printer` reads a TOML file with ``schema = 1``, `printers` lists the library, and `library_printer` reads a
printer from the library. A new TOML file in ``printers/`` adds a printer. `printer_of` accepts a name or a path, as
typed by a user.
"""

import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from solen.parts.datasheet import PART_MIGRATIONS, PART_SCHEMA, Quantity, Sheet, Sourced
from solen.registry import PRINTERS
from solen.results import Result
from solen.spec.shipped import Library
from solen.spec.strict import NotNegative, Positive

MAX_PIXELS = 20_000
"""Maximum number of pixels along one side."""
CONFIRMED_BASES = ("datasheet", "profile", "measured")

Axis = Literal["none", "x", "y"]
Count = Annotated[int, Field(strict=True, ge=1, le=MAX_PIXELS)]


class Pixels(Sourced):
    """Numbers of pixels of the projector or screen."""

    columns: Count = Field(description="number of pixels along X.")
    rows: Count = Field(description="number of pixels along Y.")


class Mirror(Sourced):
    """Axis along which images must be mirrored for the printer, for example because its screen is seen from below."""

    axis: Axis = Field(description="x, y or none.")


class Lift(Sourced):
    """Moves and pauses of the plate between exposures, for the bottom layers and for the other layers."""

    bottom_height_mm: NotNegative = Field(description="lift height of the bottom layers in mm.")
    height_mm: NotNegative = Field(description="lift height of the other layers in mm.")
    bottom_speed_mm_per_min: Positive = Field(description="lift speed of the bottom layers in mm/min.")
    speed_mm_per_min: Positive = Field(description="lift speed of the other layers in mm/min.")
    retract_mm_per_min: Positive = Field(description="retraction speed in mm/min.")
    bottom_wait_before_s: NotNegative = Field(0.0, description="Pause before an exposure of a bottom layer in s.")
    wait_before_s: NotNegative = Field(0.0, description="Pause before an exposure of another layer in s.")
    bottom_wait_after_s: NotNegative = Field(0.0, description="Pause after an exposure of a bottom layer in s.")
    wait_after_s: NotNegative = Field(0.0, description="Pause after an exposure of another layer in s.")

    def moves(self, *, bottom: bool) -> tuple[float, float, float, float]:
        """Return the height in mm and speed in mm/min of a lift, and the pauses before and after an exposure in s."""
        if bottom:
            return (
                self.bottom_height_mm,
                self.bottom_speed_mm_per_min,
                self.bottom_wait_before_s,
                self.bottom_wait_after_s,
            )
        return self.height_mm, self.speed_mm_per_min, self.wait_before_s, self.wait_after_s

    def pause_s(self, *, bottom: bool) -> float:
        """Return the time between exposures: the pauses, and the lift and retraction without acceleration."""
        height, speed, before, after = self.moves(bottom=bottom)
        return before + after + 60.0 * height * (1.0 / speed + 1.0 / self.retract_mm_per_min)


class Printer(Sheet):
    """Properties of a printer needed for slicing."""

    pitch_um: Quantity = Field(description="a table with the width of a pixel on the plate in µm, along X.")
    pitch_y_um: Quantity | None = Field(None, description="Height of a pixel along Y in µm, if pixels are not square.")
    pixels: Pixels = Field(description="a table with the numbers of columns and rows of pixels.")
    build_height_mm: Quantity = Field(description="a table with the build height, in mm.")
    layer_um: Quantity | None = Field(None, description="Minimum and maximum layer thickness in µm.")
    wavelength_nm: Quantity | None = Field(None, description="Wavelength of the lamp in nm.")
    irradiance_mw_per_cm2: Quantity | None = Field(None, description="Irradiance at the window in mW/cm².")
    pause_s: Quantity | None = Field(
        None, description="Time between two exposures in s: separation, lift and settling."
    )
    mirror: Mirror | None = Field(None, description="Axis along which images are mirrored.")
    lift: Lift | None = Field(None, description="Moves of the plate, required for a .goo file.")
    layer_exposures: Sourced | None = Field(
        None, description="Evidence that the printer uses the exposure time of each layer in its file."
    )

    @property
    def pitches_mm(self) -> tuple[float, float]:
        """Sizes of a pixel on the plate in mm, along X and Y."""
        x_um, y_um = self.pitch_um.nominal, (self.pitch_y_um or self.pitch_um).nominal
        return x_um / 1000.0, y_um / 1000.0

    @property
    def pixel_mm2(self) -> float:
        """Area of a pixel on the plate."""
        return math.prod(self.pitches_mm)

    @property
    def pixel_text(self) -> str:
        """Size of a pixel in µm, as printed: ``50`` or ``19 x 24``."""
        return " x ".join(dict.fromkeys(f"{1000.0 * side:.5g}" for side in self.pitches_mm))

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.pixels.rows, self.pixels.columns

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Build volume in mm along X, Y and Z."""
        (rows, columns), (x, y) = self.shape, self.pitches_mm
        return columns * x, rows * y, self.build_height_mm.nominal

    @property
    def layers_um(self) -> tuple[float, float]:
        """Minimum and maximum layer thickness in µm; 0 and inf if unknown."""
        if self.layer_um is None:
            return 0.0, math.inf
        return self.layer_um.min or self.layer_um.nominal, self.layer_um.max or self.layer_um.nominal

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Names of the numbers that determine the layer images but are only estimates."""
        numbers: dict[str, Sourced] = {
            "pixel pitch": self.pitch_um,
            "pixel counts": self.pixels,
            "build height": self.build_height_mm,
        }
        return tuple(name for name, number in numbers.items() if number.basis not in CONFIRMED_BASES)


def _library() -> Library[Printer]:
    return Library(files("solen.parts") / "printers", "printer", Printer, PART_SCHEMA, PART_MIGRATIONS, PRINTERS)


def printers() -> tuple[str, ...]:
    """Return the sorted names of the printers shipped with solen and other packages."""
    return _library().names()


def library_printer(name: str) -> Printer:
    """Return a printer from the library; raise `DataError` with the nearest name if no printer has this name."""
    return _library().shipped(name)


def load_printer(path: Path | str) -> Printer:
    """Read a printer from a file.

    Raises
    ------
    DataError
        If the file cannot be read, is not TOML, has another schema, or is not a valid printer.
    """
    return _library().load(path)


def printer_of(text: str) -> Printer:
    """Return the printer in a file if ``text`` ends in .toml or contains a slash, otherwise from the library."""
    is_file = text.endswith(".toml") or "/" in text or "\\" in text
    return load_printer(text) if is_file else library_printer(text)


class PrinterSummary(Result):
    """Properties of a printer needed for slicing: pixels, build volume, layer limits, and which numbers are estimates.

    ``pitch_um`` and ``pitch_y_um`` are the sizes of a pixel along X and Y; layer limits are None if they are unknown.
    """

    printer: str
    name: str
    pitch_um: float
    pitch_y_um: float
    columns: int
    rows: int
    size_mm: tuple[float, float, float]
    wavelength_nm: float | None
    min_layer_um: float | None
    max_layer_um: float | None
    unconfirmed: tuple[str, ...]
    file: Printer

    @classmethod
    def of(cls, text: str) -> "PrinterSummary":
        """Return the summary of a printer from the library or a file."""
        printer = printer_of(text)
        rows, columns = printer.shape
        x, y, z = (round(length, 9) for length in printer.size_mm)
        pitch_um, pitch_y_um = (round(1000.0 * side, 9) for side in printer.pitches_mm)
        min_layer_um, max_layer_um = (None, None) if printer.layer_um is None else printer.layers_um
        return cls(
            printer=text,
            name=printer.name,
            pitch_um=pitch_um,
            pitch_y_um=pitch_y_um,
            columns=columns,
            rows=rows,
            size_mm=(x, y, z),
            wavelength_nm=None if printer.wavelength_nm is None else printer.wavelength_nm.nominal,
            min_layer_um=min_layer_um,
            max_layer_um=max_layer_um,
            unconfirmed=printer.unconfirmed,
            file=printer,
        )


class PrinterList(Result):
    """The printers of the library."""

    printers: tuple[PrinterSummary, ...]
