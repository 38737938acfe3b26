"""Forces of the elements are derivatives of their energy, their tangent those of the forces, at any strain."""

import numpy as np
import pytest

from solen.mechanics.elements import Elements
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import MeshOptions, mesh_of
from tests.mechanics.bodies import block
from tests.mechanics.test_soft import MODELS

MESH = mesh_of(block(2.0, 1.0), MeshOptions(0.7), {})
STEP = 1e-6


def strained(elements: Elements, size: float) -> np.ndarray:
    """Unknowns of an uneven deformation by about ``size``, with pressures."""
    x, z = MESH.points_mm.T
    moves = size * np.column_stack([0.5 * x + 0.2 * z + 0.1 * x * z, 0.9 * x - 0.4 * z])
    return np.concatenate([moves.ravel(), np.full(elements.unknowns - elements.displacements, 0.3 * size)])


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("size", [0.0, 1e-4, 0.4])
def test_the_tangent_is_the_derivative_of_the_forces(kind: str, plane: Plane, size: float) -> None:
    elements = Elements(MESH, Material(kind, MODELS[kind]), plane)
    at = strained(elements, size)
    way = np.random.default_rng(1).normal(size=elements.unknowns)
    change = (elements.forces(at + STEP * way) - elements.forces(at - STEP * way)) / (2.0 * STEP)
    tangent = elements.tangent(at)
    np.testing.assert_allclose(tangent @ way, change, atol=2e-7 * np.abs(change).max())
    assert abs(tangent - tangent.T).max() < 1e-12


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_a_turned_body_bears_no_more_than_before(plane: Plane) -> None:
    """Forces turn with the body, and none come with the turn."""
    elements = Elements(MESH, Material.neo_hookean(1.0), plane)
    at = strained(elements, 0.2)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    count = elements.displacements
    there = MESH.points_mm + at[:count].reshape(-1, 2)
    turned = np.concatenate([(there @ turn.T - MESH.points_mm).ravel(), at[count:]])
    before, after = elements.forces(at)[:count].reshape(-1, 2), elements.forces(turned)[:count].reshape(-1, 2)
    np.testing.assert_allclose(after, before @ turn.T, atol=1e-13)
    assert elements.turned_inside_out(turned).sum() == 0
    assert elements.turned_inside_out(-3.0 * strained(elements, 1.0)).any()
