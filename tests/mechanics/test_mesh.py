"""The mesh follows the exact outline and fills it without slivers; invalid sizes are refused."""

import math

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.geometry import Body, Face, Pose
from solen.mechanics.elements import Elements
from solen.mechanics.material import Material
from solen.mechanics.mesh import BodyMesh, MeshOptions, mesh_of
from solen.sensor import Sensor
from solen.spec import loads
from tests.mechanics.bodies import block, polygon

Y = 'schema = 1\nname = "y"\n[material]\nindex = 1.44\n'
RUBBER = Material.neo_hookean(1.0)


def filled_mm2(mesh: BodyMesh) -> float:
    return float(Elements(mesh, RUBBER, "strain").weights.sum())


def rounded() -> Body:
    """A plate of 4 mm by 2 mm with fillets of 0.3 mm and a round hole."""
    r, w, h = 0.3, 4.0, 2.0
    faces = (
        Face("bottom", Segment((r, 0.0), (w - r, 0.0))),
        Face("fillet.1", Arc((w - r, r), r, -90.0, 90.0)),
        Face("right", Segment((w, r), (w, h - r))),
        Face("fillet.2", Arc((w - r, h - r), r, 0.0, 90.0)),
        Face("top", Segment((w - r, h), (r, h))),
        Face("fillet.3", Arc((r, h - r), r, 90.0, 90.0)),
        Face("left", Segment((0.0, h - r), (0.0, r))),
        Face("fillet.4", Arc((r, r), r, 180.0, 90.0)),
    )
    hole = tuple(Face(f"hole.{k + 1}", Arc((2.0, 1.0), 0.5, 180.0 - 180.0 * k, -180.0)) for k in range(2))
    return Body(faces, Pose((0.0, -9.0), 0.0), {}, others=(hole,)).check()


@pytest.mark.parametrize("body", [rounded(), Sensor.of(loads(Y)).body()], ids=["plate", "Y"])
def test_elements_fill_the_exact_area_and_follow_the_exact_curves(body: Body) -> None:
    mesh = mesh_of(body, MeshOptions(), {body.faces[0].name: [0.3]})
    assert filled_mm2(mesh) == pytest.approx(body.area_mm2(), rel=2e-6)
    for face in body.all_faces:
        edges = mesh.faces[face.name]
        np.testing.assert_allclose(mesh.points_mm[edges.nodes], face.curve.points(edges.u), atol=1e-12)
        steps = np.hypot(*np.diff(mesh.points_mm[edges.nodes], axis=0).T)
        np.testing.assert_allclose(steps[::2], steps[1::2], rtol=1e-6, atol=1e-9)  # midpoints halve the edges
    assert np.isclose(mesh.faces[body.faces[0].name].u, 0.3, atol=1e-12).any()
    assert worst_quality(mesh) > 0.3


def test_area_error_falls_with_element_size() -> None:
    halves = tuple(Face(f"half.{k + 1}", Arc((0.0, 0.0), 4.0, 180.0 * k, 180.0)) for k in range(2))
    disc = Body(halves, Pose((0.0, -9.0), 0.0), {}).check()
    errors = [abs(filled_mm2(mesh_of(disc, MeshOptions(size), {})) - 16.0 * math.pi) for size in (1.4, 0.7)]
    assert errors[1] < errors[0] / 8


def test_elements_are_smaller_at_requested_positions() -> None:
    mesh = mesh_of(block(4.0, 4.0), MeshOptions(1.0, ((2.0, 2.0, 0.1),)), {})
    centres = mesh.points_mm[mesh.mesh.t.T].mean(axis=1)
    sizes = np.sqrt(Elements(mesh, RUBBER, "strain").weights.sum(axis=1))
    distance = np.hypot(*(centres - 2.0).T)
    assert sizes[distance < 0.2].max() < 0.15 < 0.4 < sizes[distance > 1.5].max()


def test_slit_narrower_than_the_elements_stays_open() -> None:
    """The mesh leaves out a slit of 40 µm, much narrower than its elements."""
    narrow, length = 0.02, 3.0
    faces = {"a": (0.0, 0.0), "b": (4.0, 0.0), "c": (4.0, 4.0), "d": (2.0 + narrow, 4.0), "e": (2.0, 4.0 - length)}
    body = polygon({**faces, "f": (2.0 - narrow, 4.0), "g": (0.0, 4.0)})
    assert filled_mm2(mesh_of(body, MeshOptions(0.7), {})) == pytest.approx(16.0 - narrow * length, rel=1e-12)


@pytest.mark.parametrize("size", [1e-4, -1.0, math.inf])
def test_refuses_invalid_element_sizes(size: float) -> None:
    with pytest.raises(DesignError, match=r"mechanics\.mesh_mm"):
        mesh_of(block(4.0, 4.0), MeshOptions(size), {})


def test_error_gives_no_value_for_a_size_that_is_not_set() -> None:
    with pytest.raises(DesignError, match=r"mechanics\.mesh_mm; elements of 1e-06 to") as caught:
        mesh_of(block(4.0, 4.0), MeshOptions(finer=((0.0, 0.0, 1e-6),)), {})
    assert caught.value.value is None


def worst_quality(mesh: BodyMesh) -> float:
    """Smallest quality of a triangle: 1 if it is equilateral, 0 if it is degenerate."""
    a, b, c = mesh.points_mm[mesh.mesh.t]
    (ux, uz), (vx, vz) = (b - a).T, (c - a).T
    squares = sum(np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a)))
    return float((2.0 * math.sqrt(3.0) * np.abs(ux * vz - uz * vx) / squares).min())
