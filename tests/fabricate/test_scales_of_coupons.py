"""Calibrations treat the scale of an image as an unknown, so that its error is not taken for shrinkage."""

import contextlib
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.fabricate.process import (
    MeasuredCoupon,
    MeasuredFeature,
    PrinterCalibration,
    Settings,
    SharedScale,
    calibrated,
    default_process,
    printed_mm,
    read_features,
)
from solen.geometry.coupons import Coupon, CouponOptions, layout
from solen.metrology import as_image
from solen.metrology.coupons import measure_coupon
from solen.results import plain
from tests.fabricate.print_support import settings
from tests.metrology.coupon_support import Camera, Print

UM = 20.0
SIZES = {"pillar": (1.0, 0.5, 0.3, 0.2, 0.14, 0.1), "gap": (0.5, 0.3, 0.2, 0.15), "hole": (1.4, 1.5, 1.65, 0.4)}
DESIGNED = [MeasuredFeature(kind, size, None, None, True) for kind, sizes in SIZES.items() for size in sizes]  # type: ignore[arg-type]  # keys of a dict


def shrinking(percent: float) -> Settings:
    return settings(sigma_um=22.0, Ec_mJ_per_cm2=3.2, shrinkage_percent=percent)


def coupon_image(true: Settings, factor: float, u_scale: float | None, seed: int, um: float = 5.0) -> MeasuredCoupon:
    """Return simulated sizes in an image whose scale is wrong by a factor."""
    rng, features = np.random.default_rng(seed), []
    for feature, size in zip(DESIGNED, printed_mm(true, DESIGNED).tolist(), strict=True):
        measured, u_own = factor * size + 0.002 * rng.standard_normal(), 0.002
        u = float(np.hypot(u_own, measured * (u_scale or 0.0)))
        features.append(dataclasses.replace(feature, measured_mm=measured, u_measured_mm=u, u_own_mm=u_own))
    return MeasuredCoupon(tuple(features), SharedScale(um, u_scale))


def shrinkage(fit: PrinterCalibration) -> tuple[float, float]:
    (result,) = (number for number in fit.numbers if number.key == "shrinkage_percent")
    return result.value, result.u


@pytest.mark.parametrize("u_scale", [0.01, None])
def test_a_scale_error_is_not_taken_for_shrinkage(u_scale: float | None) -> None:
    """With independent errors of the features, an error of 1 % would change a shrinkage of 1.5 % to 0.515 ± 0.010."""
    fit = calibrated(default_process(), [coupon_image(shrinking(1.5), 1.01, u_scale, 1)], "test")
    value, u = shrinkage(fit)
    assert abs(value - 1.5) < 1.96 * u
    assert u > 0.5
    (scale,) = fit.scales
    assert abs(scale.factor - 1.01) < 1.96 * scale.u_factor
    assert any("--u-um-per-px" in warning for warning in fit.warnings) == (u_scale is None)


def test_an_exact_scale_gives_an_exact_shrinkage() -> None:
    value, u = shrinkage(calibrated(default_process(), [coupon_image(shrinking(1.5), 1.0, 1e-4, 2)], "test"))
    assert u < 0.1
    assert abs(value - 1.5) < 3.0 * u


def test_images_of_the_same_objective_have_a_common_scale_error() -> None:
    same = [coupon_image(shrinking(1.5), 1.01, 0.01, seed) for seed in range(4)]
    different = [coupon_image(shrinking(1.5), 1.0, 0.01, seed, 4.0 + 0.3 * seed) for seed in range(4)]
    (_, u_single), (value, u_same), (_, u_different) = (
        shrinkage(calibrated(default_process(), images, "test")) for images in (same[:1], same, different)
    )
    assert u_same > 0.93 * u_single
    assert u_different < 0.6 * u_single
    assert abs(value - 1.5) < 1.96 * u_same


def test_different_scale_errors_do_not_increase_the_uncertainty_of_the_growth() -> None:
    images = [coupon_image(shrinking(1.5), factor, 0.01, seed) for seed, factor in ((1, 1.01), (2, 0.997))]
    fit = calibrated(default_process(), images, "test")
    assert fit.scale < 1.6
    assert fit.numbers[1].u < 1.0


def printed(coupon: Coupon, true: Settings) -> Print:
    """Return a coupon as printed by the model, with shrunk features and distances."""
    features = [
        MeasuredFeature("hole" if each.kind == "hole" else "pillar", each.diameter_mm, None, None, True)
        for each in coupon.features
    ]
    names = [feature.name for feature in coupon.features]
    sizes = dict(zip(names, printed_mm(true, features).tolist(), strict=True))
    missing = frozenset(name for name, size in sizes.items() if np.isnan(size))
    stretch = 1.0 - 0.01 * true.shrinkage_percent
    return Print(coupon, lambda feature: sizes[feature.name], missing=missing, stretch=stretch)


def shrinkage_error(folder: Path, name: str, seed: int, u_scale: float) -> tuple[float, float]:
    """Return the error of the shrinkage and its uncertainty, for an image with a scale error of up to 2 %."""
    rng = np.random.default_rng([seed, 3])
    percent, factor = rng.uniform(0.0, 2.5), 1.0 + 0.02 * rng.uniform(-1.0, 1.0)
    coupon, true = layout(name, CouponOptions()), shrinking(percent)
    camera = Camera(um_per_px=UM, angle_deg=rng.uniform(-8.0, 8.0), blur_px=1.2, noise=0.02)
    scale = UM * factor
    image = as_image(camera.image(printed(coupon, true), seed), scale, u_um_per_px=u_scale * scale)
    path = folder / f"{seed}.json"
    path.write_text(json.dumps(plain(measure_coupon(image, coupon))), encoding="utf-8")
    value, u = shrinkage(calibrated(default_process(), [read_features(path)], "test"))
    return value - percent, u


def test_shrinkage_from_images_with_a_scale_error(tmp_path: Path) -> None:
    error, u = np.array([shrinkage_error(tmp_path, "holes", seed, 0.01) for seed in range(3)]).T
    assert np.all(np.abs(error) < 2.5 * u)


@pytest.mark.evidence
def test_uncertainties_of_the_shrinkage_are_calibrated(tmp_path: Path) -> None:
    """For scale errors of up to 2 % with an uncertainty of 1 %, the 95 % interval covers at least 95 %."""
    results = []
    for seed in range(300):
        with contextlib.suppress(DataError):  # with pixels of 20 µm, adjacent holes can be confused
            results.append(shrinkage_error(tmp_path, "group-a" if seed % 10 == 0 else "holes", seed, 0.01))
    error, u = np.array(results).T
    coverage = float(np.mean(np.abs(error) < 1.96 * u))
    spread = f"errors of {np.std(error):.2f} %, u {np.median(u):.2f} %"
    print(f"{len(results)} measured, coverage of 95 % intervals {coverage:.3f}, {spread}")
    assert len(results) > 285
    assert coverage >= 0.95
