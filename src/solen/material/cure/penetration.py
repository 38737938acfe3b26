"""Penetration depth from an absorbance, at one wavelength and in the light of a lamp.

The idea: a resin that lets 10^(-A) through a path h takes light off as e^(-z/Dp) with Dp = h/(A ln 10). A lamp has many
wavelengths, and the deeper its light comes, the more it is of those that the resin takes least: the dose falls slower
with depth, so no single Dp describes it. `Attenuation` keeps the sum over the lamp's lines; its `local_um` is the
penetration depth at a place, and between two depths `between_um` is what a working curve through discs of these
thicknesses has for its slope.

This is absorption alone. A working curve's Dp has in it also how well each wavelength starts the cure, bleaching and
what the cured resin absorbs: the two agree where these are small.

The interface: `penetration_of` a recording with `PenetrationOptions` gives a `Penetration`; `penetration_depth_um` is
one number, `attenuation` gives an `Attenuation`.
"""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.illuminant import Illuminant, led, named_light
from solen.material.rows import RowOptions, chosen_rows, refuse_unused
from solen.ranks import Caution, look_at, note
from solen.recording import Recording
from solen.recording.model import Measured
from solen.recording.optical import OpticalSpectra, optical_spectra
from solen.results import HIDDEN, reported
from solen.spec.strict import Above0, refused

SHALLOW_UM, DEEP_UM = 25.0, 200.0
"""Depths between which the slope of a working curve is given: the paper's thinnest layer and its stated cure depth."""
_SATURATED = 3.0  # an absorbance that few instruments reach
_OFFSET = 0.01  # change of Dp by an offset that deserves a warning
_ALL_OFFSET = 0.5  # share of an offset in the absorbance from which on it may be all of it
_BENT = 0.05  # how far Dp may run with depth


class PenetrationOptions(RowOptions):
    """How a penetration depth is computed from an absorbance."""

    path_um: Above0
    """Path of the light through the liquid resin in µm."""
    led: str | None = None
    """The printer's lamp: a part of the library, a part's .toml, or a file of a measured spectrum."""
    led_nm: Above0 | None = None
    """Its peak in nm, in place of --led."""
    led_fwhm_nm: Above0 | None = None
    """Its full width at half of the peak in nm; default: a single wavelength."""
    u_path_um: Above0 | None = None
    """Standard uncertainty of the path."""
    u_absorbance: Above0 | None = None
    """Standard uncertainty of the absorbance, the same way at all wavelengths."""
    absorbance: tuple[str, ...] = ()
    """Name of a trace, where there are several; repeatable, and those named are averaged."""

    @model_validator(mode="after")
    def _is_one_lamp(self) -> Self:
        if self.led is not None and (self.led_nm is not None or self.led_fwhm_nm is not None):
            raise refused("led", "names the lamp already", remedy="leave --led-nm and --led-fwhm-nm out")
        if self.led_fwhm_nm is not None and self.led_nm is None:
            raise refused("led_fwhm_nm", "needs the peak", remedy="add --led-nm")
        return self

    @property
    def lamp(self) -> Illuminant | None:
        """Light of the lamp; None if none is named."""
        if self.led is not None:
            return named_light(self.led)
        if self.led_nm is None:
            return None
        width = f", {self.led_fwhm_nm:g} nm wide" if self.led_fwhm_nm else ", one wavelength"
        return led(self.led_nm, self.led_fwhm_nm, f"peak at {self.led_nm:g} nm{width}")


@dataclass(frozen=True, eq=False)
class Attenuation:
    """How a lamp's light is taken off with depth.

    Attributes
    ----------
    wavelength_nm, weight
        Lines of the lamp, shape (n,), and their shares of its power at the surface.
    per_um
        Absorbance of the resin at each, base e, shape (n,).
    """

    wavelength_nm: FloatArray
    weight: FloatArray
    per_um: FloatArray

    def share(self, depth_um: ArrayLike) -> FloatArray:
        """Share of the light that reaches a depth."""
        depth = np.asarray(depth_um, float)
        return np.asarray(np.exp(-depth[..., None] * self.per_um) @ self.weight)

    def local_um(self, depth_um: float = 0.0) -> float:
        """Penetration depth at a depth: the light there over how fast it falls."""
        reached = self.weight * np.exp(-depth_um * (self.per_um - self._least))
        return float(reached.sum() / (reached @ self.per_um))

    def between_um(self, upper_um: float, lower_um: float) -> float:
        """Penetration depth of the exponential through two depths."""
        fall = self._ln_share(upper_um) - self._ln_share(lower_um)
        return (lower_um - upper_um) / fall if fall > 0.0 else self.local_um(upper_um)  # too little light is taken off

    @property
    def _least(self) -> float:
        return float(self.per_um.min())

    def _ln_share(self, depth_um: float) -> float:
        """Logarithm of `share`, also where that is too small for a number."""
        beside = self.weight @ np.exp(-depth_um * (self.per_um - self._least))
        return math.log(float(beside)) - depth_um * self._least


