"""Options for printing in layers: orientation, copies, slicing and exposure of the part."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from solen.fabricate.process import Settings
from solen.parts.printer import Axis
from solen.spec.strict import Finite, Options

Orientation = Literal["flat", "upright", "on-edge"]
Degrees = tuple[Finite, Finite, Finite]
Phase = Annotated[float, Field(ge=0, lt=1)]
Seconds = Annotated[float, Field(gt=0, le=3600)]
EXPOSED = ("layer_um", "burn_in_layers", "burn_in_s", "exposure_s", "irradiance_mW_per_cm2")
"""Settings that a process file may also specify."""


class Slicing(Options):
    """How a part is sliced and exposed; the default exposures are from the paper."""

    printer: str = "generic"
    """Printer from the library (solen print printers), or a printer file."""
    layer_um: Finite = 25.0
    """Layer thickness."""
    orientation: Orientation = "flat"
    """Orientation of the part; upright places a sensor on its arms and prints the lens last."""
    rotate_deg: Degrees = (0.0, 0.0, 0.0)
    """Angles of further rotations about the X, Y and Z axes of the plate."""
    copies: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of copies, in a grid on the plate."""
    gap_mm: Annotated[float, Field(ge=0, le=1000)] = 2.0
    """Minimum distance between copies."""
    burn_in_layers: Annotated[int, Field(ge=0, le=1000)] = 6
    """Number of first layers with a longer exposure (burn-in)."""
    burn_in_s: Seconds = 3.0
    """Exposure of the burn-in layers."""
    exposure_s: Seconds = 2.0
    """Exposure of all other layers."""
    irradiance_mW_per_cm2: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Irradiance at the window; default: from the printer file, or 13 as in the paper."""
    z_offset_um: Annotated[float, Field(ge=-1e5, le=1e5)] = 0.0
    """Thickness of a film or base under the part, for the settings sheet."""
    mirror: Axis | None = None
    """Mirror the images along x or y; default: as in the printer file, otherwise no mirroring."""
    phase_px: tuple[Phase, Phase] = (0.0, 0.0)
    """Position of the part origin (for a sensor, the lens vertex) in its pixel along X and Y; 0 is at a corner."""
    no_anti_aliasing: bool = False
    """Expose only pixels that are covered by half or more; by default, pixels at an edge are grey."""
    process: Path | None = None
    """Process file: its measured grey levels draw edges, its layers and exposures apply, and its cure is on the
    sheet.
    """
    cure: Path | None = None
    """Working curve of the resin for the sheet, with the lamp spectrum if fitted: solen resin cure --out."""
    format: Literal["zip", "goo"] = "zip"
    """Image format: a ZIP of PNGs, which UVtools also opens, or a .goo file of version 3."""
    resin: str | None = None
    """Resin from the library, or a resin file; its name and working curve appear on the settings sheet."""
    sheet_only: bool = False
    """Write only the STL and settings, without images."""

    def exposed_as(self, process: Settings) -> "Slicing":
        """Return the options with the layers and exposures of a process, unless the options specify them."""
        stated = {key: getattr(process, key) for key in EXPOSED if key not in self.model_fields_set}
        return self.model_copy(update=stated)

    def exposed(self, process: Settings) -> dict[str, float]:
        """Return the layers and exposures, by key, for which the options differ from a process."""
        stated = {key: getattr(self, key) for key in EXPOSED}
        return {key: value for key, value in stated.items() if value not in (None, getattr(process, key))}

    def otherwise(self, process: Settings) -> list[str]:
        """Describe the differences from a process."""
        return [
            f"--{key.replace('_', '-')} {value:g}, while the process has {getattr(process, key):g}"
            for key, value in self.exposed(process).items()
        ]

    def seconds(self, index: int) -> float:
        """Return the exposure of a layer in s; the first layer is number 0."""
        return self.burn_in_s if index < self.burn_in_layers else self.exposure_s

    def total_s(self, layers: int) -> float:
        """Return the total exposure of a number of layers in s."""
        burn_in = min(layers, self.burn_in_layers)
        return burn_in * self.burn_in_s + (layers - burn_in) * self.exposure_s
