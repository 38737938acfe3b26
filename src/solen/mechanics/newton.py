"""One step of Newton's method towards the equilibrium of a held and loaded body.

The unknowns are the displacements not fixed by the supports, the pressures, the forces of the fingers on the nodes in
contact, and the depths of fingers with a given force. Their equations are the balance of forces, the areas, the circles
of the fingers and their forces; given displacements are on the right-hand side.

Public names: `step` and `Factors`.
"""

from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.geometry.body import place_text
from solen.mechanics.elements import Elements
from solen.mechanics.fingers import Finger, Pairs, Touch, touch_of
from solen.mechanics.supports import Supports

MIN_SHARE = 1 / 64
"""Smallest fraction of a step that is tried."""
MAX_PUSH = 0.2
"""Largest step of a finger as a fraction of its radius; in a larger step, nodes could pass behind the finger."""


PIVOT = 0.01
"""Smallest pivot of the factors, relative to the largest; it suffices for these matrices and reduces fill-in."""


class DivergedError(Exception):
    """Raised if Newton's method does not reach a load from its starting point."""


class Problem(NamedTuple):
    """A held body and the fingers that may touch it."""

    elements: Elements
    supports: Supports
    fingers: tuple[Finger, ...]
    pairs: Pairs

    def displaced(self, unknowns: FloatArray) -> FloatArray:
        """Return positions (N, 2) of all nodes."""
        return self.supports.points_mm + unknowns[: self.elements.displacements].reshape(-1, 2)


class Demand(NamedTuple):
    """Displacements (N, 2) given to nodes, forces on all components and of fingers (0 for none), N/mm."""

    given: FloatArray
    pull: FloatArray
    push: FloatArray


class Guess(NamedTuple):
    """Unknowns of the elements, hinge angles, finger depths, and forces per mm on the contact pairs."""

    unknowns: FloatArray
    angles: FloatArray
    depth: FloatArray
    force: FloatArray


class Factors(NamedTuple):
    """A stiffness matrix, its projection onto the free displacements, and the factors of the projection."""

    matrix: Any
    projection: Any
    factors: Any


class Taken(NamedTuple):
    """A completed step: its result, the pairs in contact, the largest movement of nodes, and the matrix used."""

    guess: Guess
    active: BoolArray
    moved_mm: float
    kept: Factors


class _Border(NamedTuple):
    """Contact derivatives: of gaps by displacements, and of gaps and forces by finger depths."""

    gaps: Any  # (touching pairs, unknowns)
    sinks: FloatArray  # (touching pairs, fingers)
    turns: Any  # (unknowns, fingers)
    curves: FloatArray  # (fingers,)
    stiffness: Any  # (unknowns, unknowns)


def step(problem: Problem, guess: Guess, demand: Demand, kept: Factors | None) -> Taken:
    """Take one step, shortened if an element would turn inside out.

    Raises
    ------
    DivergedError
        If every fraction of the step turns an element inside out; the error gives the element's position.
    """
    elements, supports = problem.elements, problem.supports
    touch = touch_of(problem.fingers, problem.pairs, problem.displaced(guess.unknowns), guess.depth)
    active = touch.active(guess.force, elements.material.shear_modulus_MPa, demand.push > 0.0)
    force = np.where(active, guess.force, 0.0)
    residual = elements.forces(guess.unknowns)
    residual[: elements.displacements] -= demand.pull
    border = _border(problem, touch, active, force, demand.push > 0.0)
    if kept is None or problem.fingers:
        kept = _factors(problem, guess, residual, border, force)
    jump = np.zeros(elements.unknowns)
    held = (2 * supports.fixed[:, None] + np.arange(2)).ravel()
    jump[held] = demand.given.ravel()[held] - guess.unknowns[held]
    solved = _solved(problem, guess, kept, residual, jump, border, touch.gap_mm[active], demand.push)
    after = np.zeros_like(force)
    after[active] = solved.pushes
    return _shortened(problem, guess, jump, solved, after, Taken(guess, active, 0.0, kept))


class _Solved(NamedTuple):
    moves: FloatArray
    pressures: FloatArray
    pushes: FloatArray
    deeper: FloatArray


def _solved(
    problem: Problem,
    guess: Guess,
    kept: Factors,
    residual: FloatArray,
    jump: FloatArray,
    border: _Border,
    gap: FloatArray,
    push: FloatArray,
) -> _Solved:
    """Return the solution of the linear equations."""
    right = [-(_projection(problem, guess.angles).T @ (residual + kept.matrix @ jump))]
    right.append(-gap - border.gaps @ jump)
    right.append(push[push > 0.0] - border.turns.T @ jump)
    solution = kept.factors.solve(np.concatenate(right))
    pressures = problem.elements.unknowns - problem.elements.displacements
    moves = kept.projection.shape[1] - pressures
    ends = np.cumsum([moves, pressures, len(gap)])
    parts = np.split(solution, ends)
    deeper = np.zeros(len(push))
    deeper[push > 0.0] = parts[3]
    return _Solved(parts[0], parts[1], parts[2], deeper)


