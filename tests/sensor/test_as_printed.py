"""A sensor with its lens as printed: the light of equivalent lenses, and differences with their uncertainties."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Curve, Spline
from solen.errors import DesignError
from solen.lens import Lens, MeasuredLens, MeasuredProfile, OvalLens, profile_text
from solen.plane import Rigid
from solen.sensor import Response, Sensor, as_printed, keys_without_effect, why_inert
from solen.spec import loads
from solen.trace import Limits, Mode
from tests.agreement.compare_support import compare_tracers
from tests.lens.measured_support import LENS, X, noise_um, placed, profile

ANGLES = (-3.0, -1.0, -0.3, 0.0, 0.4, 2.0)
CHIP = "[emitter]\nwidth_mm = 0.2\n"


def sensor(folder: Path, measured_profile: MeasuredProfile | None, text: str = "", index: float = 1.44) -> Sensor:
    """Sensor with a measured profile, by default with the oval."""
    lens = "[lens]\n"
    if measured_profile is not None:
        (folder / "lens.json").write_text(profile_text(measured_profile), encoding="utf-8")
        lens += 'shape = "measured"\nprofile = "lens.json"\n'
    head = f'schema = 1\nname = "print"\n[material]\nindex = {index}\n'
    lens_keys, _, tables = text.partition("[") if not text.startswith("[") else ("", "", text[1:])
    return Sensor.of(loads(f"{head}{lens}{lens_keys}\n{'[' + tables if tables else ''}", folder=folder))


class PointByPoint(Lens):
    """Lens with a spline through every point of a noisy profile."""

    distance_mm, half_width_mm, depth_mm = 1.0, 2.0, LENS.depth_mm
    front = Spline.through(np.column_stack([X, profile(noise_um(0.5), 0.0005).z_mm]))


def contrasts(traced_sensor: Sensor) -> FloatArray:
    return traced_sensor.power((-1.0, 0.4), tolerance=1e-3).contrast


def test_profile_of_the_oval_has_the_ovals_response(tmp_path: Path) -> None:
    """An error of 1 nm of the curve rotates normals by 0.02 mrad, which moves the spot of a point by 0.2 µm."""
    measured, oval = sensor(tmp_path, profile()), sensor(tmp_path, None)
    response, reference = measured.power(ANGLES), oval.power(ANGLES)
    away_from_null = np.abs(response.angle_deg) > 0.1  # at the null, the light of a point jumps between receivers
    assert np.abs(response.right - reference.right)[away_from_null].max() < 2e-5
    assert np.abs(response.contrast - reference.contrast).max() < 2e-3
    chip = [sensor(tmp_path, lens_profile, CHIP).power((-2.0, 0.4)).contrast for lens_profile in (profile(), None)]
    assert np.abs(chip[0] - chip[1]).max() < 5e-4  # the tolerance of the integrals is 1e-4


def test_noisy_profile_of_the_oval_has_its_response_within_the_uncertainty(tmp_path: Path) -> None:
    """Noise of 0.5 µm at points 2 µm apart; the uncertainty allows for correlated errors, so it is a wide bound."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)
    angles = (-2.0, 0.0, 0.5)
    result = as_printed(measured, measured.power(angles), measured.as_designed.power(angles), draws=4).emitter
    assert np.all(np.abs(result.difference) < 2.0 * result.u_difference + 3e-4)
    assert np.abs(result.difference).max() < 1.5e-3
    assert 5e-4 < result.u_shape.max() < 0.02
    assert result.null_shift_deg is not None
    assert result.u_null_shift_deg is not None
    assert abs(result.null_shift_deg) < 2.0 * result.u_null_shift_deg


def test_fan_and_integral_agree_on_the_uncertainty_of_the_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fan adds errors of 5e-4, and the coarser curve a tenth of u, to the uncertainty from two draws."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)
    angles = (-1.0, 0.4)
    response, designed = measured.power(angles), measured.as_designed.power(angles)
    by_fan = as_printed(measured, response, designed, draws=2).emitter.u_shape
    monkeypatch.setattr("solen.lens.measured.OUTLINE_TOLERANCE", 0.0)
    lens = measured.cut
    assert isinstance(lens, MeasuredLens)
    deviations = [
        replace(measured, cut=lens.with_outline(k)).power(angles, tolerance=1e-4).contrast - response.contrast
        for k in (1, 2)
    ]
    assert by_fan == pytest.approx(np.sqrt(np.mean(np.square(deviations), axis=0)), abs=1.5e-3, rel=0.1)


