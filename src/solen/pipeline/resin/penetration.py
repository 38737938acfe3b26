"""Penetration depth of a resin from its absorbance, at one wavelength or in a lamp's light."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.cure.colour import Attenuation, attenuation, penetration_depth_um
from solen.material.index.light import Light, led
from solen.pipeline.design.light import light_named
from solen.pipeline.outputs import check_figure, check_out, leave
from solen.pipeline.resin.index import plain
from solen.pipeline.resin.traces import Spectra, spectra_of
from solen.recording import Recording, read

SHALLOW_UM, DEEP_UM = 25.0, 200.0
"""Depths between which a working curve's slope is told: the paper's thinnest layer and its stated cure depth."""
_SATURATED = 3.0  # an absorbance that few instruments reach
_OFFSET = 0.01  # change of Dp by an offset from which on it is told
_ALL_OFFSET = 0.5  # share of an offset in the absorbance from which on it may be all of it
_BENT = 0.05  # how far Dp runs with depth until it is told


@dataclass(frozen=True)
class Lamp:
    """A lamp: by a part's name or a file of its spectrum, or by peak and width in nm."""

    name: str | None = None
    peak_nm: float | None = None
    fwhm_nm: float | None = None

    def light(self) -> tuple[Light, str] | None:
        """Its light, and in words where that comes from; None where none is named."""
        if self.name is not None:
            if self.peak_nm is not None or self.fwhm_nm is not None:
                raise SpecError("--led", limit="names the lamp already", remedy="leave --led-nm and --led-fwhm-nm out")
            return light_named(self.name)
        for option, value in (("--led-nm", self.peak_nm), ("--led-fwhm-nm", self.fwhm_nm)):
            if value is not None and not 0.0 < value < math.inf:
                raise SpecError(option, value=value, limit="must be above 0")
        if self.peak_nm is None:
            if self.fwhm_nm is not None:
                raise SpecError("--led-fwhm-nm", limit="needs the peak", remedy="add --led-nm")
            return None
        width = f", {self.fwhm_nm:g} nm wide" if self.fwhm_nm else ", one wavelength"
        return led(self.peak_nm, self.fwhm_nm), f"peak at {self.peak_nm:g} nm{width}"


