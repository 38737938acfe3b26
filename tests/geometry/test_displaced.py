"""A displaced body: rigid motions stay exact, smooth ones are followed, corners stay closed, parts are carried."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import CartesianOval, Measure, Spline
from solen.errors import DesignError
from solen.geometry import Body, Touch, bend_of, displaced, y_body
from solen.geometry.displaced import DisplacedCurve
from solen.lens import lens_of
from solen.plane import Rigid
from solen.scene import sensor_scene
from solen.sensor import Sensor
from solen.spec import Design
from solen.trace import integrate

TURN = Rigid.about((0.3, 5.0), -2.0)
PLACES = np.linspace(0.0, 1.0, 33)
Field = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Moved:
    u: FloatArray
    displacement_mm: FloatArray


def design(**tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)


def rest(**tables: Any) -> Body:
    made = design(**tables)
    return y_body(made, lens_of(made, 1.44))


def moves(body: Body, field: Field) -> dict[str, Moved]:
    return {face.name: Moved(PLACES, field(face.curve.points(PLACES))) for face in body.all_faces}


def turned(at: FloatArray) -> FloatArray:
    return TURN.points(at) - at


def rippled(at: FloatArray) -> FloatArray:
    """A turn with a smooth ripple of 1e-8 mm, so that nothing is rigid."""
    return turned(at) + 1e-8 * np.column_stack([np.sin(at[:, 1] / 4.0), np.cos(at[:, 0] / 4.0)])


def test_a_rigid_motion_keeps_every_curve_what_it_is() -> None:
    body = rest(receivers={"coupling": "air-gap", "gap_mm": 0.5})
    found = displaced(body, moves(body, turned))
    assert isinstance(found.body.faces[0].curve, CartesianOval)
    for face, other in zip((*found.body.faces, *found.body.apart), (*body.faces, *body.apart), strict=True):
        there = TURN.points(other.curve.points(PLACES))
        assert np.abs(face.curve.points(PLACES) - there).max() < 1e-12
    assert found.body.emitter.axis_deg == pytest.approx(-2.0, abs=1e-12)
    assert found.body.emitter.point == pytest.approx(TURN.point(body.emitter.point), abs=1e-12)


def test_without_a_displacement_the_body_is_the_one_at_rest() -> None:
    body = rest()
    assert displaced(body, moves(body, np.zeros_like)).body == body


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
def test_a_turn_through_splines_gives_the_light_of_the_exact_turn(dimension: str) -> None:
    emitter = {"width_mm": 0.2, "offset_mm": 0.03} | ({"pattern": "lambertian"} if dimension == "extruded" else {})
    made = design(emitter=emitter, trace={"dimension": dimension})
    sensor = Sensor.of(made)
    body = sensor.body()
    found = displaced(body, moves(body, rippled)).body
    assert all(isinstance(face.curve, Spline) for face in found.faces)
    contrasts = []
    for one in (body, found):
        scene = sensor_scene(made, one, sensor.material)
        traced = integrate(scene, "power", 1e-5 if dimension == "2d" else 1e-4)
        right, left = (traced.detectors[name].power for name in ("right", "left"))
        contrasts.append((right - left) / (right + left))
    assert contrasts[0] < -0.2
    assert contrasts[1] == pytest.approx(contrasts[0], abs=1e-5 if dimension == "2d" else 2e-4)


def test_a_bend_as_a_displacement_is_the_bend() -> None:
    made = design(motion={"kind": "bend"})
    body, wanted = rest(), y_body(made, lens_of(made, 1.44), -3.0)
    base = body.marks["stem-base"][1]
    bend = bend_of(None, base, base + 16.2, -3.0)

    def field(at: FloatArray) -> FloatArray:
        goal = bend.section(base).points(at)
        inside = at[:, 1] > base
        goal[inside] = bend.places(at[inside])
        goal[at[:, 1] >= base + 16.2] = at[at[:, 1] >= base + 16.2]
        return np.asarray(goal - at)

    still = {
        name: Moved(PLACES, np.zeros((33, 2))) for name in moves(body, field) if not name.startswith(("lens", "stem"))
    }
    found = displaced(body, moves(body, field) | still)
    for face, other in zip(found.body.faces, wanted.faces, strict=True):
        assert np.abs(face.curve.points(PLACES) - other.curve.points(PLACES)).max() < 1e-6
    assert found.off_mm < 2e-6  # of the quadratics between the places; the spline is nearer to the bend
    assert found.carried.angle_deg == pytest.approx(-3.0, abs=1e-9)


def test_a_wall_of_several_cubics_keeps_its_corner() -> None:
    corner = Spline(((0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 2.0), (1.0, 3.0)))
    wall = DisplacedCurve(corner, Moved(PLACES, 1e-3 * np.sin(corner.points(PLACES))))
    goal = corner.points(PLACES) + 1e-3 * np.sin(corner.points(PLACES))
    (found,) = wall.between((goal[0, 0], goal[0, 1]), (goal[-1, 0], goal[-1, 1]), np.array([]))
    assert isinstance(found, Spline)
    ends = np.linalg.norm(found.points(np.linspace(0, 1, 4001))[:, None] - goal[None], axis=2).min(axis=0)
    assert ends.max() < 2e-3
    assert np.linalg.norm(np.subtract(found.controls[0][0], goal[0])) < 1e-12
    assert any(math.dist(control[3], (1.0 + 1e-3 * math.sin(1.0), 0.0)) < 1e-6 for control in found.controls)


@pytest.mark.parametrize("field", [turned, rippled])
def test_a_touched_stretch_is_a_face_of_its_own(field: Field) -> None:
    body = rest()
    touches = [Touch(side, 0.25, 0.4, 7) for side in ("stem-right", "stem-left")]
    found = displaced(body, moves(body, field), touches=touches).body
    for side in ("right", "left"):
        whole = body.face(f"stem-{side}").curve
        touched = found.face(f"stem-{side}.2")
        assert touched.wall == 7
        assert [found.face(f"stem-{side}.{i}").wall for i in (1, 3)] == [None, None]
        for end, u in ((touched.curve.start, 0.25), (touched.curve.end, 0.4)):
            assert end == pytest.approx(TURN.point(whole.point_at(u)), abs=1e-7)
    assert [face.name for face in found.faces if face.part == "stem"] == [
        *("stem-right.1", "stem-right.2", "stem-right.3"),
        *("stem-left.3", "stem-left.2", "stem-left.1"),
    ]


@pytest.mark.parametrize(("on", "still"), [("lens", False), ("ground", True), ("stem-*", False)])
def test_the_emitter_goes_with_what_carries_it(on: str, still: bool) -> None:
    body = rest()
    found = displaced(body, moves(body, turned), on)
    goal = body.emitter.point if still else TURN.point(body.emitter.point)
    assert found.body.emitter.point == pytest.approx(goal, abs=1e-12)


def test_a_face_that_does_not_exist_carries_nothing() -> None:
    body = rest()
    with pytest.raises(DesignError, match=r"motion\.emitter_on.*lense.*stem-right"):
        displaced(body, moves(body, turned), "lense")


def test_a_fold_is_refused_with_its_place() -> None:
    body = rest()
    with pytest.raises(DesignError, match="intersects itself"):
        displaced(body, moves(body, lambda at: np.column_stack([-2.0 * at[:, 0] * (at[:, 1] > 15), 0 * at[:, 1]])))


def test_a_lens_in_space_that_is_deformed_is_refused_with_its_size() -> None:
    made = design(lens={"shape": "line-focus"}, emitter={"pattern": "lambertian"}, trace={"dimension": "extruded"})
    body = Sensor.of(made).body()
    kept = displaced(body, moves(body, turned)).body.front
    assert kept is not None
    assert kept.motion.angle_deg == pytest.approx(-2.0)
    with pytest.raises(DesignError, match=r"lens\.shape.*deformed by 0\.00"):
        displaced(body, moves(body, lambda at: 0.002 * at**2))


def test_lengths_and_parameters_are_inverse() -> None:
    measure = Measure(rest().faces[1].curve)
    u = np.linspace(0.0, 1.0, 9)
    assert [measure.u_at(length) for length in measure.lengths_at(u)] == pytest.approx(u, abs=1e-12)


def squeezed(body: Body, size_mm: float, height_mm: float = 0.0) -> dict[str, Moved]:
    """Displacements that press the walls of the crotch together, most a height above its corner."""
    corner = body.marks["crotch"][1]
    fine = np.union1d(np.geomspace(1e-5, 0.5, 199), np.linspace(0.0, 1.0, 12))
    places = {"inner-left": fine, "inner-right": np.sort(1.0 - fine)}

    def field(at: FloatArray) -> FloatArray:
        near = np.exp(-(((at[:, 1] - corner - height_mm) / 0.1) ** 2))
        return np.column_stack([-size_mm * np.tanh(at[:, 0] / 0.01) * near, np.zeros(len(at))])

    def moved(u: FloatArray, name: str) -> Moved:
        return Moved(u, field(body.face(name).curve.points(u)))

    return {face.name: moved(places.get(face.name, PLACES), face.name) for face in body.all_faces}


def test_a_notch_that_closes_begins_where_its_walls_part() -> None:
    body = rest()
    found = displaced(body, squeezed(body, 0.02))
    (notch,) = found.closed
    right, left = (found.body.face(name).curve for name in ("inner-right", "inner-left"))
    assert right.end == left.start == notch.at_mm
    x, z = notch.at_mm
    (_, corner), (far_x, far_z) = body.marks["crotch"], left.end
    height, wide = z - corner, (z - corner) * far_x / (far_z - corner)
    assert x == pytest.approx(0.0, abs=1e-9)
    assert 0.02 * math.tanh(wide / 0.01) * math.exp(-((height / 0.1) ** 2)) == pytest.approx(wide, abs=1e-6)
    assert notch.length_mm == pytest.approx(height, rel=0.05)
    assert 0.001 < notch.overlap_mm < 0.01
    assert not displaced(body, squeezed(body, 0.008)).closed


@pytest.mark.parametrize("field", [(0.06, 0.0), (0.08, 0.4)])
def test_walls_that_lie_far_in_each_other_or_enclose_air_are_refused(field: tuple[float, float]) -> None:
    body = rest()
    with pytest.raises(DesignError, match=r"intersects itself.*inner-right and inner-left"):
        displaced(body, squeezed(body, *field))
