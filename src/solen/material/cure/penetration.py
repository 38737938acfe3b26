"""Penetration depth from an absorbance, at single wavelengths and for the spectrum of a lamp.

A resin that transmits 10^(-A) through a path h attenuates light as e^(-z/Dp) with Dp = h/(A ln 10). A lamp emits many
wavelengths. With increasing depth, those that the resin absorbs least dominate and the light decays more slowly, so no
single Dp describes it. `Attenuation` computes the sum over the lines of the lamp; its method `local_um` returns the
penetration depth at one depth, and `between_um` the slope of a working curve through discs of two thicknesses.

Only absorption is modelled. The Dp of a working curve also depends on how efficiently each wavelength initiates the
cure, on bleaching, and on the absorption of the cured resin: the two Dp agree if these effects are small.

`penetration_of` evaluates a recording, `penetration_depth_um` converts an absorbance to a depth, and `attenuation`
describes a lamp's light in a resin.
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
from solen.ranks import Caution, note, warning
from solen.recording import Recording
from solen.recording.model import Measured
from solen.recording.optical import OpticalSpectra, optical_spectra
from solen.results import HIDDEN, reported
from solen.spec.strict import Above0, refused

SHALLOW_UM, DEEP_UM = 25.0, 200.0
"""Depths between which the slope of a working curve is reported: the thinnest layer and the cure depth of the paper."""
_MAX_ABSORBANCE = 3.0  # absorbance that most instruments can measure
_MAX_OFFSET_EFFECT = 0.01  # largest relative change of Dp due to an offset that causes no warning
_MAX_OFFSET_FRACTION = 0.5  # fraction of the absorbance above which an offset may explain all of it
_MAX_DP_CHANGE = 0.05  # largest relative change of Dp with depth that causes no warning


class PenetrationOptions(RowOptions):
    """Options for computing a penetration depth from an absorbance."""

    path_um: Above0
    """Path length of the light through the liquid resin in µm."""
    led: str | None = None
    """Lamp of the printer: a part of the library, a part's .toml file, or a file with a measured spectrum."""
    led_nm: Above0 | None = None
    """Peak wavelength of the lamp in nm, instead of --led."""
    led_fwhm_nm: Above0 | None = None
    """Full width at half maximum of the lamp's spectrum in nm; default: a single wavelength."""
    u_path_um: Above0 | None = None
    """Standard uncertainty of the path length in µm."""
    u_absorbance: Above0 | None = None
    """Standard uncertainty of the absorbance, fully correlated between wavelengths."""
    absorbance: tuple[str, ...] = ()
    """Name of a trace of the absorbance, if there are several; repeatable: the named traces are averaged."""

    @model_validator(mode="after")
    def _check_lamp(self) -> Self:
        if self.led is not None and (self.led_nm is not None or self.led_fwhm_nm is not None):
            raise refused("led", "already specifies the lamp", remedy="omit --led-nm and --led-fwhm-nm")
        if self.led_fwhm_nm is not None and self.led_nm is None:
            raise refused("led_fwhm_nm", "requires the peak wavelength", remedy="add --led-nm")
        return self

    @property
    def lamp(self) -> Illuminant | None:
        """Spectrum of the lamp; None if no lamp is specified."""
        if self.led is not None:
            return named_light(self.led)
        if self.led_nm is None:
            return None
        width = f", {self.led_fwhm_nm:g} nm wide" if self.led_fwhm_nm else ", single wavelength"
        return led(self.led_nm, self.led_fwhm_nm, f"peak at {self.led_nm:g} nm{width}")


@dataclass(frozen=True, eq=False)
class Attenuation:
    """Attenuation of the light of a lamp with depth.

    Attributes
    ----------
    wavelength_nm, weight
        Wavelengths of the lamp's lines, and their fractions of its power at the surface, shape (n,).
    per_um
        Absorption coefficient of the resin per µm at each line, base e, shape (n,).
    """

    wavelength_nm: FloatArray
    weight: FloatArray
    per_um: FloatArray

    def transmitted(self, depth_um: ArrayLike) -> FloatArray:
        """Return the fraction of the light that reaches a given depth."""
        depth = np.asarray(depth_um, float)
        return np.asarray(np.exp(-depth[..., None] * self.per_um) @ self.weight)

    def local_um(self, depth_um: float = 0.0) -> float:
        """Return the local penetration depth at a given depth: the power there divided by its rate of decrease."""
        power = self.weight * np.exp(-depth_um * (self.per_um - self._lowest))
        return float(power.sum() / (power @ self.per_um))

    def between_um(self, upper_um: float, lower_um: float) -> float:
        """Return the penetration depth of the exponential decay between two depths."""
        decrease = self._ln_transmitted(upper_um) - self._ln_transmitted(lower_um)
        return (
            (lower_um - upper_um) / decrease if decrease > 0.0 else self.local_um(upper_um)
        )  # 0 if it is rounded away

    @property
    def _lowest(self) -> float:
        return float(self.per_um.min())

    def _ln_transmitted(self, depth_um: float) -> float:
        """Return the logarithm of `transmitted`, even if that fraction underflows."""
        relative = self.weight @ np.exp(-depth_um * (self.per_um - self._lowest))
        return math.log(float(relative)) - depth_um * self._lowest


