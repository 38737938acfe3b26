"""The tables of a design: the paper's defaults, the limits of every number, and the angles of a sweep."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.errors import FrozenError, SpecError
from solen.spec import Body, Design, Emitter, Lens, Material, Motion, Receivers, Trace, with_values


def design(**tables: Any) -> Design:
    return Design(**{"name": "test", "material": {"index": 1.44}} | tables)


def error_line(**tables: Any) -> str:
    with pytest.raises(SpecError) as refusal:
        design(**tables)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_a_design_with_a_name_and_an_index_is_the_sensor_of_the_paper() -> None:
    paper = design()
    assert paper.material == Material(index=1.44, absorption_per_mm=0.0)
    assert paper.emitter == Emitter(
        wavelength_nm=860, distance_mm=1.0, offset_mm=0.0, cone_deg=120, rays=100, pattern="fan"
    )
    assert paper.lens == Lens(shape="cartesian-oval", focus_mm=20.0, half_width_mm=2.0, design_index=None)
    assert paper.body == Body(
        kind="y",
        stem_length_mm=16.2,
        stem_curve_per_mm=0.004,
        arm_length_mm=22.2,
        arm_width_mm=3.0,
        arm_angle_deg=None,
        thickness_mm=4.0,
    )
    assert paper.receivers == Receivers(coupling="matched", gap_mm=None)
    assert paper.motion == Motion(
        kind="rotation", pivot="stem-base", moves=("lens", "emitter"), from_deg=-3.0, to_deg=3.0, step_deg=0.25
    )
    assert paper.trace == Trace(mode="count")


def test_a_design_is_frozen_and_hashable() -> None:
    paper = design()
    with pytest.raises(FrozenError, match=r"design\.set"):
        paper.lens.focus_mm = 3.0  # type: ignore[misc]
    assert hash(paper) == hash(design())
    assert paper != design(lens={"focus_mm": 21})
    assert paper != "a design"


LIMITS = [
    ("material", "index", 0.99, "at least 1"),
    ("material", "index", 5, "less than 5"),
    ("material", "absorption_per_mm", -0.1, "at least 0"),
    ("emitter", "wavelength_nm", 99, "at least 100"),
    ("emitter", "wavelength_nm", 20001, "at most 20000"),
    ("lens", "focus_mm", 1e200, "at most 1000000"),
    ("emitter", "offset_mm", -1e7, "at least -1000000"),
    ("emitter", "distance_mm", 0, "at least 1e-06"),
    ("emitter", "cone_deg", 0, "greater than 0"),
    ("emitter", "cone_deg", 360.5, "at most 360"),
    ("emitter", "rays", 0, "at least 1"),
    ("emitter", "rays", 1_000_000_001, "at most 1000000000"),
    ("lens", "focus_mm", 0, "at least 1e-06"),
    ("lens", "half_width_mm", -2.0, "at least 1e-06"),
    ("lens", "design_index", 0.5, "at least 1"),
    ("lens", "design_index", 5.0, "less than 5"),
    ("body", "stem_length_mm", 0, "at least 1e-06"),
    ("body", "arm_length_mm", 0, "at least 1e-06"),
    ("body", "arm_width_mm", 0, "at least 1e-06"),
    ("body", "arm_angle_deg", 0, "greater than 0"),
    ("body", "arm_angle_deg", 90, "less than 90"),
    ("body", "thickness_mm", 0, "at least 1e-06"),
    ("receivers", "gap_mm", 0, "at least 1e-06"),
    ("motion", "from_deg", -90, "greater than -90"),
    ("motion", "to_deg", 90, "less than 90"),
    ("motion", "step_deg", 0, "greater than 0"),
]


@pytest.mark.parametrize(("table", "key", "value", "limit"), LIMITS)
def test_a_number_outside_its_limits_is_reported_with_value_and_limit(
    table: str, key: str, value: float, limit: str
) -> None:
    assert error_line(**{table: {key: value}}).startswith(f"{table}.{key} = {value}; must be {limit}")


NUMBERS = [
    (table, key)
    for table in ("emitter", "lens", "body", "motion")
    for key in Design.model_fields[table].annotation.model_fields  # type: ignore[union-attr]
    if key.endswith(("_mm", "_nm", "_deg", "_index", "rays")) and key != "depths_mm"  # a list
]


@pytest.mark.parametrize(("table", "key"), NUMBERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "3", [3.0], 10**400])
def test_numbers_must_be_finite(table: str, key: str, value: object) -> None:
    line = error_line(**{table: {key: value}})
    assert line.startswith(f"{table}.{key} = ")
    assert "must be" in line
    assert len(line) < 200


def test_the_numbers_of_all_tables_are_tested() -> None:
    assert len(NUMBERS) >= 16


@pytest.mark.parametrize("value", [1e6, 1.5])
def test_the_number_of_rays_is_an_integer(value: float) -> None:
    assert f"emitter.rays = {value}; must be an integer" in error_line(emitter={"rays": value})


@pytest.mark.parametrize(
    ("table", "key", "value", "choices"),
    [
        ("lens", "shape", "oval", "'cartesian-oval', 'spline', 'line-focus', 'layered', 'measured' or 'none'"),
        ("receivers", "coupling", "air", "'matched' or 'air-gap'"),
        ("trace", "mode", "counts", "'count', 'power' or 'roulette'"),
        ("body", "kind", "x", "'y'"),
        ("motion", "kind", "shift", "'rotation'"),
        ("emitter", "pattern", "cone", "'fan'"),
    ],
)
def test_a_wrong_choice_is_reported_with_the_choices(table: str, key: str, value: str, choices: str) -> None:
    assert error_line(**{table: {key: value}}).startswith(f"{table}.{key} = {value!r}; must be {choices}")


def test_the_material_has_either_an_index_or_a_resin() -> None:
    assert error_line(material={}).startswith("material; contains neither index nor resin; add")
    both = error_line(material={"index": 1.4, "resin": "pmma"})
    assert both.startswith("material; ")
    assert "both index and resin" in both


def test_an_error_in_a_single_table_names_the_dotted_key() -> None:
    with pytest.raises(
        SpecError, match=r"^lens\.focus_mm = -1; must be at least 1e-06; omit it for the default, 20\.0$"
    ):
        Lens(focus_mm=-1)


def test_a_gap_is_required_with_an_air_gap_and_only_then() -> None:
    assert Receivers(coupling="air-gap", gap_mm=0.5).gap_mm == 0.5
    assert error_line(receivers={"coupling": "air-gap"}).startswith("receivers.gap_mm; is missing")
    assert error_line(receivers={"gap_mm": 0.5}).startswith("receivers.gap_mm = 0.5; does not apply with coupling")


@pytest.mark.parametrize("name", ["", " ", "two\nlines", 3])
def test_a_name_is_one_line(name: object) -> None:
    assert error_line(name=name).startswith(f"name = {name!r}; must be")


def test_the_first_problem_is_reported_and_the_others_are_counted() -> None:
    assert "more problem" not in error_line(lens={"focus_mm": -1})
    assert error_line(lens={"focus_mm": -1}, body={"kind": "x"}).endswith("and 1 more problem")
    assert error_line(lens={"focus_mm": -1}, body={"kind": "x"}, trace={"mode": 2}).endswith("and 2 more problems")


def test_a_long_value_is_shortened_in_the_message() -> None:
    line = error_line(emitter={"pattern": "x" * 1000})
    assert "xxx..." in line
    assert len(line) < 200


@pytest.mark.parametrize("pivot", ["stem-base", "emitter", (1.5, -2.0)])
def test_a_pivot_is_a_name_or_a_point(pivot: Any) -> None:
    assert Motion(pivot=list(pivot) if isinstance(pivot, tuple) else pivot).pivot == pivot


@pytest.mark.parametrize("pivot", ["stem", [1.0], [1, 2, 3], [1, math.nan], [1, True], ["1", 2], 3])
def test_refuses_invalid_pivots(pivot: object) -> None:
    line = error_line(motion={"pivot": pivot})
    assert line.startswith(f'motion.pivot = {pivot!r}; must be "stem-base", "emitter" or [x_mm, z_mm]')


@pytest.mark.parametrize("moves", [["lens", "emitter"], ["emitter", "lens"]])
def test_the_order_of_moves_is_irrelevant(moves: Any) -> None:
    assert Motion(moves=moves).moves == ("lens", "emitter")
    assert Motion(moves=["emitter"]).moves == ("emitter",)
    assert Motion(moves=["receivers", "lens"]).moves == ("lens", "receivers")


@pytest.mark.parametrize("moves", [[], ["emitter", "emitter"], "emitter", ["body", "emitter"], 3])
def test_refuses_invalid_moves(moves: object) -> None:
    assert error_line(motion={"moves": moves}).startswith(f"motion.moves = {moves!r}; must be a list of")


def test_receivers_move_only_behind_a_gap_and_a_y_has_no_mirrors() -> None:
    gap = {"coupling": "air-gap", "gap_mm": 0.5}
    assert design(motion={"moves": ["receivers"]}, receivers=gap).motion.moves == ("receivers",)
    line = error_line(motion={"moves": ["receivers"]})
    assert line.startswith("motion.moves = ['receivers']; cannot include receivers that are attached to the arms")
    assert error_line(motion={"moves": ["mirrors"]}).startswith("motion.moves = ['mirrors']; cannot include mirrors")


BEND = {"kind": "bend"}
DRAWN = {"kind": "outline", "file": "sensor.dxf"}


@pytest.mark.parametrize(
    ("tables", "start"),
    [
        ({"motion": BEND | {"pivot": "emitter"}}, "motion.pivot = 'emitter'; does not apply with motion.kind = "),
        ({"motion": BEND | {"join": "seam"}}, "motion.join = 'seam'; does not apply with motion.kind = "),
        ({"motion": {"moves": ["emitter"], "join": "seam"}}, "motion.join = 'seam'; does not apply unless the lens"),
        ({"motion": {"join": "seam"}, "body": DRAWN}, "motion.join = 'seam'; does not apply with body.kind"),
        ({"motion": BEND | {"moves": ["emitter"]}}, "motion.moves = ['emitter']; does not apply with motion.kind"),
        ({"motion": BEND | {"bend_mm": [0, 5]}}, "motion.bend_mm = (0.0, 5.0); does not apply with body.kind"),
        ({"motion": {"centre_line": [[0, 0], [0, 1], [1, 2]]}}, "motion.centre_line = ((0.0, 0.0), (0.0, 1.0)"),
        ({"motion": BEND | {"centre_line": [[0, 0], [0, 1]]}}, "motion.centre_line = [[0, 0], [0, 1]]; must be"),
        ({"motion": BEND, "body": DRAWN}, "motion.bend_mm; is missing: required for the bend of an outline"),
        (
            {"motion": BEND | {"bend_mm": [5, 0]}, "body": DRAWN},
            "motion.bend_mm = [5.0, 0.0]; must be in ascending order",
        ),
        ({"body": {"kind": "outline"}}, "body.file; is missing"),
        ({"body": {"file": "sensor.dxf"}}, "body.file = 'sensor.dxf'; does not apply with body.kind = "),
        ({"body": {"units": "mm"}}, "body.units = 'mm'; does not apply"),
        ({"body": DRAWN | {"arm_width_mm": 4.0}}, "body.arm_width_mm = 4.0; does not apply with body.kind = "),
        ({"body": DRAWN, "lens": {"shape": "none"}}, "lens.shape = 'none'; does not apply with body.kind"),
        ({"body": DRAWN, "emitter": {"distance_mm": 2.0}}, "emitter.distance_mm = 2.0; does not apply"),
        (
            {"trace": {"dimension": "plane"}},
            "trace.dimension = 'plane'; must be '2d' (in the plane) or 'extruded' (in space)",
        ),
        ({"trace": {"dimension": "extruded"}}, "trace.dimension = 'extruded'; requires light out of the plane"),
        ({"trace": {"dimension": "extruded"}, "emitter": {"part": "VSMY1850", "pattern": "fan"}}, "trace.dimension"),
        ({"emitter": {"axis_deg": 10.0}}, "emitter.axis_deg = 10.0; does not apply with body.kind"),
        ({"emitter": {"point_mm": [0.0]}}, "emitter.point_mm = [0.0]; must be [x_mm, z_mm]"),
    ],
)
def test_refuses_contradictory_keys(tables: dict[str, Any], start: str) -> None:
    line = error_line(**tables)
    assert line.startswith(start), line


@pytest.mark.parametrize(
    "emitter", [{"pattern": "lambertian"}, {"pattern": "uniform"}, {"part": "VSMY1850"}, {"ray_file": "led.sdf"}]
)
def test_light_out_of_the_plane_may_be_traced_in_space(emitter: dict[str, Any]) -> None:
    assert design(trace={"dimension": "extruded"}, emitter=emitter).trace.dimension == "extruded"


def test_only_the_emitter_of_an_outline_moves_by_default() -> None:
    assert design(body=DRAWN).motion.moves == ("emitter",)
    assert design(body=DRAWN, motion={"moves": ["lens", "mirrors"]}).motion.moves == ("lens", "mirrors")
    assert design(body=DRAWN, motion=BEND | {"bend_mm": [0, 5]}).motion.bend_mm == (0.0, 5.0)


@pytest.mark.parametrize(("start", "end"), [(3.0, -3.0), (1.0, 1.0)])
def test_the_first_angle_of_a_sweep_is_less_than_the_last(start: float, end: float) -> None:
    line = error_line(motion={"from_deg": start, "to_deg": end})
    assert line.startswith(f"motion.from_deg = {start}; must be less than motion.to_deg = {end}")


@pytest.mark.parametrize("step", [5.9e-5, 1e-9, 5e-324])
def test_a_sweep_has_at_most_a_hundred_thousand_steps(step: float) -> None:
    assert error_line(motion={"step_deg": step}).startswith(f"motion.step_deg = {step}; makes more than 100,000 steps")
    assert len(Motion(step_deg=6e-5).angles_deg()) == 100_001


def test_the_default_angles_are_exact() -> None:
    assert Motion().angles_deg() == tuple(i / 4 for i in range(-12, 13))


def test_angles_have_no_accumulated_error() -> None:
    assert Motion(from_deg=-0.3, to_deg=0.3, step_deg=0.1).angles_deg() == (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
    assert math.copysign(1, Motion(from_deg=-0.3, to_deg=0.3, step_deg=0.1).angles_deg()[3]) == 1


def test_a_rounded_step_still_reaches_zero_and_the_last_angle() -> None:
    angles = Motion(from_deg=-5.0, to_deg=5.0, step_deg=5 / 6).angles_deg()
    assert len(angles) == 13
    assert (angles[0], angles[6], angles[-1]) == (-5.0, 0.0, 5.0)


def test_a_sweep_ends_before_a_last_angle_that_no_step_reaches() -> None:
    assert Motion(from_deg=0, to_deg=1, step_deg=0.4).angles_deg() == (0.0, 0.4, 0.8)
    assert Motion(from_deg=0, to_deg=1, step_deg=3).angles_deg() == (0.0,)


@given(st.floats(-89, 0, allow_subnormal=False), st.floats(0.01, 89), st.integers(1, 300), st.floats(0, 0.9))
def test_angles_are_evenly_spaced_and_within_the_range(start: float, end: float, steps: int, part: float) -> None:
    step = (end - start) / (steps + part)
    angles = Motion(from_deg=start, to_deg=end, step_deg=step).angles_deg()
    assert len(angles) == steps + 1
    assert angles[0] == start or abs(start) <= 1e-9 * step
    assert angles[-1] <= end
    assert all(abs(angle - (start + i * step)) <= 2e-9 * step + 1e-13 for i, angle in enumerate(angles))


@pytest.mark.parametrize("resin", ["mine.toml", "resins/mine", "resins\\mine"])
def test_a_resin_given_by_a_path_is_a_file(resin: str, tmp_path: Any) -> None:
    by_file = design(material={"resin": resin}).in_folder(tmp_path)
    assert by_file.resin_file == tmp_path / resin
    assert by_file.material.resin == resin
    assert by_file != by_file.in_folder(tmp_path / "elsewhere")


def test_a_resin_given_by_a_name_is_in_the_library(tmp_path: Any) -> None:
    by_name = design(material={"resin": "pmma"})
    assert by_name.resin_file is None
    assert design().resin_file is None
    assert by_name == by_name.in_folder(tmp_path)
    assert by_name.in_folder(tmp_path).folder == tmp_path
    assert with_values(by_name.in_folder(tmp_path), {"name": "b"}).folder == tmp_path