class Penetration(Measured, kw_only=True):
    """Penetration depth of a liquid resin, h/(A ln 10).

    Attributes
    ----------
    path_um
        Path of the light through the resin, in µm.
    Dp_um, u_Dp_um
        Penetration depth at the surface in the lamp's light, in µm, and its standard uncertainty; None without a lamp.
    between_Dp_um
        That of the exponential through two depths, as a working curve of such discs has it, in µm.
    depths_um
        These depths, in µm.
    lamp, lamp_nm
        Where the lamp's spectrum is from, and its mean wavelength in nm; None without a lamp.
    wavelength_nm, absorbance
        Absorbance, base 10, against wavelength, shape (n,).
    spectral_Dp_um
        Penetration depth at each wavelength, in µm, shape (n,); NaN where nothing absorbs.
    traces
        Names of the traces that were averaged.
    """

    path_um: float
    Dp_um: float | None
    u_Dp_um: float | None
    between_Dp_um: float | None
    depths_um: tuple[float, float]
    lamp: str | None
    lamp_nm: float | None
    wavelength_nm: FloatArray
    absorbance: FloatArray
    spectral_Dp_um: FloatArray
    traces: tuple[str, ...]
    attenuation: Attenuation | None = field(metadata=HIDDEN)

    @reported
    def lamp_lines(self) -> tuple[tuple[float, float], ...] | None:
        """Of each line of the lamp its share and its absorption over the mean at the surface; None without a lamp."""
        from solen.material.cure.spectral import lamp_lines

        return None if self.attenuation is None else lamp_lines(self.attenuation)


def penetration_of(recording: Recording, options: PenetrationOptions) -> Penetration:
    """Penetration depth against wavelength, and for a lamp's spectrum.

    Raises
    ------
    DataError
        If the recording holds no absorbance, or the lamp emits where the resin does not absorb.
    """
    light, path_um = options.lamp, options.path_um
    recording = chosen_rows(recording, options)
    beside = refuse_unused(recording, options, (), labels_only=True)
    spectra = optical_spectra(recording, {"T": (), "R": (), "A": options.absorbance})
    absorbance, warnings = _absorbance(recording, spectra)
    nm = spectra.wavelength_nm
    decay = None if light is None else attenuation(path_um, nm, absorbance, light)
    spectral = np.full(len(nm), np.nan)
    absorbs = absorbance > 0.0
    if absorbs.any():
        spectral[absorbs] = penetration_depth_um(path_um, absorbance[absorbs])
    if decay is None:
        warnings.append(look_at("no lamp is named (--led-nm, --led-fwhm-nm or --led): which wavelength counts is open"))
    else:
        warnings += _lamp_warnings(decay, nm, absorbance, path_um)
    limits = note(
        "this is what the liquid absorbs; a working curve's Dp also has in it which wavelengths start the cure, and "
        "what changes as the resin sets"
    )
    return Penetration(
        path_um=path_um,
        Dp_um=None if decay is None else decay.local_um(),
        u_Dp_um=None if decay is None else _uncertainty(decay.local_um(), options),
        between_Dp_um=None if decay is None else decay.between_um(SHALLOW_UM, DEEP_UM),
        depths_um=(SHALLOW_UM, DEEP_UM),
        lamp=None if light is None else light.source,
        lamp_nm=None if light is None else light.mean_nm,
        wavelength_nm=nm,
        absorbance=absorbance,
        spectral_Dp_um=spectral,
        traces=next(iter(spectra.names.values())),
        sources=(recording.provenance,),
        warnings=(*spectra.warnings, *beside, *warnings, limits),
        attenuation=decay,
    )


def penetration_depth_um(path_um: float, absorbance: ArrayLike) -> FloatArray | float:
    """Penetration depth h/(A ln 10) in µm.

    Parameters
    ----------
    path_um
        Path h of the light through the resin in µm.
    absorbance
        A, base 10, a number or shape (n,).

    Raises
    ------
    DataError
        If the path or an absorbance is not above 0.
    """
    _check_path(path_um)
    per_um = np.asarray(absorbance, float) * math.log(10.0) / path_um
    if not np.all(per_um > 0.0):
        raise DataError(
            "absorbance",
            value=float(np.min(np.asarray(per_um))) * path_um / math.log(10.0),
            limit="must be above 0: without absorption there is no penetration depth",
            remedy="take a longer path, or another wavelength",
        )
    return 1.0 / per_um if per_um.ndim else float(1.0 / per_um)


