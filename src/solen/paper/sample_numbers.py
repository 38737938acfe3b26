"""Values from simulated measurements for comparison with the paper, each with its standard uncertainty."""

from pathlib import Path

import numpy as np

from solen.fabricate.process.process_file import default_process
from solen.geometry.coupons import Coupon
from solen.material.cure import MeasuredCurve
from solen.material.cure.exposures import ExposureTrends
from solen.material.index.layer import LayerIndex
from solen.material.stiffness import MeasuredStiffness
from solen.metrology.coupons import CouponMeasurement
from solen.paper.samples import KINDS, NOISE
from solen.recording.spectrum import Listing

RANGE_NM = (450.0, 900.0)
"""Wavelength range of the paper's statement about T."""
PRISTINE, MODIFIED = KINDS


def least_transmittance_percent(index: LayerIndex) -> tuple[float, float]:
    """Return the smallest transmittance over the paper's range."""
    in_range = (index.wavelength_nm >= RANGE_NM[0]) & (index.wavelength_nm <= RANGE_NM[1])
    return 100.0 * float(index.T[in_range].min()), 100.0 * NOISE


def paper_exposure() -> tuple[float, float]:
    """Return the irradiance in mW/cm² and the burn-in exposure in s of the default process, taken from the paper."""
    settings = default_process().process
    return settings.irradiance_mW_per_cm2, settings.burn_in_s


def depth_at(curve: MeasuredCurve, dose_mJ_per_cm2: float) -> tuple[float, float]:
    """Return the cure depth in µm at a dose."""
    return float(curve.depth_um(dose_mJ_per_cm2)), curve.fit.u((1.0, float(np.log(dose_mJ_per_cm2))))


def modulus_change(measured: MeasuredStiffness) -> tuple[float, float]:
    """Return the modulus of the modified resin minus that of the pristine resin, in MPa."""
    by_label = {material.label: material for material in measured.materials}
    modified, pristine = by_label[MODIFIED], by_label[PRISTINE]
    return modified.modulus_MPa - pristine.modulus_MPa, float(
        np.hypot(modified.u_modulus_MPa or 0.0, pristine.u_modulus_MPa or 0.0)
    )


def mean_change_percent(listing: Listing) -> tuple[float, float]:
    """Return the mean transmittance of the modified resin minus that of the pristine resin, in per cent."""
    by_name = {Path(trace.file).stem: spectrum for trace, spectrum in zip(listing.traces, listing.spectra, strict=True)}
    change = by_name[MODIFIED].channel.values - by_name[PRISTINE].channel.values
    return 100.0 * float(change.mean()), 100.0 * NOISE * float(np.sqrt(2.0 / change.size))


def range_nm(listing: Listing) -> dict[str, float]:
    """Return the shortest and longest wavelengths in spectra."""
    ends = [
        float(end)
        for spectrum in listing.spectra
        for end in (spectrum.wavelength_nm.min(), spectrum.wavelength_nm.max())
    ]
    return {"range-low": min(ends), "range-high": max(ends)}


def slope_percent_per_s(trends: ExposureTrends) -> tuple[float | None, float]:
    """Return the slope of transmittance against exposure at the longest evaluated wavelength."""
    trend = max(trends.wavelengths, key=lambda item: item.wavelength_nm).trend_T
    return (None, 0.0) if trend is None else (100.0 * trend.slope_per_s, 100.0 * (trend.u_slope_per_s or 0.0))


def smallest_um(measured: CouponMeasurement, kind: str) -> tuple[float | None, float]:
    """Return the smallest resolved feature of a kind, with its printed size if it has one, in µm."""
    limit = measured.minimum[kind]
    if limit.measured_mm is None:
        return None if limit.nominal_mm is None else 1e3 * limit.nominal_mm, 0.0
    return 1e3 * limit.measured_mm, 1e3 * (limit.u_measured_mm or 0.0)


def film_layer_sizes(coupon: Coupon) -> dict[str, float]:
    """Return the base and film sizes in mm, and the layer thickness in µm, for the film-layer coupon."""
    base, layer = (
        next(feature for feature in coupon.features if feature.stage == stage.name) for stage in coupon.stages
    )
    film_mm = coupon.stages[1].z_offset_mm - base.height_mm
    return {"base": base.height_mm, "film": film_mm, "layer": 1e3 * layer.height_mm}
