"""Diagnosis in space recovers what made a recording that an independent tracer lit."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, sensor_response
from solen.analysis.diagnosis import Diagnosis, Response, diagnosed
from solen.analysis.diagnosis.design_response import INDEX
from solen.analysis.diagnosis.light_by_position import light_by_position
from solen.sensor import Sensor
from solen.spec import loads, template, with_values
from tests.analysis.simulated_support import made
from tests.analysis.space_support import CHIPS, DESIGN, LitInSpace, shares, traced
from tests.analysis.space_tracer_support import powers

KNOWN = {"angle.zero_deg": 0.1, INDEX: 0.003}
SEEDS = 200


def recorded(**truth: float) -> SensorResponse:
    return sensor_response([made(LitInSpace(**truth))], AnalysisOptions())  # type: ignore[arg-type]


def test_strips_of_one_angle_give_every_chip() -> None:
    """At 1°, beside the independent tracer; what both may be off by is some 1e-4 of a swing of 0.3."""
    reach_mm = 0.2
    wide = Sensor.of(with_values(DESIGN, {"emitter.width_mm": 2.0 * reach_mm}))
    found = light_by_position(wide, 1.0, reach_mm)
    for number, chip in enumerate(CHIPS):
        ends = chip.offset_mm + 0.5 * chip.width_mm * np.array([-1.0, 1.0])
        low, high = found.integral_to(ends)
        assert (high - low) / chip.width_mm == pytest.approx(shares(number, np.ones(1))[0], abs=2.0e-4)


@pytest.mark.parametrize(
    ("shape", "reach_mm", "chips"),
    [
        ("line-focus", 0.05, ((0.01, 0.08),)),
        pytest.param("layered", 0.2, ((0.0, 0.2), (0.03, 0.24), (-0.05, 0.1)), marks=pytest.mark.evidence),
    ],
)
def test_strips_serve_lenses_for_space(shape: str, reach_mm: float, chips: tuple[tuple[float, float], ...]) -> None:
    """Their light is integrated by nets, to a standard error."""
    lens = with_values(loads(template()), {"lens.shape": shape})
    found = light_by_position(Sensor.of(with_values(lens, {"emitter.width_mm": 2.0 * reach_mm})), -1.0, reach_mm)
    for offset_mm, width_mm in chips:
        low, high = found.integral_to(offset_mm + 0.5 * width_mm * np.array([-1.0, 1.0]))
        chip = Sensor.of(with_values(lens, {"emitter.offset_mm": offset_mm, "emitter.width_mm": width_mm}))
        whole = chip.integrate(-1.0, tolerance=6e-4).detectors
        assert (high - low) / width_mm == pytest.approx([whole[side].power for side in ("right", "left")], abs=1.5e-3)


@pytest.mark.evidence
@pytest.mark.parametrize("chip", range(len(CHIPS)))
def test_the_independent_tracer_gives_what_is_kept_of_it(chip: int) -> None:
    angles, columns = traced(chip)
    for row in (3, 27, 40):
        again = powers(Sensor.of(DESIGN), CHIPS[chip], float(angles[row]), 18, 99)
        assert again == pytest.approx(columns[row], abs=4e-4)


@cache
def response(dimension: str) -> Response:
    sensor = Sensor.of(with_values(DESIGN, {"trace.dimension": dimension}))
    return Response.of(sensor, -3.5, 3.5, {INDEX: KNOWN[INDEX]})


@pytest.mark.evidence
def test_the_table_is_what_the_independent_tracer_gives() -> None:
    for number, chip in enumerate(CHIPS):
        angles, columns = traced(number)
        off = response("extruded").fractions(angles, chip.offset_mm, chip.width_mm**2) - columns
        print(number, off.std(), np.abs(off).max())
        assert off.std() < 8e-5
        assert np.abs(off).max() < 2.5e-4


@pytest.mark.evidence
@pytest.mark.parametrize("by", [-0.003, 0.003])
def test_the_table_follows_the_index(by: float) -> None:
    """A change of up to 2e-3, beside direct integrals."""
    chip, base = CHIPS[0], Sensor.of(DESIGN)
    values = {"emitter.offset_mm": chip.offset_mm, "material.index": 1.44 + by}
    moved = replace(Sensor.of(with_values(DESIGN, values)), cut=base.cut)
    angles = np.array([-2.4, -0.85, 0.0, 0.4, 0.75, 2.3])
    found = response("extruded").fractions(angles, chip.offset_mm, chip.width_mm**2, {INDEX: by})
    for angle, row in zip(angles.tolist(), found, strict=True):
        traced_there = moved.integrate(angle, tolerance=3e-5).detectors
        assert row == pytest.approx([traced_there[side].power for side in ("right", "left")], abs=1.2e-4)


def checked(found: Diagnosis, chip: int) -> dict[str, bool]:
    """Whether intervals hold the truth; errors beyond what is promised fail at once."""
    true = {
        "emitter_offset_mm": CHIPS[chip].offset_mm,
        "chip_width_mm": CHIPS[chip].width_mm,
        "gain_right_V": 8.0,
        "gain_left_V": 7.0,
    }
    held = {}
    for name, value in true.items():
        one = found.estimates[name]
        assert one.value is not None
        assert one.low is not None
        assert one.high is not None
        held[name] = one.low <= value <= one.high
        most = {"emitter_offset_mm": 5e-3, "chip_width_mm": 0.1 * CHIPS[chip].width_mm}.get(name, 0.05 * value)
        assert abs(one.value - value) < most, name
    return held


@pytest.mark.evidence
def test_intervals_hold_chips_in_space() -> None:
    """Recordings whose zero of the angle is off by as much as it is said to be."""
    held: list[dict[str, bool]] = []
    for chip in range(len(CHIPS)):
        draw, warned = np.random.default_rng(chip), 0
        for seed in range(SEEDS):
            zero = 0.1 * float(np.clip(draw.standard_normal(), -3.0, 3.0))
            found = diagnosed(recorded(chip=chip, zero_deg=zero, seed=seed), response("extruded"), KNOWN)
            held.append(checked(found, chip))
            apart = [found.estimates[f"gain_{side}_V"] for side in ("right", "left")]
            assert apart[0].low > apart[1].high  # type: ignore[operator]  # both are known
            warned += found.fitted.misfit.significant
        print(chip, coverage(held[-SEEDS:]), "misfit", warned / SEEDS)
        assert min(coverage(held[-SEEDS:]).values()) >= 0.90
    print("all chips", coverage(held))
    assert max(coverage(held).values()) <= 0.99


def coverage(held: list[dict[str, bool]]) -> dict[str, float]:
    """Share of the recordings whose intervals hold the truth."""
    return {name: sum(one[name] for one in held) / len(held) for name in held[0]}


@pytest.mark.evidence
def test_the_plane_misses_them_and_says_so() -> None:
    found = diagnosed(recorded(), response("2d"), KNOWN)
    print(found.fitted.misfit, {name: (one.value, one.low, one.high) for name, one in found.estimates.items()})
    assert found.fitted.misfit.significant
    assert found.fitted.misfit.share > 0.01
