"""A sensor with its lens as it was printed: the same light as its equals, and a difference where there is one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Curve, Spline
from solen.errors import DesignError
from solen.lens import Lens, MeasuredLens, MeasuredProfile, OvalLens, profile_text
from solen.plane import Rigid
from solen.sensor import Response, Sensor, as_printed, inert, keys_without_effect
from solen.spec import loads
from solen.trace import Limits, trace, trace_reference
from tests.agreement.compare_support import TURN_RAD, compared, turned
from tests.lens.measured_support import LENS, X, noise_um, placed, profile

ANGLES = (-3.0, -1.0, -0.3, 0.0, 0.4, 2.0)
CHIP = "[emitter]\nwidth_mm = 0.2\n"


def sensor(folder: Path, found: MeasuredProfile | None, text: str = "", index: float = 1.44) -> Sensor:
    """Sensor with a measured profile, or with the oval where there is none."""
    lens = "[lens]\n"
    if found is not None:
        (folder / "lens.json").write_text(profile_text(found), encoding="utf-8")
        lens += 'shape = "measured"\nprofile = "lens.json"\n'
    head = f'schema = 1\nname = "print"\n[material]\nindex = {index}\n'
    own, _, others = text.partition("[") if not text.startswith("[") else ("", "", text[1:])
    return Sensor.of(loads(f"{head}{lens}{own}\n{'[' + others if others else ''}", folder=folder))


class PointByPoint(Lens):
    """Lens whose face goes through every point of a noisy profile."""

    distance_mm, half_width_mm, depth_mm = 1.0, 2.0, LENS.depth_mm
    front = Spline.through(np.column_stack([X, profile(noise_um(0.5), 0.0005).z_mm]))


def contrasts(found: Sensor) -> FloatArray:
    return found.power((-1.0, 0.4), tolerance=1e-3).contrast


def test_the_points_of_the_oval_give_its_response(tmp_path: Path) -> None:
    """1 nm of the curve turns normals by 0.02 mrad, which moves the spot of a point by a fifth of a micrometre."""
    measured, oval = sensor(tmp_path, profile()), sensor(tmp_path, None)
    one, other = measured.power(ANGLES), oval.power(ANGLES)
    off_null = np.abs(one.angle_deg) > 0.1  # at the null the light of a point jumps from one receiver to the other
    assert np.abs(one.right - other.right)[off_null].max() < 2e-5
    assert np.abs(one.contrast - other.contrast).max() < 2e-3
    chip = [sensor(tmp_path, found, CHIP).power((-2.0, 0.4)).contrast for found in (profile(), None)]
    assert np.abs(chip[0] - chip[1]).max() < 5e-4  # the integrals' own tolerance is 1e-4


def test_a_noisy_profile_of_the_oval_traces_to_its_response_within_the_stated_uncertainty(tmp_path: Path) -> None:
    """0.5 µm of noise at points 2 µm apart. The stated uncertainty holds for errors that go together: it is ample."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)
    angles = (-2.0, 0.0, 0.5)
    found = as_printed(measured, measured.power(angles), measured.as_designed.power(angles), draws=4).emitter
    assert np.all(np.abs(found.difference) < 2.0 * found.u_difference + 3e-4)
    assert np.abs(found.difference).max() < 1.5e-3
    assert 5e-4 < found.u_shape.max() < 0.02
    assert found.null_shift_deg is not None
    assert found.u_null_shift_deg is not None
    assert abs(found.null_shift_deg) < 2.0 * found.u_null_shift_deg


def test_a_fan_tells_the_same_of_a_drawn_outline_as_integrals_of_its_exact_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it costs: the fan 5e-4, the curve within a tenth of u; a mean of few draws may hide neither."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)
    angles = (-1.0, 0.4)
    own, designed = measured.power(angles), measured.as_designed.power(angles)
    quick = as_printed(measured, own, designed, draws=2).emitter.u_shape
    monkeypatch.setattr("solen.lens.measured.DRAWN_CURVE_SHARE", 0.0)
    lens = measured.cut
    assert isinstance(lens, MeasuredLens)
    away = [
        replace(measured, cut=lens.drawn_within(k)).power(angles, tolerance=1e-4).contrast - own.contrast
        for k in (1, 2)
    ]
    assert quick == pytest.approx(np.sqrt(np.mean(np.square(away), axis=0)), abs=1.5e-3, rel=0.1)