def test_interpolation_without_smoothing_falsifies_the_response(tmp_path: Path) -> None:
    """A spline through all points of a noisy profile changes the contrast; the smoothed lens does not."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)

    def contrast(traced_sensor: Sensor) -> float:
        powers = {name: detector.power for name, detector in traced_sensor.trace(-1.0, "power", 4000).detectors.items()}
        return (powers["right"] - powers["left"]) / (powers["right"] + powers["left"])

    oval = contrast(measured.as_designed)
    assert abs(contrast(measured) - oval) < 3e-3
    assert abs(contrast(replace(measured, cut=PointByPoint())) - oval) > 0.1


def test_measured_lens_designed_for_another_index_has_its_own_focus(tmp_path: Path) -> None:
    """The profile of the oval for 1.44 in a material of 1.54 has the response of the mismatched lens."""
    measured = sensor(tmp_path, profile(), CHIP, index=1.54)
    assert isinstance(measured.cut, MeasuredLens)
    assert measured.cut.fit.deviation.max_um < -100.0
    assert measured.cut.best_focus_mm(1.54) == pytest.approx(LENS.best_focus_mm(1.54), rel=1e-3)
    mismatched = sensor(tmp_path, None, f"design_index = 1.44\n{CHIP}", index=1.54)
    same = sensor(tmp_path, profile(), f"design_index = 1.44\n{CHIP}", index=1.54)
    assert np.abs(contrasts(same) - contrasts(mismatched)).max() < 2e-3
    # the stem of the measured sensor begins 0.23 mm nearer, as the design's lens is flatter
    assert np.abs(contrasts(measured) - contrasts(mismatched)).max() < 0.05
    assert np.abs(contrasts(measured) - contrasts(measured.as_designed)).max() > 0.1


class DisplacedOval(Lens):
    """The exact oval, displaced or scaled and cut at the lens's edges, which a measured lens must agree with."""

    _cut: Curve
    distance_mm, half_width_mm, depth_mm = 1.0, 2.0, LENS.depth_mm

    def __init__(self, motion: Rigid, scale: float = 1.0) -> None:
        full = OvalLens(scale, 20.0 * scale, 2.2 * scale, 1.44).front.moved(motion)
        object.__setattr__(self, "_cut", full.part(_parameter_at(full, -2.0), _parameter_at(full, 2.0)))

    @property
    def front(self) -> Curve:
        return self._cut


