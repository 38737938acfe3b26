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
PROCESS_KEYS = ("layer_um", "burn_in_layers", "burn_in_s", "exposure_s", "irradiance_mW_per_cm2")
"""Options that a process file also contains."""


class Slicing(Options):
    """How a part is sliced and exposed; the default exposures are those of the paper."""

    printer: str = "generic"
    """Printer: name in the library (solen print printers), or a printer file."""
    layer_um: Finite = 25.0
    """Layer thickness."""
    orientation: Orientation = "flat"
    """Orientation of the part; upright prints a sensor on the ends of its arms, with the lens last."""
    rotate_deg: Degrees = (0.0, 0.0, 0.0)
    """Angles of further rotations about the X, Y and Z axes of the plate."""
    copies: Annotated[int, Field(ge=1, le=10_000)] = 1
    """Number of copies, in a grid on the plate."""
    gap_mm: Annotated[float, Field(ge=0, le=1000)] = 2.0
    """Minimum distance between copies."""
    burn_in_layers: Annotated[int, Field(ge=0, le=1000)] = 6
    """Number of burn-in layers: first layers with a longer exposure."""
    burn_in_s: Seconds = 3.0
    """Exposure time of the burn-in layers."""
    exposure_s: Seconds = 2.0
    """Exposure time of the other layers."""
    irradiance_mW_per_cm2: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Irradiance at the window; default: that of the printer file, or 13 as in the paper."""
    z_offset_um: Annotated[float, Field(ge=-1e5, le=1e5)] = 0.0
    """Thickness of a film or base under the part; it appears on the settings sheet."""
    mirror: Axis | None = None
    """Axis along which images are mirrored; default: that of the printer file, or none."""
    phase_px: tuple[Phase, Phase] = (0.0, 0.0)
    """Position of the part's origin (for a sensor, the lens vertex) in its pixel along X and Y; 0 is at a corner."""
    no_anti_aliasing: bool = False
    """Expose pixels fully if at least half of their area is covered, and not otherwise; by default, edges are grey."""
    process: Path | None = None
    """Process file: edges are drawn with its grey response, its layers and exposures are the defaults, and its working
    curve appears on the settings sheet.
    """
    cure: Path | None = None
    """Working curve for the settings sheet, with a fitted lamp spectrum if any: a file of solen resin cure --out."""
    format: Literal["zip", "goo"] = "zip"
    """Image format: a ZIP file of PNGs, which UVtools also opens, or a .goo file of version 3."""
    resin: str | None = None
    """Resin, whose name and working curve appear on the settings sheet: name in the library, or a resin file."""
    sheet_only: bool = False
    """Write only the STL and the settings, without images."""

    def with_defaults_of(self, process: Settings) -> "Slicing":
        """Return the options with the layers and exposures of a process where these options are not set."""
        defaults = {key: getattr(process, key) for key in PROCESS_KEYS if key not in self.model_fields_set}
        return self.model_copy(update=defaults)

    def differences(self, process: Settings) -> dict[str, float]:
        """Return the layers and exposures that differ from those of a process, keyed by option."""
        values = {key: getattr(self, key) for key in PROCESS_KEYS}
        return {key: value for key, value in values.items() if value not in (None, getattr(process, key))}

    def described_differences(self, process: Settings) -> list[str]:
        """Return descriptions of the layers and exposures that differ from those of a process."""
        return [
            f"--{key.replace('_', '-')} {value:g}, but the process has {getattr(process, key):g}"
            for key, value in self.differences(process).items()
        ]

    def seconds(self, index: int) -> float:
        """Return the exposure time of a layer; the index of the first layer is 0."""
        return self.burn_in_s if index < self.burn_in_layers else self.exposure_s

    def total_s(self, layers: int) -> float:
        """Return the total exposure time of a number of layers."""
        burn_in = min(layers, self.burn_in_layers)
        return burn_in * self.burn_in_s + (layers - burn_in) * self.exposure_s