def penetration(
    file: Path,
    *,
    path_um: float,
    lamp: Lamp | None = None,
    u_path_um: float | None = None,
    u_absorbance: float | None = None,
    traces: tuple[str, ...] = (),
    sheet: str | None = None,
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Penetration depth h/(A ln 10) against wavelength, and in a lamp's light.

    Parameters
    ----------
    file
        Any file that `solen.recording.read` takes, with a spectrum of absorbance (base 10) or of transmittance.
    path_um, u_path_um
        Path through the liquid resin, and its standard uncertainty.
    lamp
        Of the printer.
    u_absorbance
        Standard uncertainty of the absorbance, the same way at all wavelengths.
    traces
        Names of the traces of absorbance, where there are several; those named are averaged.
    sheet
        Of a workbook.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    DataError, SpecError
        Where the file is damaged, holds no absorbance, or the lamp shines where nothing absorbs.
    """
    check_figure(figure)
    check_out(out)
    for name, value in (("--path-um", path_um), ("--u-path-um", u_path_um), ("--u-absorbance", u_absorbance)):
        if value is not None and not (0.0 < value < math.inf):
            raise SpecError(name, value=value, limit="must be above 0")
    chosen = (lamp or Lamp()).light()
    recording = read(file, sheet=sheet)
    spectra = spectra_of(recording, {"T": (), "R": (), "A": traces})
    absorbance, warnings = _absorbance(recording, spectra)
    nm = spectra.wavelength_nm
    found = None if chosen is None else attenuation(path_um, nm, absorbance, chosen[0])
    data = {
        "path_um": path_um,
        "Dp_um": None,
        "u_Dp_um": None,
        "lamp": None,
        **(_lit(found, chosen[1], path_um, u_path_um, u_absorbance) if found and chosen else {}),
        "wavelength_nm": plain(nm),
        "absorbance": plain(absorbance),
        "Dp_spectrum_um": plain(_spectrum(path_um, absorbance)),
        "traces": list(next(iter(spectra.names.values()))),
        "sources": [recording.provenance.as_dict()],
        "warnings": [*spectra.warnings, *warnings, *_cautions(found, nm, absorbance, path_um)],
    }

    def draw() -> Any:
        from solen.report.resin.penetration import penetration_figure

        return penetration_figure(nm, absorbance, path_um, found, recording.provenance)

    return leave(data, "penetration", out, figure, draw)


def _absorbance(recording: Recording, spectra: Spectra) -> tuple[FloatArray, list[str]]:
    """Absorbance, base 10, mean of the traces, and what must be said of it."""
    if "A" in spectra.rows:
        names = spectra.names["A"]
        if any(recording.channel(name).quantity == "absorptance" for name in names):
            remedy = "take −log10 T, which a spectrophotometer exports as absorbance"
            raise DataError(", ".join(names), limit="is an absorptance, the share that stays", remedy=remedy)
        return np.asarray(spectra.rows["A"].mean(axis=0)), []
    if "T" not in spectra.rows:
        raise DataError(recording.provenance.file, limit="holds no absorbance", remedy="name the column absorbance")
    t = spectra.rows["T"].mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        absorbance = np.where(t > 0.0, -np.log10(t), np.nan)
    told = "absorbance is −log10 of the transmittance: what the cell's faces reflect counts as absorbed"
    return absorbance, [told]


def _spectrum(path_um: float, absorbance: FloatArray) -> FloatArray:
    """Penetration depth at each wavelength; NaN where nothing absorbs."""
    there = np.where(absorbance > 0.0, absorbance, np.nan)
    found = np.full(len(there), np.nan)
    known = np.isfinite(there)
    if known.any():
        found[known] = penetration_depth_um(path_um, there[known])
    return found


def _lit(
    found: Attenuation, source: str, path_um: float, u_path_um: float | None, u_absorbance: float | None
) -> dict[str, Any]:
    """In the light of a lamp: at the surface and between two depths."""
    surface = found.local_um()
    u = None
    if u_path_um is not None or u_absorbance is not None:
        by_a = (u_absorbance or 0.0) * math.log(10.0) / path_um * surface
        u = surface * math.hypot((u_path_um or 0.0) / path_um, by_a)
    return {
        "Dp_um": surface,
        "u_Dp_um": u,
        "lamp": {"source": source, "mean_nm": float(found.wavelength_nm @ found.weight)},
        "between": {
            "from_um": SHALLOW_UM,
            "to_um": DEEP_UM,
            "Dp_um": found.between_um(SHALLOW_UM, DEEP_UM),
        },
    }


def _cautions(found: Attenuation | None, nm: FloatArray, absorbance: FloatArray, path_um: float) -> list[str]:
    told = []
    if found is None:
        told.append("no lamp is named (--led-nm, --led-fwhm-nm or --led): which wavelength counts is open")
    else:
        told += _of_lamp(found, nm, absorbance, path_um)
    told.append(
        "this is what the liquid absorbs; a working curve's Dp also has in it which wavelengths start the cure, and "
        "what changes as the resin sets"
    )
    return told


def _of_lamp(found: Attenuation, nm: FloatArray, absorbance: FloatArray, path_um: float) -> list[str]:
    told, surface, deep = [], found.local_um(), found.between_um(SHALLOW_UM, DEEP_UM)
    if deep > (1.0 + _BENT) * surface:
        told.append(
            f"the lamp's light is no exponential: Dp is {surface:.3g} µm at the surface and {deep:.3g} µm between "
            f"{SHALLOW_UM:g} and {DEEP_UM:g} µm, so that a working curve bends upwards"
        )
    highest = float(found.per_um.max()) * path_um / math.log(10.0)
    if highest > _SATURATED:
        told.append(f"absorbance reaches {highest:.2g} in the lamp's light: take a shorter path")
    known = np.flatnonzero(np.isfinite(absorbance))
    lowest = known[np.argmin(absorbance[known])]
    offset = float(absorbance[lowest]) * math.log(10.0) / path_um * surface
    if abs(offset) > _OFFSET:
        change = "not known at all"
        if offset < _ALL_OFFSET:
            change = f"{abs(offset) / (1.0 - offset):.0%} {'longer' if offset > 0.0 else 'shorter'}"
        told.append(
            f"the lowest absorbance is {absorbance[lowest]:.2g}, at {nm[lowest]:.0f} nm: if that is an offset, as of "
            f"the cell's faces, Dp is {change}"
        )
    return told