def attenuation(path_um: float, wavelength_nm: ArrayLike, absorbance: ArrayLike, light: Illuminant) -> Attenuation:
    """Attenuation of a lamp's light in a resin.

    Parameters
    ----------
    path_um
        Path in µm through which the absorbance was measured.
    wavelength_nm, absorbance
        Absorbance, base 10, at wavelengths in any order, shape (n,); NaN where unknown.
    light
        Spectrum of the lamp.

    Raises
    ------
    DataError
        If the lamp emits at wavelengths at which the absorbance is unknown or not positive.
    """
    _check_path(path_um)
    resin_nm, values = _sorted(wavelength_nm, absorbance)
    nm = light.wavelength_nm
    if nm[0] < resin_nm[0] or nm[-1] > resin_nm[-1]:
        limit = f"the absorbance is known from {resin_nm[0]:g} to {resin_nm[-1]:g} nm only"
        raise DataError("lamp", value=f"{nm[0]:g} to {nm[-1]:g} nm", limit=limit, remedy="measure it over the lamp")
    at = np.interp(nm, resin_nm, values)
    if not np.all(at > 0.0):
        limit = "absorbance must be above 0 wherever the lamp shines"
        worst = int(np.argmin(at))
        raise DataError(f"absorbance at {nm[worst]:.0f} nm", value=float(at[worst]), limit=limit)
    return Attenuation(nm, light.share, at * math.log(10.0) / path_um)


def _check_path(path_um: float) -> None:
    if not 0.0 < path_um < math.inf:
        raise DataError("path", value=path_um, limit="must be above 0 µm")


def _sorted(nm: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Pairs with both numbers known, by ascending wavelength; where one comes twice, the mean."""
    x, y = np.asarray(nm, float), np.asarray(values, float)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        raise DataError("absorbance", limit="holds no numbers")
    unique, place = np.unique(x[known], return_inverse=True)
    return unique, np.bincount(place, weights=y[known]) / np.bincount(place)


def _absorbance(recording: Recording, spectra: OpticalSpectra) -> tuple[FloatArray, list[Caution]]:
    """Absorbance, base 10, mean of the traces, and what must be known of it."""
    if "A" in spectra.rows:
        names = spectra.names["A"]
        if any(recording.channel(name).quantity == "absorptance" for name in names):
            remedy = "take −log10 T, which a spectrophotometer exports as absorbance"
            raise DataError(", ".join(names), limit="is an absorptance, the share that stays", remedy=remedy)
        return spectra.mean("A"), []
    if "T" not in spectra.rows:
        raise DataError(recording.provenance.file, limit="holds no absorbance", remedy="name the column absorbance")
    t = spectra.mean("T")
    with np.errstate(divide="ignore", invalid="ignore"):
        absorbance = np.where(t > 0.0, -np.log10(t), np.nan)
    return absorbance, [
        look_at("absorbance is −log10 of the transmittance: what the cell's faces reflect counts as absorbed")
    ]


def _uncertainty(surface_um: float, options: PenetrationOptions) -> float | None:
    """Standard uncertainty of the penetration depth at the surface; None if nothing is stated."""
    if options.u_path_um is None and options.u_absorbance is None:
        return None
    by_a = (options.u_absorbance or 0.0) * math.log(10.0) / options.path_um * surface_um
    return surface_um * math.hypot((options.u_path_um or 0.0) / options.path_um, by_a)


def _lamp_warnings(decay: Attenuation, nm: FloatArray, absorbance: FloatArray, path_um: float) -> list[Caution]:
    warnings, surface, deep = [], decay.local_um(), decay.between_um(SHALLOW_UM, DEEP_UM)
    if deep > (1.0 + _BENT) * surface:
        warnings.append(
            look_at(
                f"the lamp's light does not decay exponentially: Dp is {surface:.3g} µm at the surface "
                f"and {deep:.3g} µm between {SHALLOW_UM:g} and {DEEP_UM:g} µm, so that a working curve bends upwards"
            )
        )
    highest = float(decay.per_um.max()) * path_um / math.log(10.0)
    if highest > _SATURATED:
        warnings.append(look_at(f"absorbance reaches {highest:.2g} in the lamp's light: take a shorter path"))
    lowest = int(np.nanargmin(absorbance))
    offset = float(absorbance[lowest]) * math.log(10.0) / path_um * surface
    if abs(offset) > _OFFSET:
        change = "not known at all"
        if offset < _ALL_OFFSET:
            change = f"{abs(offset) / (1.0 - offset):.0%} {'longer' if offset > 0.0 else 'shorter'}"
        warnings.append(
            look_at(
                f"the lowest absorbance is {absorbance[lowest]:.2g}, at {nm[lowest]:.0f} nm: if that is an offset, as "
                f"of the cell's faces, Dp is {change}"
            )
        )
    return warnings
