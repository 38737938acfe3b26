"""The tangent is the derivative of the forces at any strain, and rotations add no force."""

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
    """Unknowns of an uneven deformation with strains of about ``size``, with pressures."""
    x, z = MESH.points_mm.T
    displacements = size * np.column_stack([0.5 * x + 0.2 * z + 0.1 * x * z, 0.9 * x - 0.4 * z])
    pressures = np.full(elements.unknown_count - elements.displacement_count, 0.3 * size)
    return np.concatenate([displacements.ravel(), pressures])


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("size", [0.0, 1e-4, 0.4])
def test_tangent_is_the_derivative_of_the_forces(kind: str, plane: Plane, size: float) -> None:
    elements = Elements(MESH, Material(kind, MODELS[kind]), plane)
    at = strained(elements, size)
    direction = np.random.default_rng(1).normal(size=elements.unknown_count)
    change = (elements.forces(at + STEP * direction) - elements.forces(at - STEP * direction)) / (2.0 * STEP)
    tangent = elements.tangent(at)
    np.testing.assert_allclose(tangent @ direction, change, atol=2e-7 * np.abs(change).max())
    assert abs(tangent - tangent.T).max() < 1e-12


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_rotation_rotates_the_forces(plane: Plane) -> None:
    """Forces rotate with the body, and the rotation adds none."""
    elements = Elements(MESH, Material.neo_hookean(1.0), plane)
    at = strained(elements, 0.2)
    c, s = np.cos(0.7), np.sin(0.7)
    rotation = np.array([[c, -s], [s, c]])
    count = elements.displacement_count
    displaced = MESH.points_mm + at[:count].reshape(-1, 2)
    rotated_unknowns = np.concatenate([(displaced @ rotation.T - MESH.points_mm).ravel(), at[count:]])
    before, after = elements.forces(at)[:count].reshape(-1, 2), elements.forces(rotated_unknowns)[:count].reshape(-1, 2)
    np.testing.assert_allclose(after, before @ rotation.T, atol=1e-13)
    assert elements.inverted(rotated_unknowns).sum() == 0
    assert elements.inverted(-3.0 * strained(elements, 1.0)).any()
