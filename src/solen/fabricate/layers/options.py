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
"""Settings that a process file may state too."""


class Slicing(Options):
    """How a part is cut into layers and exposed; the default exposures are the paper's."""

    printer: str = "generic"
    """Printer of the library (solen print printers), or its file."""
    layer_um: Finite = 25.0
    """Layer thickness."""
    orientation: Orientation = "flat"
    """Orientation of the part; upright: a sensor on its arms, lens last."""
    rotate_deg: Degrees = (0.0, 0.0, 0.0)
    """Angles of further rotations about the plate's X, Y and Z."""
    copies: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of copies, in a grid on the plate."""
    gap_mm: Annotated[float, Field(ge=0, le=1000)] = 2.0
    """Minimum distance between copies."""
    burn_in_layers: Annotated[int, Field(ge=0, le=1000)] = 6
    """Number of first layers with a longer exposure (burn-in)."""
    burn_in_s: Seconds = 3.0
    """Exposure of the first layers."""
    exposure_s: Seconds = 2.0
    """Exposure of all other layers."""
    irradiance_mW_per_cm2: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Irradiance at the window; default: the printer's, or 13 as in the paper."""
    z_offset_um: Annotated[float, Field(ge=-1e5, le=1e5)] = 0.0
    """Thickness of a film or base under the part, for the settings sheet."""
    mirror: Axis | None = None
    """Flip the pictures along x or y; default: as stated in the printer's file, otherwise none."""
    phase_px: tuple[Phase, Phase] = (0.0, 0.0)
    """Position of the part's origin (a sensor's lens vertex) in its pixel along X and Y; 0 is on a corner."""
    no_anti_aliasing: bool = False
    """Light only pixels that are covered by half or more; without it, pixels at an edge are grey."""
    process: Path | None = None
    """Process file: its measured greys draw edges, its layers and exposures apply, its cure is on the sheet."""
    cure: Path | None = None
    """Working curve of the resin for the sheet, with the lamp's spectrum if fitted: solen resin cure --out."""
    format: Literal["zip", "goo"] = "zip"
    """Format of the pictures: a ZIP of PNGs, which UVtools also opens, or a .goo file of version 3."""
    resin: str | None = None
    """Resin of the library, or its file: its name and working curve for the settings sheet."""
    sheet_only: bool = False
    """Write only STL and settings, no pictures."""

    def exposed_as(self, process: Settings) -> "Slicing":
        """The options with the layers and exposures of a process, unless options state them."""
        stated = {key: getattr(process, key) for key in EXPOSED if key not in self.model_fields_set}
        return self.model_copy(update=stated)

    def exposed(self, process: Settings) -> dict[str, float]:
        """Layers and exposures that the options state differently from a process, by key."""
        stated = {key: getattr(self, key) for key in EXPOSED}
        return {key: value for key, value in stated.items() if value not in (None, getattr(process, key))}

    def otherwise(self, process: Settings) -> list[str]:
        """Description of the differences from a process."""
        return [
            f"--{key.replace('_', '-')} {value:g}, while the process has {getattr(process, key):g}"
            for key, value in self.exposed(process).items()
        ]

    def seconds(self, index: int) -> float:
        """Exposure of a layer in s; the first is number 0."""
        return self.burn_in_s if index < self.burn_in_layers else self.exposure_s

    def total_s(self, layers: int) -> float:
        """Total exposure of a number of layers in s."""
        burn_in = min(layers, self.burn_in_layers)
        return burn_in * self.burn_in_s + (layers - burn_in) * self.exposure_s
