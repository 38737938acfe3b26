"""How a part is cut into layers, as typed: for `solen print layers` and `solen export --layers`. Nothing heavy is loaded."""

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter

Triple = Annotated[tuple[float, float, float], Parameter(negative=())]


@dataclass(frozen=True)
class Slicing:
    """How a part is cut into layers.

    Parameters
    ----------
    printer
        Printer of the library (solen print printers), or its file.
    layer_um
        Thickness of a layer.
    orientation
        flat, upright (a sensor on its arms, lens last), or on-edge.
    rotate_deg
        Then turn it about the plate's X, Y and Z by these degrees.
    copies
        How many, in a grid on the plate.
    gap_mm
        Least distance between copies.
    burn_in_layers
        First layers that are lit for longer.
    burn_in_s
        Exposure of these.
    exposure_s
        Exposure of all other layers.
    irradiance_mW_per_cm2
        At the window; by default the printer's, or 13 as in the paper.
    z_offset_um
        Thickness of a film or base under the part, for the settings sheet.
    mirror
        Flip the pictures along x or y.
    resin
        Resin of the library, or its file: its name and working curve for the settings sheet.
    sheet_only
        Write STL and settings, no pictures.
    """

    printer: str = "generic"
    layer_um: float = 25.0
    orientation: str = "flat"
    rotate_deg: Triple = (0.0, 0.0, 0.0)
    copies: int = 1
    gap_mm: float = 2.0
    burn_in_layers: int = 6
    burn_in_s: float = 3.0
    exposure_s: float = 2.0
    irradiance_mW_per_cm2: Annotated[float | None, Parameter(name="--irradiance-mW-per-cm2")] = None
    z_offset_um: float = 0.0
    mirror: str = "none"
    resin: str | None = None
    sheet_only: Annotated[bool, Parameter(negative=())] = False