def _parameter_at(curve: Curve, x_mm: float) -> float:
    """Parameter at which a curve from left to right reaches a lateral position, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if curve.points(np.array([mid]))[0, 0] < x_mm else (low, mid)
    return 0.5 * (low + high)


STEM_BASE = (0.0, LENS.depth_mm)
DISPLACED = {
    "shifted": (placed(x_shift_mm=0.005), DisplacedOval(Rigid(shift=(0.005, 0.0)))),
    "turned": (placed(turn_deg=0.5, about=STEM_BASE[1]), DisplacedOval(Rigid.about(STEM_BASE, 0.5))),
    "smaller": (placed(scale=0.97), DisplacedOval(Rigid(), 0.97)),
}


@pytest.mark.parametrize("name", DISPLACED)
def test_displaced_or_scaled_lens_has_the_light_of_the_exact_oval(tmp_path: Path, name: str) -> None:
    displaced_profile, displaced_oval = DISPLACED[name]
    measured = sensor(tmp_path, displaced_profile, CHIP)
    exact = replace(measured.as_designed, cut=displaced_oval)
    response, reference = (each.power((-0.4, 0.3), tolerance=1e-4) for each in (measured, exact))
    assert np.abs(response.contrast - reference.contrast).max() < 1e-3  # from 1e-4 of the power
    assert np.abs(response.right - reference.right).max() < 3e-4
    designed = measured.as_designed.power((-0.4, 0.3), tolerance=1e-4)
    assert np.abs(response.contrast - designed.contrast).max() > 0.015


def test_shifted_lens_moves_the_null_like_a_shifted_emitter(tmp_path: Path) -> None:
    """The factor is (M + 1)/M for a magnification M = 13.9, and is increased by the edges, which are not shifted."""
    angles = (-0.3, 0.0, 0.3)
    shifted = sensor(tmp_path, placed(x_shift_mm=0.005), CHIP).power(angles, tolerance=1e-4)
    offset = "[emitter]\nwidth_mm = 0.2\noffset_mm = -0.005\n"
    emitter = sensor(tmp_path, None, offset).power(angles, tolerance=1e-4)
    lens_null, emitter_null = shifted.null_deg(), emitter.null_deg()
    assert lens_null is not None
    assert emitter_null is not None
    assert abs(emitter_null) > 0.05
    assert 1.0 < lens_null / emitter_null < 1.3


@pytest.mark.parametrize("mode", ["count", "power"])
def test_engine_and_reference_agree_on_a_measured_lens(tmp_path: Path, mode: Mode) -> None:
    rippled_profile = profile(15.0 * np.sin(4.0 * X) + noise_um(1.0), 0.001)
    scene = sensor(tmp_path, rippled_profile).scene(-1.3, rays=60)
    limits = Limits(max_hits=60) if mode == "count" else Limits(min_weight=1e-3, max_hits=60)
    comparison = compare_tracers(scene, mode, limits)[2]
    assert comparison.segments > 100
    assert comparison.excluded <= 0.05 * comparison.segments
    assert comparison.deviation_power < 1e-9


def test_measured_lens_is_bent_and_traced_in_space(tmp_path: Path) -> None:
    bend = '[motion]\nkind = "bend"\n'
    responses = [sensor(tmp_path, traces, bend).power([-2.0, 2.0]) for traces in (profile(), None)]
    assert np.abs(responses[0].right - responses[1].right).max() < 1e-5
    space = '[emitter]\npattern = "lambertian"\nwidth_mm = 0.2\nheight_mm = 0.2\n[trace]\ndimension = "extruded"\n'
    traces = [
        sensor(tmp_path, lens_profile, space).trace(-1.0, "power", 2**12, sampling="sobol")
        for lens_profile in (profile(), None)
    ]
    assert traces[0].ledger.total == pytest.approx(1.0, abs=1e-9)
    for name, reading in traces[1].detectors.items():
        assert traces[0].detectors[name].power == pytest.approx(reading.power, abs=2e-3)  # the same 4096 rays
    rippled = sensor(tmp_path, profile(2.0 * np.sin(2.0 * np.pi * X / 0.3), 1e-4), space).integrate(-1.0)
    assert rippled.reached
    assert rippled.rays < 1_000_000  # by cells, without millions of samples


def test_effect_of_printing_is_reported_with_its_uncertainty(tmp_path: Path) -> None:
    wavy = sensor(tmp_path, profile(10.0 * np.exp(-(((X - 0.5) / 0.4) ** 2)), 0.0005))
    angles = (-1.0, 0.0, 1.0)
    result = as_printed(wavy, wavy.power(angles), draws=3)
    assert result.simulated
    assert result.label == "as printed (simulated)"
    assert result.chip is not None
    assert result.chip.width_mm == 0.2
    assert np.abs(result.chip.difference).max() > 0.03
    assert np.all(result.chip.u_shape > 0.0)
    assert result.chip.null_shift_deg is not None
    assert result.chip.u_null_shift_deg is not None
    assert abs(result.chip.null_shift_deg) > 3.0 * result.chip.u_null_shift_deg
    assert result.emitter.designed.received_share == pytest.approx(result.emitter.printed.received_share, abs=0.05)


def test_exact_profile_has_no_shape_uncertainty(tmp_path: Path) -> None:
    exact = sensor(tmp_path, profile(), CHIP)
    result = as_printed(exact, exact.power((-1.0, 0.0, 1.0)))
    assert result.draws == 0
    assert np.all(result.emitter.u_shape == 0.0)
    assert result.chip is None
    assert np.abs(result.emitter.difference).max() < 5e-4


def test_refuses_a_lens_that_is_not_measured(tmp_path: Path) -> None:
    oval = sensor(tmp_path, None)
    empty = Response("power", np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0), ())
    with pytest.raises(DesignError, match='must be "measured"'):
        as_printed(oval, empty)


def test_numbers_of_the_designed_lens_are_inert_for_a_measured_lens(tmp_path: Path) -> None:
    measured = sensor(tmp_path, profile())
    assert why_inert(measured, "lens.focus_mm") == "the lens is measured"
    assert why_inert(measured, "material.absorption_per_mm") == ""


@pytest.mark.evidence
def test_derivative_by_the_index_keeps_the_measured_shape(tmp_path: Path) -> None:
    measured = sensor(tmp_path, profile())
    slope = measured.derivative("material.index", -0.3).detectors["right"]
    oval = sensor(tmp_path, None, "design_index = 1.44\n")
    assert slope.value == pytest.approx(oval.derivative("material.index", -0.3).detectors["right"].value, rel=0.1)


def test_reports_an_unused_profile(tmp_path: Path) -> None:
    unused = loads('schema = 1\nname = "a"\n[material]\nindex = 1.44\n[lens]\nprofile = "lens.json"\n', folder=tmp_path)
    assert keys_without_effect(Sensor.of(unused)) == (
        'lens.profile has no effect with lens.shape = "cartesian-oval"; set lens.shape = "measured"',
    )