def test_points_straight_into_a_spline_would_ruin_it(tmp_path: Path) -> None:
    """The same noise, interpolated: what the smoothing is for."""
    measured = sensor(tmp_path, profile(noise_um(0.5), 0.0005), CHIP)

    def contrast(found: Sensor) -> float:
        powers = {name: one.power for name, one in found.trace(-1.0, "power", 4000).detectors.items()}
        return (powers["right"] - powers["left"]) / (powers["right"] + powers["left"])

    oval = contrast(measured.as_designed)
    assert abs(contrast(measured) - oval) < 3e-3
    assert abs(contrast(replace(measured, cut=PointByPoint())) - oval) > 0.1


def test_a_lens_cut_for_another_index_is_that_lens(tmp_path: Path) -> None:
    """The profile of the oval for 1.44 in a design of 1.54: its own focus, and the response of the mismatched lens."""
    measured = sensor(tmp_path, profile(), CHIP, index=1.54)
    assert isinstance(measured.cut, MeasuredLens)
    assert measured.cut.fit.deviation.max_um < -100.0
    assert measured.cut.best_focus_mm(1.54) == pytest.approx(LENS.best_focus_mm(1.54), rel=1e-3)
    mismatched = sensor(tmp_path, None, f"design_index = 1.44\n{CHIP}", index=1.54)
    same = sensor(tmp_path, profile(), f"design_index = 1.44\n{CHIP}", index=1.54)
    assert np.abs(contrasts(same) - contrasts(mismatched)).max() < 2e-3
    # the stem of the first begins 0.23 mm nearer, as the design's lens is flatter
    assert np.abs(contrasts(measured) - contrasts(mismatched)).max() < 0.05
    assert np.abs(contrasts(measured) - contrasts(measured.as_designed)).max() > 0.1


class Placed(Lens):
    """The exact oval moved as a whole and cut at the lens's edges: what a measured one shall be the same as."""

    _cut: Curve
    distance_mm, half_width_mm, depth_mm = 1.0, 2.0, LENS.depth_mm

    def __init__(self, motion: Rigid, scale: float = 1.0) -> None:
        whole = OvalLens(scale, 20.0 * scale, 2.2 * scale, 1.44).front.moved(motion)
        object.__setattr__(self, "_cut", whole.part(_reached(whole, -2.0), _reached(whole, 2.0)))

    @property
    def front(self) -> Curve:
        return self._cut


def _reached(curve: Curve, x_mm: float) -> float:
    """Parameter at which a curve from left to right reaches a lateral position, by halving."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if curve.points(np.array([middle]))[0, 0] < x_mm else (low, middle)
    return 0.5 * (low + high)


BASE = (0.0, LENS.depth_mm)
PLACED = {
    "shifted": (placed(x_shift_mm=0.005), Placed(Rigid(shift=(0.005, 0.0)))),
    "turned": (placed(turn_deg=0.5, about=BASE[1]), Placed(Rigid.about(BASE, 0.5))),
    "smaller": (placed(scale=0.97), Placed(Rigid(), 0.97)),
}


@pytest.mark.parametrize("name", PLACED)
def test_a_lens_out_of_place_or_size_has_the_light_of_the_exact_oval_there(tmp_path: Path, name: str) -> None:
    found, truth = PLACED[name]
    measured = sensor(tmp_path, found, CHIP)
    exact = replace(measured.as_designed, cut=truth)
    one, other = (each.power((-0.4, 0.3), tolerance=1e-4) for each in (measured, exact))
    assert np.abs(one.contrast - other.contrast).max() < 1e-3  # 1e-4 of the emitted power, of which half arrives
    assert np.abs(one.right - other.right).max() < 3e-4
    designed = measured.as_designed.power((-0.4, 0.3), tolerance=1e-4)
    assert np.abs(one.contrast - designed.contrast).max() > 0.015


def test_a_shifted_lens_moves_the_balance_point_as_a_shifted_emitter_does(tmp_path: Path) -> None:
    """By as much, and by the lens's own shift: M + 1 instead of M = 13.9; and by the edges, which do not shift."""
    angles = (-0.3, 0.0, 0.3)
    shifted = sensor(tmp_path, placed(x_shift_mm=0.005), CHIP).power(angles, tolerance=1e-4)
    offset = "[emitter]\nwidth_mm = 0.2\noffset_mm = -0.005\n"
    emitter = sensor(tmp_path, None, offset).power(angles, tolerance=1e-4)
    own, other = shifted.null_deg(), emitter.null_deg()
    assert own is not None
    assert other is not None
    assert abs(other) > 0.05
    assert 1.0 < own / other < 1.3