class Penetration(Measured, kw_only=True):
    """Penetration depth of a liquid resin, h/(A ln 10).

    Attributes
    ----------
    path_um
        Path length of the light through the resin, in µm.
    Dp_um, u_Dp_um
        Penetration depth at the surface for the lamp's spectrum, in µm, and its standard uncertainty; None without a
        lamp.
    between_Dp_um
        Penetration depth of the exponential decay between two depths, in µm, for comparison with a working curve of
        discs with these thicknesses.
    depths_um
        The two depths, in µm.
    lamp, lamp_nm
        Source of the lamp's spectrum, and its mean wavelength in nm; None without a lamp.
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
        """Fraction of the light in each line of the lamp, and its absorption relative to the mean at the surface."""
        from solen.material.cure.spectral import lamp_lines

        return None if self.attenuation is None else lamp_lines(self.attenuation)


def penetration_of(recording: Recording, options: PenetrationOptions) -> Penetration:
    """Return the penetration depth against wavelength and, if a lamp is specified, for its spectrum.

    Raises
    ------
    DataError
        If the recording contains no absorbance, or the lamp emits where the absorbance is unknown or not positive.
    """
    light, path_um = options.lamp, options.path_um
    recording = chosen_rows(recording, options)
    notes = refuse_unused(recording, options, (), labels_only=True)
    spectra = optical_spectra(recording, {"T": (), "R": (), "A": options.absorbance})
    absorbance, warnings = _absorbance(recording, spectra)
    nm = spectra.wavelength_nm
    decay = None if light is None else attenuation(path_um, nm, absorbance, light)
    spectral = np.full(len(nm), np.nan)
    absorbs = absorbance > 0.0
    if absorbs.any():
        spectral[absorbs] = penetration_depth_um(path_um, absorbance[absorbs])
    if decay is None:
        warnings.append(
            warning(
                "no lamp is specified (--led-nm, --led-fwhm-nm or --led), so the result is for single wavelengths only"
            )
        )
    else:
        warnings += _lamp_warnings(decay, nm, absorbance, path_um)
    limits = note(
        "this Dp describes the absorption of the liquid alone; the Dp of a working curve also depends on how "
        "efficiently each wavelength initiates the cure, and on changes of the absorption during the cure"
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
        warnings=(*spectra.warnings, *notes, *warnings, limits),
        attenuation=decay,
    )


def penetration_depth_um(path_um: float, absorbance: ArrayLike) -> FloatArray | float:
    """Return the penetration depth h/(A ln 10) in µm.

    Parameters
    ----------
    path_um
        Path length h of the light through the resin in µm.
    absorbance
        Absorbance A, base 10, one number or shape (n,).

    Raises
    ------
    DataError
        If the path length or an absorbance is not above 0.
    """
    _check_path(path_um)
    per_um = np.asarray(absorbance, float) * math.log(10.0) / path_um
    if not np.all(per_um > 0.0):
        raise DataError(
            "absorbance",
            value=float(np.min(np.asarray(per_um))) * path_um / math.log(10.0),
            limit="must be above 0: without absorption there is no penetration depth",
            remedy="use a longer path, or another wavelength",
        )
    return 1.0 / per_um if per_um.ndim else float(1.0 / per_um)


def attenuation(path_um: float, wavelength_nm: ArrayLike, absorbance: ArrayLike, light: Illuminant) -> Attenuation:
    """Return the attenuation of a lamp's light in a resin.

    Parameters
    ----------
    path_um
        Path length in µm at which the absorbance was measured.
    wavelength_nm, absorbance
        Absorbance, base 10, at wavelengths in any order, shape (n,); NaN where unknown.
    light
        Spectrum of the lamp.

    Raises
    ------
    DataError
        If the lamp emits at wavelengths where the absorbance is unknown or not positive.
    """
    _check_path(path_um)
    resin_nm, values = _sorted(wavelength_nm, absorbance)
    nm = light.wavelength_nm
    if nm[0] < resin_nm[0] or nm[-1] > resin_nm[-1]:
        limit = f"the absorbance is known only from {resin_nm[0]:g} to {resin_nm[-1]:g} nm"
        raise DataError(
            "spectrum of the lamp",
            value=f"{nm[0]:g} to {nm[-1]:g} nm",
            limit=limit,
            remedy="measure the absorbance over the whole spectrum of the lamp",
        )
    lamp_absorbance = np.interp(nm, resin_nm, values)
    if not np.all(lamp_absorbance > 0.0):
        limit = "must be above 0 wherever the lamp emits"
        lowest = int(np.argmin(lamp_absorbance))
        raise DataError(f"absorbance at {nm[lowest]:.0f} nm", value=float(lamp_absorbance[lowest]), limit=limit)
    return Attenuation(nm, light.weight, lamp_absorbance * math.log(10.0) / path_um)


def _check_path(path_um: float) -> None:
    if not 0.0 < path_um < math.inf:
        raise DataError("path length", value=path_um, limit="must be above 0 µm")


def _sorted(nm: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the pairs without NaN in ascending order of wavelength; values at equal wavelengths are averaged."""
    x, y = np.asarray(nm, float), np.asarray(values, float)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        raise DataError("absorbance", limit="contains no numbers")
    unique, position = np.unique(x[known], return_inverse=True)
    return unique, np.bincount(position, weights=y[known]) / np.bincount(position)


