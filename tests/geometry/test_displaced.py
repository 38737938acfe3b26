"""A displaced body: exact rigid motions, smooth deformations, closed corners, and parts that move with their faces."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import ArcLength, CartesianOval, Spline
from solen.errors import DesignError
from solen.geometry import Body, ContactSegment, bend_of, displaced, y_body
from solen.geometry.displaced import DisplacedCurve
from solen.lens import lens_of
from solen.plane import Rigid
from solen.scene import sensor_scene
from solen.sensor import Sensor
from solen.spec import Design
from solen.trace import integrate

ROTATION = Rigid.about((0.3, 5.0), -2.0)
PARAMETERS = np.linspace(0.0, 1.0, 33)
Field = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Displacement:
    u: FloatArray
    displacement_mm: FloatArray


def design(**tables: Any) -> Design:
    return Design.model_validate({"name": "test", "material": {"index": 1.44}} | tables)


def body_at_rest(**tables: Any) -> Body:
    sensor_design = design(**tables)
    return y_body(sensor_design, lens_of(sensor_design, 1.44))


def displacements(body: Body, field: Field) -> dict[str, Displacement]:
    return {face.name: Displacement(PARAMETERS, field(face.curve.points(PARAMETERS))) for face in body.all_faces}


def rotation_field(at: FloatArray) -> FloatArray:
    return ROTATION.points(at) - at


def rippled_rotation_field(at: FloatArray) -> FloatArray:
    """Return a rotation with a smooth ripple of 1e-8 mm, which is not rigid."""
    return rotation_field(at) + 1e-8 * np.column_stack([np.sin(at[:, 1] / 4.0), np.cos(at[:, 0] / 4.0)])


def test_rigid_motion_preserves_kinds_of_curves() -> None:
    body = body_at_rest(receivers={"coupling": "air-gap", "gap_mm": 0.5})
    result = displaced(body, displacements(body, rotation_field))
    assert isinstance(result.body.faces[0].curve, CartesianOval)
    for face, face_at_rest in zip(
        (*result.body.faces, *result.body.separate), (*body.faces, *body.separate), strict=True
    ):
        rotated = ROTATION.points(face_at_rest.curve.points(PARAMETERS))
        assert np.abs(face.curve.points(PARAMETERS) - rotated).max() < 1e-12
    assert result.body.emitter.axis_deg == pytest.approx(-2.0, abs=1e-12)
    assert result.body.emitter.point == pytest.approx(ROTATION.point(body.emitter.point), abs=1e-12)


def test_zero_displacement_gives_body_at_rest() -> None:
    body = body_at_rest()
    assert displaced(body, displacements(body, np.zeros_like)).body == body


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
def test_spline_rotation_gives_light_of_exact_rotation(dimension: str) -> None:
    emitter = {"width_mm": 0.2, "offset_mm": 0.03} | ({"pattern": "lambertian"} if dimension == "extruded" else {})
    sensor_design = design(emitter=emitter, trace={"dimension": dimension})
    sensor = Sensor.of(sensor_design)
    body = sensor.body()
    moved_body = displaced(body, displacements(body, rippled_rotation_field)).body
    assert all(isinstance(face.curve, Spline) for face in moved_body.faces)
    contrasts = []
    for current in (body, moved_body):
        scene = sensor_scene(sensor_design, current, sensor.material)
        traced = integrate(scene, "power", 1e-5 if dimension == "2d" else 1e-4)
        right, left = (traced.detectors[name].power for name in ("right", "left"))
        contrasts.append((right - left) / (right + left))
    assert contrasts[0] < -0.2
    assert contrasts[1] == pytest.approx(contrasts[0], abs=1e-5 if dimension == "2d" else 2e-4)


def test_displacement_of_a_bend_gives_bent_body() -> None:
    sensor_design = design(motion={"kind": "bend"})
    body, expected = body_at_rest(), y_body(sensor_design, lens_of(sensor_design, 1.44), -3.0)
    base = body.marks["stem-base"][1]
    bend = bend_of(None, base, base + 16.2, -3.0)

    def field(at: FloatArray) -> FloatArray:
        target = bend.section_motion(base).points(at)
        inside = at[:, 1] > base
        target[inside] = bend.bent_points(at[inside])
        target[at[:, 1] >= base + 16.2] = at[at[:, 1] >= base + 16.2]
        return np.asarray(target - at)

    fixed = {
        name: Displacement(PARAMETERS, np.zeros((33, 2)))
        for name in displacements(body, field)
        if not name.startswith(("lens", "stem"))
    }
    result = displaced(body, displacements(body, field) | fixed)
    for face, bent_face in zip(result.body.faces, expected.faces, strict=True):
        assert np.abs(face.curve.points(PARAMETERS) - bent_face.curve.points(PARAMETERS)).max() < 1e-6
    assert result.deviation_mm < 2e-6  # from the quadratics between the nodes; the spline is closer to the bend
    assert result.emitter_motion.angle_deg == pytest.approx(-3.0, abs=1e-9)


def test_wall_of_several_cubics_keeps_corner() -> None:
    corner = Spline(((0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 2.0), (1.0, 3.0)))
    wall = DisplacedCurve(corner, Displacement(PARAMETERS, 1e-3 * np.sin(corner.points(PARAMETERS))))
    expected = corner.points(PARAMETERS) + 1e-3 * np.sin(corner.points(PARAMETERS))
    (result,) = wall.between((expected[0, 0], expected[0, 1]), (expected[-1, 0], expected[-1, 1]), np.array([]))
    assert isinstance(result, Spline)
    distances = np.linalg.norm(result.points(np.linspace(0, 1, 4001))[:, None] - expected[None], axis=2).min(axis=0)
    assert distances.max() < 2e-3
    assert np.linalg.norm(np.subtract(result.controls[0][0], expected[0])) < 1e-12
    assert any(math.dist(control[3], (1.0 + 1e-3 * math.sin(1.0), 0.0)) < 1e-6 for control in result.controls)


@pytest.mark.parametrize("field", [rotation_field, rippled_rotation_field])
def test_contact_segment_becomes_separate_face(field: Field) -> None:
    body = body_at_rest()
    contacts = [ContactSegment(side, 0.25, 0.4, 7) for side in ("stem-right", "stem-left")]
    result = displaced(body, displacements(body, field), contacts=contacts).body
    for side in ("right", "left"):
        curve_at_rest = body.face(f"stem-{side}").curve
        contact_face = result.face(f"stem-{side}.2")
        assert contact_face.wall == 7
        assert [result.face(f"stem-{side}.{i}").wall for i in (1, 3)] == [None, None]
        for end, u in ((contact_face.curve.start, 0.25), (contact_face.curve.end, 0.4)):
            assert end == pytest.approx(ROTATION.point(curve_at_rest.point_at(u)), abs=1e-7)
    assert [face.name for face in result.faces if face.part == "stem"] == [
        *("stem-right.1", "stem-right.2", "stem-right.3"),
        *("stem-left.3", "stem-left.2", "stem-left.1"),
    ]


@pytest.mark.parametrize(("on", "fixed"), [("lens", False), ("ground", True), ("stem-*", False)])
def test_emitter_moves_with_faces_it_is_mounted_on(on: str, fixed: bool) -> None:
    body = body_at_rest()
    result = displaced(body, displacements(body, rotation_field), on)
    expected = body.emitter.point if fixed else ROTATION.point(body.emitter.point)
    assert result.body.emitter.point == pytest.approx(expected, abs=1e-12)


def test_refuses_emitter_on_unknown_face() -> None:
    body = body_at_rest()
    with pytest.raises(DesignError, match=r"motion\.emitter_on.*lense.*stem-right"):
        displaced(body, displacements(body, rotation_field), "lense")


def test_refuses_displacement_that_folds_body() -> None:
    body = body_at_rest()
    with pytest.raises(DesignError, match="intersects itself"):
        displaced(
            body, displacements(body, lambda at: np.column_stack([-2.0 * at[:, 0] * (at[:, 1] > 15), 0 * at[:, 1]]))
        )


def test_refuses_deformed_lens_in_space() -> None:
    emitter, trace = {"pattern": "lambertian"}, {"dimension": "extruded"}
    body = Sensor.of(design(lens={"shape": "line-focus"}, emitter=emitter, trace=trace)).body()
    front = displaced(body, displacements(body, rotation_field)).body.front
    assert front is not None
    assert front.motion.angle_deg == pytest.approx(-2.0)
    with pytest.raises(DesignError, match=r"lens\.shape.*deformed by 0\.00"):
        displaced(body, displacements(body, lambda at: 0.002 * at**2))


def test_lengths_and_parameters_are_inverse() -> None:
    measure = ArcLength(body_at_rest().faces[1].curve)
    u = np.linspace(0.0, 1.0, 9)
    assert [measure.u_at(length) for length in measure.lengths_at(u)] == pytest.approx(u, abs=1e-12)


def squeezing(body: Body, size_mm: float, height_mm: float = 0.0) -> dict[str, Displacement]:
    """Return displacements that press the walls of the crotch together, most strongly at a height above its corner."""
    corner = body.marks["crotch"][1]
    fine = np.union1d(np.geomspace(1e-5, 0.5, 199), np.linspace(0.0, 1.0, 12))
    parameters = {"inner-left": fine, "inner-right": np.sort(1.0 - fine)}

    def field(at: FloatArray) -> FloatArray:
        weight = np.exp(-(((at[:, 1] - corner - height_mm) / 0.1) ** 2))
        return np.column_stack([-size_mm * np.tanh(at[:, 0] / 0.01) * weight, np.zeros(len(at))])

    def displacement(u: FloatArray, name: str) -> Displacement:
        return Displacement(u, field(body.face(name).curve.points(u)))

    return {face.name: displacement(parameters.get(face.name, PARAMETERS), face.name) for face in body.all_faces}


def test_closed_notch_begins_where_walls_separate() -> None:
    body = body_at_rest()
    result = displaced(body, squeezing(body, 0.02))
    (notch,) = result.closed_notches
    right, left = (result.body.face(name).curve for name in ("inner-right", "inner-left"))
    assert right.end == left.start == notch.at_mm
    x, z = notch.at_mm
    (_, corner), (far_x, far_z) = body.marks["crotch"], left.end
    height, half_width = z - corner, (z - corner) * far_x / (far_z - corner)
    assert x == pytest.approx(0.0, abs=1e-9)
    assert 0.02 * math.tanh(half_width / 0.01) * math.exp(-((height / 0.1) ** 2)) == pytest.approx(half_width, abs=1e-6)
    assert notch.length_mm == pytest.approx(height, rel=0.05)
    assert 0.001 < notch.overlap_mm < 0.01
    assert not displaced(body, squeezing(body, 0.008)).closed_notches


@pytest.mark.parametrize("field", [(0.06, 0.0), (0.08, 0.4)])
def test_refuses_large_overlap_and_enclosed_air(field: tuple[float, float]) -> None:
    body = body_at_rest()
    with pytest.raises(DesignError, match=r"intersects itself.*inner-right and inner-left"):
        displaced(body, squeezing(body, *field))
