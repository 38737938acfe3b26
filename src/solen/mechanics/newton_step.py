"""One step of Newton's method towards the equilibrium of a supported and loaded body.

The unknowns are the displacements that the supports leave free, the pressures, the forces of the fingers on the nodes
in contact, and the depths of fingers whose force is prescribed. The equations state, in this order, that the nodal
forces balance, that the area ratios match the pressures, that the nodes in contact lie on the circles of their fingers,
and that the nodal forces of a finger add up to its prescribed force. Prescribed displacements enter on the right-hand
side.

Public names: `step`, `Problem`, `Prescribed`, `Guess`, `Factors`, `StepResult` and `DivergedError`.
"""

from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.geometry.body import point_text
from solen.mechanics.elements import Elements
from solen.mechanics.fingers import Finger, Pairs, Touch, touch_of
from solen.mechanics.supports import Supports

MIN_FRACTION = 1 / 64
"""Smallest fraction of a step that is tried."""
MAX_PUSH = 0.2
"""Largest step of a finger as a fraction of its radius; in a larger step, nodes could pass behind the finger."""


PIVOT = 0.01
"""Smallest pivot of the factorisation, relative to the largest; small enough to limit fill-in."""


class DivergedError(Exception):
    """Raised if Newton's method does not reach a load from its starting point."""


class Problem(NamedTuple):
    """A supported body and the fingers that may touch it."""

    elements: Elements
    supports: Supports
    fingers: tuple[Finger, ...]
    pairs: Pairs

    def displaced(self, unknowns: FloatArray) -> FloatArray:
        """Return the displaced positions (N, 2) of all nodes."""
        return self.supports.points_mm + unknowns[: self.elements.displacement_count].reshape(-1, 2)


class Prescribed(NamedTuple):
    """Prescribed displacements, and prescribed forces in N per mm of thickness.

    ``displacements`` (N, 2) apply only to the fixed nodes. ``nodal_forces`` has an entry for each displacement degree
    of freedom, ``finger_forces`` an entry for each finger, which is 0 if the depth of the finger is prescribed.
    """

    displacements: FloatArray
    nodal_forces: FloatArray
    finger_forces: FloatArray


class Guess(NamedTuple):
    """Displacements and pressures, hinge angles in rad, finger depths in mm, and contact-pair forces (M,) in N/mm."""

    unknowns: FloatArray
    angles: FloatArray
    depth: FloatArray
    force: FloatArray


class Factors(NamedTuple):
    """A stiffness matrix, its projection onto the free displacements, and the LU factors of the bordered projection."""

    matrix: Any
    projection: Any
    lu: Any


class StepResult(NamedTuple):
    """The guess after a step, the pairs in contact, the largest movement of a node in a full step, and the factors."""

    guess: Guess
    active: BoolArray
    moved_mm: float
    factors: Factors


class _Border(NamedTuple):
    """Derivatives that the contact adds to the tangent: with respect to displacements, and to finger depths."""

    gap_gradients: Any  # (pairs in contact, unknowns)
    closing: FloatArray  # (pairs in contact, fingers): decrease of the gap per depth
    residual_rates: Any  # (unknowns, fingers)
    force_rates: FloatArray  # (fingers,): decrease of the finger's force per depth
    stiffness: Any  # (unknowns, unknowns)


class _Change(NamedTuple):
    """Changes of free displacements and hinge angles, of pressures and depths, and the new forces of the pairs."""

    displacements: FloatArray
    pressures: FloatArray
    force: FloatArray
    depth: FloatArray


def step(problem: Problem, guess: Guess, prescribed: Prescribed, factors: Factors | None) -> StepResult:
    """Take one step, shortened if it would invert an element.

    Raises
    ------
    DivergedError
        If every fraction of the step inverts an element; the error gives the element's position.
    """
    elements = problem.elements
    forced = prescribed.finger_forces > 0.0
    touch = touch_of(problem.fingers, problem.pairs, problem.displaced(guess.unknowns), guess.depth)
    active = touch.active(guess.force, elements.material.shear_modulus_MPa, forced)
    force = np.where(active, guess.force, 0.0)
    residual = elements.forces(guess.unknowns)
    residual[: elements.displacement_count] -= prescribed.nodal_forces
    border = _border(problem, touch, active, force, forced)
    if factors is None or problem.fingers:
        factors = _factorise(problem, guess, residual, border, force)
    jump = _jump(problem, guess, prescribed)
    right = [
        -(_projection(problem, guess.angles).T @ (residual + factors.matrix @ jump)),
        -touch.gap_mm[active] - border.gap_gradients @ jump,
        prescribed.finger_forces[forced] - border.residual_rates.T @ jump,
    ]
    change = _change(problem, factors, factors.lu.solve(np.concatenate(right)), active, forced)
    reached, moved_mm = _shortened(problem, guess, jump, change)
    return StepResult(reached, active, moved_mm, factors)


def _jump(problem: Problem, guess: Guess, prescribed: Prescribed) -> FloatArray:
    """Return the change of all unknowns that moves the fixed nodes to their prescribed positions."""
    jump = np.zeros(problem.elements.unknown_count)
    fixed = (2 * problem.supports.fixed[:, None] + np.arange(2)).ravel()
    jump[fixed] = prescribed.displacements.ravel()[fixed] - guess.unknowns[fixed]
    return jump