def _absorbance(recording: Recording, spectra: OpticalSpectra) -> tuple[FloatArray, list[Caution]]:
    """Return the mean absorbance of the traces, base 10, with warnings about how it was determined."""
    if "A" in spectra.rows:
        names = spectra.names["A"]
        if any(recording.channel(name).quantity == "absorptance" for name in names):
            limit = "is an absorptance (the absorbed fraction of the light), not an absorbance"
            remedy = "use −log10 T, which a spectrophotometer exports as absorbance"
            raise DataError(", ".join(names), limit=limit, remedy=remedy)
        return spectra.mean("A"), []
    if "T" not in spectra.rows:
        remedy = "name its column absorbance"
        raise DataError(recording.provenance.file, limit="contains no absorbance", remedy=remedy)
    t = spectra.mean("T")
    with np.errstate(divide="ignore", invalid="ignore"):
        absorbance = np.where(t > 0.0, -np.log10(t), np.nan)
    return absorbance, [
        warning(
            "the absorbance is computed as −log10 T: light that is reflected by the faces of the cell is treated as "
            "absorbed"
        )
    ]


def _uncertainty(surface_um: float, options: PenetrationOptions) -> float | None:
    """Return the standard uncertainty of the penetration depth at the surface; None if no uncertainty is specified."""
    if options.u_path_um is None and options.u_absorbance is None:
        return None
    relative_a = (options.u_absorbance or 0.0) * math.log(10.0) / options.path_um * surface_um
    return surface_um * math.hypot((options.u_path_um or 0.0) / options.path_um, relative_a)


def _lamp_warnings(decay: Attenuation, nm: FloatArray, absorbance: FloatArray, path_um: float) -> list[Caution]:
    warnings, surface, deep = [], decay.local_um(), decay.between_um(SHALLOW_UM, DEEP_UM)
    if deep > (1.0 + _MAX_DP_CHANGE) * surface:
        warnings.append(
            warning(
                f"the light of the lamp does not decay exponentially: Dp is {surface:.3g} µm at the surface "
                f"and {deep:.3g} µm between {SHALLOW_UM:g} and {DEEP_UM:g} µm, so the working curve is curved upwards"
            )
        )
    highest = float(decay.per_um.max()) * path_um / math.log(10.0)
    if highest > _MAX_ABSORBANCE:
        warnings.append(
            warning(
                f"the absorbance reaches {highest:.2g} within the spectrum of the lamp, more than most instruments "
                "can measure: use a shorter path"
            )
        )
    lowest = int(np.nanargmin(absorbance))
    offset = float(absorbance[lowest]) * math.log(10.0) / path_um * surface
    if abs(offset) > _MAX_OFFSET_EFFECT:
        change = "undetermined"
        if offset < _MAX_OFFSET_FRACTION:
            change = f"{abs(offset) / (1.0 - offset):.0%} {'larger' if offset > 0.0 else 'smaller'}"
        warnings.append(
            warning(
                f"the lowest absorbance is {absorbance[lowest]:.2g}, at {nm[lowest]:.0f} nm: if "
                f"this value is an offset, for example due to the faces of the cell, Dp is {change}"
            )
        )
    return warnings