def _shortened(
    problem: Problem, guess: Guess, jump: FloatArray, solved: _Solved, force: FloatArray, taken: Taken
) -> Taken:
    """Return the step, halved until no element turns inside out."""
    count = problem.elements.displacements
    before = guess.unknowns[:count].reshape(-1, 2)
    radii = np.array([finger.press.radius_mm for finger in problem.fingers])
    share = float(np.min(MAX_PUSH * radii / np.maximum(np.abs(solved.deeper), 1e-300), initial=1.0))
    while True:
        jumped = before + share * jump[:count].reshape(-1, 2)
        moves, angles = problem.supports.moved(jumped, share * solved.moves, guess.angles)
        unknowns = np.concatenate([moves.ravel(), guess.unknowns[count:] + share * solved.pressures])
        if not np.isfinite(unknowns).all():
            raise DivergedError("its equations have no unique solution")
        bad = problem.elements.turned_inside_out(unknowns)
        if not bad.any():
            break
        share *= 0.5
        if share < MIN_SHARE:
            raise DivergedError(f"an element turns inside out at {_place(problem, bad)}")
    moved = float(np.abs(moves - before).max()) / share
    depth = guess.depth + share * solved.deeper
    reached = Guess(unknowns, angles, depth, guess.force + share * (force - guess.force))
    return taken._replace(guess=reached, moved_mm=moved)


def _place(problem: Problem, bad: BoolArray) -> str:
    nodes = problem.elements.nodes[int(np.flatnonzero(bad)[0])]
    x, z = problem.supports.points_mm[nodes].mean(axis=0)
    return place_text((float(x), float(z)))


def _projection(problem: Problem, angles: FloatArray) -> Any:
    """Return the matrix from free to all unknowns: T of the supports, and the pressures."""
    from scipy.sparse import block_diag, csc_array, eye_array

    pressures = problem.elements.unknowns - problem.elements.displacements
    matrix = problem.supports.matrix(angles)
    return csc_array(block_diag([matrix, eye_array(pressures)])) if pressures else matrix


def _factors(problem: Problem, guess: Guess, residual: FloatArray, border: _Border, force: FloatArray) -> Factors:
    """Return the factors of the matrix at a guess, bordered by the contact equations."""
    from scipy.sparse import block_array, csc_array, diags_array
    from scipy.sparse.linalg import splu

    matrix = problem.elements.tangent(guess.unknowns) + border.stiffness
    projection = _projection(problem, guess.angles)
    inner = projection.T @ matrix @ projection
    if problem.supports.hinges:
        exerted = residual - border.gaps.T @ force[force > 0.0] if force.any() else residual
        bent = problem.supports.hinge_stiffness(guess.angles, exerted[: problem.elements.displacements])
        first = problem.supports.matrix(guess.angles).shape[1] - len(bent)
        diagonal = np.zeros(inner.shape[0])
        diagonal[first : first + len(bent)] = bent
        inner = inner + diags_array(diagonal)
    if border.gaps.shape[0] or border.curves.size:
        gaps, turns = border.gaps @ projection, projection.T @ border.turns
        inner = block_array(
            [
                [inner, -gaps.T, turns],
                [gaps, None, -csc_array(border.sinks)],
                [turns.T, csc_array(border.sinks.T), -diags_array(border.curves)],
            ]
        )
    try:
        return Factors(matrix, projection, splu(csc_array(inner), diag_pivot_thresh=PIVOT))
    except RuntimeError:  # the matrix is singular
        raise DivergedError("its equations have no unique solution") from None


def _border(problem: Problem, touch: Touch, active: BoolArray, force: FloatArray, forced: BoolArray) -> _Border:
    from scipy.sparse import csc_array

    unknowns = problem.elements.unknowns
    nodes, finger = problem.pairs.node[active], problem.pairs.finger[active]
    normal, pushed = touch.normal[active], force[active] / touch.distance_mm[active]
    ways = np.array([finger.way for finger in problem.fingers]).reshape(-1, 2)[finger]
    rows = np.repeat(np.arange(len(nodes)), 2)
    columns = (2 * nodes[:, None] + np.arange(2)).ravel()
    gaps = csc_array((normal.ravel(), (rows, columns)), shape=(len(nodes), unknowns))
    across = np.eye(2) - normal[:, :, None] * normal[:, None, :]
    blocks = -pushed[:, None, None] * across
    first, second = np.repeat(columns.reshape(-1, 2), 2, axis=1), np.tile(columns.reshape(-1, 2), 2)
    stiffness = csc_array((blocks.ravel(), (first.ravel(), second.ravel())), shape=(unknowns, unknowns))
    which = np.cumsum(forced) - 1
    own = forced[finger] if len(finger) else np.zeros(0, dtype=bool)
    count = int(forced.sum())
    sinks, curves = np.zeros((len(nodes), count)), np.zeros(count)
    slid = np.einsum("n,nij,nj->ni", pushed, across, ways)
    sinks[np.flatnonzero(own), which[finger[own]]] = np.sum(normal * ways, axis=1)[own]
    np.add.at(curves, which[finger[own]], np.sum(ways * slid, axis=1)[own])
    places = (columns.reshape(-1, 2)[own].ravel(), np.repeat(which[finger[own]], 2))
    turns = csc_array((slid[own].ravel(), places), shape=(unknowns, count))
    return _Border(gaps, sinks, turns, curves, stiffness)