def _change(problem: Problem, factors: Factors, solution: FloatArray, active: BoolArray, forced: BoolArray) -> _Change:
    """Split the solution of the linear equations into its parts."""
    pressures = problem.elements.unknown_count - problem.elements.displacement_count
    displacements = factors.projection.shape[1] - pressures
    parts = np.split(solution, np.cumsum([displacements, pressures, active.sum()]))
    force, depth = np.zeros(len(active)), np.zeros(len(forced))
    force[active], depth[forced] = parts[2], parts[3]
    return _Change(parts[0], parts[1], force, depth)


def _shortened(problem: Problem, guess: Guess, jump: FloatArray, change: _Change) -> tuple[Guess, float]:
    """Halve a step until it inverts no element; return the guess after it, and the largest movement in a full step."""
    count = problem.elements.displacement_count
    before = guess.unknowns[:count].reshape(-1, 2)
    radii = np.array([finger.press.radius_mm for finger in problem.fingers])
    fraction = float(np.min(MAX_PUSH * radii / np.maximum(np.abs(change.depth), 1e-300), initial=1.0))
    while True:
        jumped = before + fraction * jump[:count].reshape(-1, 2)
        after, angles = problem.supports.moved(jumped, fraction * change.displacements, guess.angles)
        unknowns = np.concatenate([after.ravel(), guess.unknowns[count:] + fraction * change.pressures])
        if not np.isfinite(unknowns).all():
            raise DivergedError("its equations have no unique solution")
        inverted = problem.elements.inverted(unknowns)
        if not inverted.any():
            break
        fraction *= 0.5
        if fraction < MIN_FRACTION:
            raise DivergedError(f"an element is inverted at {_centre_text(problem, inverted)}")
    depth = guess.depth + fraction * change.depth
    force = guess.force + fraction * (change.force - guess.force)
    return Guess(unknowns, angles, depth, force), float(np.abs(after - before).max()) / fraction


def _centre_text(problem: Problem, inverted: BoolArray) -> str:
    nodes = problem.elements.nodes[int(np.flatnonzero(inverted)[0])]
    x, z = problem.supports.points_mm[nodes].mean(axis=0)
    return point_text((float(x), float(z)))


def _projection(problem: Problem, angles: FloatArray) -> Any:
    """Return the matrix from free displacements and pressures to all unknowns: T of the supports, and the identity."""
    from scipy.sparse import block_diag, csc_array, eye_array

    pressures = problem.elements.unknown_count - problem.elements.displacement_count
    matrix = problem.supports.matrix(angles)
    return csc_array(block_diag([matrix, eye_array(pressures)])) if pressures else matrix


def _factorise(problem: Problem, guess: Guess, residual: FloatArray, border: _Border, force: FloatArray) -> Factors:
    """Return the factors of the matrix at a guess, bordered by the contact equations."""
    from scipy.sparse import block_array, csc_array, diags_array
    from scipy.sparse.linalg import splu

    matrix = problem.elements.tangent(guess.unknowns) + border.stiffness
    projection = _projection(problem, guess.angles)
    inner = projection.T @ matrix @ projection
    if problem.supports.hinges:
        exerted = residual - border.gap_gradients.T @ force[force > 0.0] if force.any() else residual
        stiffness = problem.supports.hinge_stiffness(guess.angles, exerted[: problem.elements.displacement_count])
        first = problem.supports.matrix(guess.angles).shape[1] - len(stiffness)
        diagonal = np.zeros(inner.shape[0])
        diagonal[first : first + len(stiffness)] = stiffness
        inner = inner + diags_array(diagonal)
    if border.gap_gradients.shape[0] or border.force_rates.size:
        gaps, rates = border.gap_gradients @ projection, projection.T @ border.residual_rates
        inner = block_array(
            [
                [inner, -gaps.T, rates],
                [gaps, None, -csc_array(border.closing)],
                [rates.T, csc_array(border.closing.T), -diags_array(border.force_rates)],
            ]
        )
    try:
        return Factors(matrix, projection, splu(csc_array(inner), diag_pivot_thresh=PIVOT))
    except RuntimeError:  # the matrix is singular
        raise DivergedError("its equations have no unique solution") from None


def _border(problem: Problem, touch: Touch, active: BoolArray, force: FloatArray, forced: BoolArray) -> _Border:
    from scipy.sparse import csc_array

    unknowns = problem.elements.unknown_count
    nodes, finger = problem.pairs.node[active], problem.pairs.finger[active]
    normal, curvature = touch.normal[active], force[active] / touch.distance_mm[active]
    directions = np.array([finger.direction for finger in problem.fingers]).reshape(-1, 2)[finger]
    components = 2 * nodes[:, None] + np.arange(2)
    pairs = np.repeat(np.arange(len(nodes)), 2)
    gaps = csc_array((normal.ravel(), (pairs, components.ravel())), shape=(len(nodes), unknowns))
    tangential = np.eye(2) - normal[:, :, None] * normal[:, None, :]
    blocks = -curvature[:, None, None] * tangential
    rows, columns = np.repeat(components, 2, axis=1), np.tile(components, 2)
    stiffness = csc_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(unknowns, unknowns))
    own = forced[finger] if len(finger) else np.zeros(0, dtype=bool)
    column = (np.cumsum(forced) - 1)[finger[own]]
    count = int(forced.sum())
    closing, force_rates = np.zeros((len(nodes), count)), np.zeros(count)
    slide = np.einsum("n,nij,nj->ni", curvature, tangential, directions)
    closing[np.flatnonzero(own), column] = np.sum(normal * directions, axis=1)[own]
    np.add.at(force_rates, column, np.sum(directions * slide, axis=1)[own])
    rates = (slide[own].ravel(), (components[own].ravel(), np.repeat(column, 2)))
    return _Border(gaps, closing, csc_array(rates, shape=(unknowns, count)), force_rates, stiffness)