@pytest.mark.parametrize("mode", ["count", "power"])
def test_engine_and_reference_agree_on_a_measured_lens(tmp_path: Path, mode: str) -> None:
    rough = profile(15.0 * np.sin(4.0 * X) + noise_um(1.0), 0.001)
    scene = sensor(tmp_path, rough).scene(-1.3, rays=60)
    limits = Limits(max_hits=60) if mode == "count" else Limits(min_weight=1e-3, max_hits=60)
    truth = trace_reference(scene, mode, limits, legs=True)  # type: ignore[arg-type]
    others = tuple(
        trace_reference(turned(scene, angle), mode, limits, legs=True)  # type: ignore[arg-type]
        for angle in (TURN_RAD, -TURN_RAD)
    )
    found = compared(truth, others, trace(scene, mode, limits, legs=True))  # type: ignore[arg-type]
    assert found.stretches > 100
    assert found.left_out <= 0.05 * found.stretches
    assert found.deviation_power < 1e-9


def test_a_measured_lens_is_bent_and_traced_in_space(tmp_path: Path) -> None:
    bend = '[motion]\nkind = "bend"\n'
    both = [sensor(tmp_path, found, bend).power([-2.0, 2.0]) for found in (profile(), None)]
    assert np.abs(both[0].right - both[1].right).max() < 1e-5
    space = '[emitter]\npattern = "lambertian"\nwidth_mm = 0.2\nheight_mm = 0.2\n[trace]\ndimension = "extruded"\n'
    found = [sensor(tmp_path, one, space).trace(-1.0, "power", 2**12, sampling="sobol") for one in (profile(), None)]
    assert found[0].ledger.total == pytest.approx(1.0, abs=1e-9)
    for name, reading in found[1].detectors.items():
        assert found[0].detectors[name].power == pytest.approx(reading.power, abs=2e-3)  # 4096 rays, the same ones
    rippled = sensor(tmp_path, profile(2.0 * np.sin(2.0 * np.pi * X / 0.3), 1e-4), space).integrate(-1.0)
    assert rippled.reached
    assert rippled.rays < 1_000_000  # by its cells: none of it is left to millions of samples


def test_what_printing_did_is_reported_with_its_uncertainty(tmp_path: Path) -> None:
    wavy = sensor(tmp_path, profile(10.0 * np.exp(-(((X - 0.5) / 0.4) ** 2)), 0.0005))
    angles = (-1.0, 0.0, 1.0)
    found = as_printed(wavy, wavy.power(angles), draws=3)
    assert found.simulated
    assert found.label == "as printed (simulated)"
    assert found.chip is not None
    assert found.chip.width_mm == 0.2
    assert np.abs(found.chip.difference).max() > 0.03
    assert np.all(found.chip.u_shape > 0.0)
    assert found.chip.null_shift_deg is not None
    assert found.chip.u_null_shift_deg is not None
    assert abs(found.chip.null_shift_deg) > 3.0 * found.chip.u_null_shift_deg
    assert found.emitter.designed.received_share == pytest.approx(found.emitter.printed.received_share, abs=0.05)


def test_an_exact_profile_has_no_uncertainty_of_its_outline(tmp_path: Path) -> None:
    exact = sensor(tmp_path, profile(), CHIP)
    found = as_printed(exact, exact.power((-1.0, 0.0, 1.0)))
    assert found.draws == 0
    assert np.all(found.emitter.u_shape == 0.0)
    assert found.chip is None
    assert np.abs(found.emitter.difference).max() < 5e-4


def test_only_a_measured_lens_is_compared(tmp_path: Path) -> None:
    oval = sensor(tmp_path, None)
    nothing = Response("power", np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0), ())
    with pytest.raises(DesignError, match='must be "measured"'):
        as_printed(oval, nothing)


def test_numbers_of_the_designed_lens_are_inert_where_it_was_measured(tmp_path: Path) -> None:
    measured = sensor(tmp_path, profile())
    assert inert(measured, "lens.focus_mm") == "the lens is measured"
    assert inert(measured, "material.absorption_per_mm") == ""


@pytest.mark.evidence
def test_another_index_leaves_the_measured_lens_as_it_is(tmp_path: Path) -> None:
    measured = sensor(tmp_path, profile())
    slope = measured.derivative("material.index", -0.3).detectors["right"]
    oval = sensor(tmp_path, None, "design_index = 1.44\n")
    assert slope.value == pytest.approx(oval.derivative("material.index", -0.3).detectors["right"].value, rel=0.1)


def test_a_profile_that_is_not_used_is_reported(tmp_path: Path) -> None:
    unused = loads('schema = 1\nname = "a"\n[material]\nindex = 1.44\n[lens]\nprofile = "lens.json"\n', folder=tmp_path)
    assert keys_without_effect(Sensor.of(unused)) == (
        'lens.profile has no effect with lens.shape = "cartesian-oval"; set lens.shape = "measured"',
    )
