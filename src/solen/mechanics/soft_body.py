"""A soft body and its successive states under load, computed by Newton's method at finite strain.

The tangent matrix is factorised at rest and reused as long as the steps converge fast: the first step is the
small-strain solution, and the following steps remove its error (docs/decisions/0090). If a finger can touch the body,
the matrix is recomputed at every step. If a load is too far from the previous state, the step to it is halved.

Public name: `SoftBody`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DesignError
from solen.extras import need
from solen.geometry import Body
from solen.mechanics.deformed import Deformed
from solen.mechanics.elements import Elements
from solen.mechanics.fingers import contact_sizes, finger_of, pairs_of
from solen.mechanics.load import Hold, Load, Press, Pull, Turn
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import BodyMesh, MeshOptions, mesh_of
from solen.mechanics.newton_step import MAX_PUSH, DivergedError, Factors, Guess, Prescribed, Problem, step
from solen.mechanics.outcome import Outcome
from solen.mechanics.stretches import cuts_of, nodal_lengths, nodes_on
from solen.mechanics.supports import supports_of

TOLERANCE_MM = 1e-8
"""Largest error of the computed displacements."""
MAX_STEPS = 25
MAX_RATE = 0.3
"""Largest ratio of the errors after and before a step at which the matrix is reused."""
MAX_HALVINGS = 5
MAX_TURN_DEG = 12.0
"""Largest rotation of a clamp in one step."""
EXTRAPOLATED = 4
"""Number of states from which the next one is extrapolated."""


@dataclass(frozen=True)
class SoftBody:
    """A body of soft material with its supports, to which loads can be applied.

    Attributes
    ----------
    body
        The body at rest.
    material
        Material of the entire body.
    holds
        Stationary supports.
    thickness_mm
        Thickness along y; forces are for the entire thickness.
    plane
        Plane strain or plane stress.
    mesh
        Mesh density.
    """

    body: Body
    material: Material
    holds: tuple[Hold, ...]
    thickness_mm: float
    plane: Plane = "strain"
    mesh: MeshOptions = field(default_factory=MeshOptions)

    def __post_init__(self) -> None:
        need("skfem", what="motion", value="loaded", doing="a soft body", error=DesignError)
        if not self.thickness_mm > 0.0:
            raise DesignError("body.thickness_mm", value=self.thickness_mm, limit="must be above 0")
        if self.plane == "stress" and self.material.poisson != 0.5:
            limit = "must be 0.5 (incompressible) in plane stress"
            raise DesignError("mechanics.poisson", value=self.material.poisson, limit=limit)

    def state(self, loads: Sequence[Load]) -> Deformed:
        """Return the body under the given loads, starting from rest; raise the errors of `states`."""
        return self.states([loads])[0]

    def states(self, loads: Sequence[Sequence[Load]]) -> list[Deformed]:
        """Return the body in each of several states, in the order in which it passes through them.

        Parameters
        ----------
        loads
            Loads of each state, which differ only by their angles, depths and forces.

        Raises
        ------
        DesignError
            If the body is not sufficiently supported, a stretch is not on its outline, a finger would pass through it,
            or it cannot bear a load; the error gives the position.
        """
        if not loads:
            return []
        path = Path.of(self, loads)
        return [path.outcome(self.body, load).deformed() for load in loads]


def _without_amounts(loads: Sequence[Load]) -> tuple[Load, ...]:
    return tuple(_with(load, iter((0.0, 0.0))) for load in loads)


def _with(load: Load, amounts: Iterator[float]) -> Load:
    if isinstance(load, Turn):
        return replace(load, angle_deg=next(amounts))
    if isinstance(load, Pull):
        return replace(load, force_N=(next(amounts), next(amounts)))
    if load.force_N is not None:
        return replace(load, force_N=next(amounts))
    return replace(load, depth_mm=next(amounts))


def _names(loads: Sequence[Load]) -> tuple[str, ...]:
    """Return the names of the load amounts, in the order of `_values`."""
    names: list[str] = []
    for load in loads:
        if isinstance(load, Turn):
            names.append(f"{load.name}.angle_deg")
        elif isinstance(load, Pull):
            names += [f"{load.name}.force_N (x)", f"{load.name}.force_N (z)"]
        else:
            names.append(f"{load.name}.{'depth_mm' if load.force_N is None else 'force_N'}")
    return tuple(names)


def _values(loads: Sequence[Load]) -> FloatArray:
    """Return the load amounts in degrees, mm or N: two for a pull, one for any other load."""
    values: list[float] = []
    for load in loads:
        if isinstance(load, Turn):
            values.append(load.angle_deg)
        elif isinstance(load, Pull):
            values += load.force_N
        else:
            values.append(load.force_N if load.force_N is not None else load.depth_mm or 0.0)
        if not np.isfinite(values).all():
            raise DesignError(load.name, value=values[-1], limit="must be finite")
    return np.array(values)


class State(NamedTuple):
    """Load amounts, and the equilibrium under them."""

    values: FloatArray
    guess: Guess


@dataclass(eq=False)
class Path:
    """States that a body has passed through, starting from rest.

    Attributes
    ----------
    problem
        The supported body.
    names, kinds
        Name of each load amount, and the type of its load.
    by_force
        Mask of fingers with a prescribed force.
    unit_pulls
        Nodal forces (2 P, displacement degrees of freedom) of P pulls, per mm of thickness: for each pull, a row for
        1 N along x and a row for 1 N along z.
    thickness_mm
        Thickness of the body.
    passed
        The states, rest first.
    """

    problem: Problem
    names: tuple[str, ...]
    kinds: tuple[type, ...]
    by_force: BoolArray
    unit_pulls: FloatArray
    thickness_mm: float
    passed: list[State]
    _factors: Factors | None = None

    @classmethod
    def of(cls, soft: SoftBody, states: Sequence[Sequence[Load]]) -> "Path":
        """Start a path at rest, with a mesh that resolves the contacts of its loads."""
        loads = states[0]
        if any(_without_amounts(state) != _without_amounts(loads) for state in states):
            raise DesignError("loads", limit="states may differ only in their angles, depths and forces")
        problem = _problem(soft, states)
        rest = Guess(
            np.zeros(problem.elements.unknown_count),
            np.zeros(len(problem.supports.hinges)),
            np.zeros(len(problem.fingers)),
            np.zeros(len(problem.pairs.node)),
        )
        pulls = [_unit_pulls(soft.body, problem.elements.mesh, load) for load in loads if isinstance(load, Pull)]
        unit_pulls = np.vstack([*pulls, np.zeros((0, problem.elements.displacement_count))]) / soft.thickness_mm
        kinds = [kind for load in loads for kind in ((Pull, Pull) if isinstance(load, Pull) else (type(load),))]
        by_force = np.array([finger.by_force for finger in problem.fingers], dtype=bool)
        first = State(np.zeros(len(kinds)), rest)
        return cls(problem, _names(loads), tuple(kinds), by_force, unit_pulls, soft.thickness_mm, [first])

    def outcome(self, body: Body, loads: Sequence[Load]) -> Outcome:
        """Return the equilibrium under the given loads, starting from the last state."""
        guess = self.reach(_values(loads))
        units = self.thickness_mm * self.unit_pulls.reshape(-1, 2, *self.problem.supports.points_mm.shape)
        pulls = [load for load in loads if isinstance(load, Pull)]
        forces = {load.name: np.tensordot(load.force_N, unit, 1) for load, unit in zip(pulls, units, strict=True)}
        return Outcome(body, self.problem, guess, forces, self.thickness_mm)

    def reach(self, values: FloatArray) -> Guess:
        """Return the equilibrium at the given load amounts, starting from the last state."""
        state = self._state_at(self.passed[-1], values, MAX_HALVINGS)
        self.passed.append(state)
        supported = self._supported_points(state.guess)
        for k, finger in enumerate(self.problem.fingers):
            push = float(state.guess.force[self.problem.pairs.finger == k].sum())
            finger.check(float(state.guess.depth[k]), push, supported)
        return state.guess

    def _supported_points(self, guess: Guess) -> FloatArray:
        """Return the positions (N, 2) of the outline nodes with prescribed displacements."""
        outline = np.concatenate([edges.nodes for edges in self.problem.elements.mesh.faces.values()])
        nodes = np.intersect1d(outline, self.problem.supports.fixed)
        return np.asarray(self.problem.displaced(guess.unknowns)[nodes])

    def _state_at(self, start: State, values: FloatArray, halvings: int) -> State:
        """Return the state at the given load amounts, reached from another state in steps halved as necessary."""
        if not self._too_far(values - start.values):
            try:
                return State(values, self._equilibrium(self._extrapolated(start, values), values))
            except DivergedError as reason:
                self._factors = None
                if halvings == 0:
                    raise self._overload(start.values, values, str(reason)) from None
                halvings -= 1
        half = self._state_at(start, 0.5 * (start.values + values), halvings)
        return self._state_at(half, values, halvings)

    def _too_far(self, change: FloatArray) -> bool:
        """Return whether fingers or clamps move further than allowed in one step."""
        pushed = np.abs(change[[kind is Press for kind in self.kinds]])
        radii = np.array([finger.press.radius_mm for finger in self.problem.fingers])
        turned = np.abs(change[[kind is Turn for kind in self.kinds]])
        return bool((pushed > MAX_PUSH * radii)[~self.by_force].any() or (turned > MAX_TURN_DEG).any())

    def _overload(self, reached: FloatArray, tried: FloatArray, reason: str) -> DesignError:
        """Return an error about loads that the body cannot bear, with the loads that it can."""
        comparison, values = ("no more", reached) if reached.any() else ("less", tried)
        amounts = [f"{name} = {value:.4g}" for name, value in zip(self.names, values, strict=True)]
        limit = f"the body bears {comparison} than about {', '.join(amounts)}: {reason}"
        return DesignError("loads", limit=limit, remedy="reduce the load")

    def _extrapolated(self, start: State, values: FloatArray) -> Guess:
        """Return a guess from the polynomial through the last states, if their load amounts are on a straight line."""
        states = self.passed[-EXTRAPOLATED:]
        change = values - start.values
        square = float(change @ change)
        if self.problem.fingers or start is not states[-1] or len(states) == 1 or square == 0.0:
            return start.guess
        offsets = np.array([state.values - values for state in states])
        amounts = offsets @ change / square
        distances = np.abs(np.subtract.outer(amounts, amounts)) + np.eye(len(states))
        is_straight = np.abs(offsets - np.outer(amounts, change)).max() <= 1e-9 * np.sqrt(square)
        if not is_straight or distances.min() < 1e-6 or np.abs(amounts).max() > 2 * EXTRAPOLATED:
            return start.guess
        weights = [np.prod([b / (b - a) for b in amounts if b != a]) for a in amounts]
        unknowns, angles = (
            sum(weight * state.guess[k] for weight, state in zip(weights, states, strict=True)) for k in range(2)
        )
        return start.guess._replace(unknowns=np.asarray(unknowns), angles=np.asarray(angles))

    def _equilibrium(self, guess: Guess, values: FloatArray) -> Guess:
        """Return the equilibrium at the given load amounts, starting from a guess."""
        turns, presses, pulls = (values[[k is kind for k in self.kinds]] for kind in (Turn, Press, Pull))
        push = np.where(self.by_force, presses, 0.0) / self.thickness_mm
        guess = guess._replace(depth=np.where(push > 0.0, guess.depth, np.where(self.by_force, 0.0, presses)))
        prescribed = Prescribed(self.problem.supports.prescribed(turns.tolist()), pulls @ self.unit_pulls, push)
        active: BoolArray | None = None
        errors: list[float] = []
        for _ in range(MAX_STEPS):
            guess, active, has_converged = self._take_step(guess, prescribed, active, errors)
            if has_converged:
                return guess
        raise DivergedError(f"no equilibrium after {MAX_STEPS} steps; the last step is {errors[-1]:.2g} mm")

    def _take_step(
        self, guess: Guess, prescribed: Prescribed, active: BoolArray | None, errors: list[float]
    ) -> tuple[Guess, BoolArray, bool]:
        """Take one step; return the new guess, the pairs in contact, and whether it has converged."""
        result = step(self.problem, guess, prescribed, self._factors)
        self._factors = result.factors
        errors.append(result.moved_mm)
        rate = errors[-1] / errors[-2] if len(errors) > 1 and errors[-2] > 0.0 else 1.0
        if len(errors) > 1 and rate > MAX_RATE and errors[-1] > TOLERANCE_MM:
            self._factors = None
        same_contact = active is None or bool((result.active == active).all())
        is_small = errors[-1] < TOLERANCE_MM or (rate < MAX_RATE and errors[-1] * rate < TOLERANCE_MM)
        return result.guess, result.active, same_contact and is_small


def _problem(soft: SoftBody, states: Sequence[Sequence[Load]]) -> Problem:
    """Return the supported body with a mesh that resolves the contacts in all states, and the fingers of the first."""
    fingers = [tuple(finger_of(soft.body, load) for load in state if isinstance(load, Press)) for state in states]
    distinct = {finger.press: finger for finger in chain.from_iterable(fingers)}.values()
    sizes = [contact_sizes(soft.body, finger, soft.material, soft.thickness_mm) for finger in distinct]
    options = replace(soft.mesh, finer=(*soft.mesh.finer, *chain.from_iterable(sizes)))
    mesh = mesh_of(soft.body, options, cuts_of(soft.body, soft.holds, states[0]))
    supports = supports_of(soft.body, mesh, soft.holds, [load for load in states[0] if isinstance(load, Turn)])
    free = np.ones(len(mesh.points_mm), dtype=bool)
    free[supports.fixed] = False
    elements = Elements(mesh, soft.material, soft.plane)
    return Problem(elements, supports, fingers[0], pairs_of(mesh, len(fingers[0]), free))


def _unit_pulls(body: Body, mesh: BodyMesh, pull: Pull) -> FloatArray:
    """Return the nodal forces (2, degrees of freedom) for a pull of 1 N along x, and for a pull of 1 N along z."""
    forces = np.zeros((2, len(mesh.points_mm), 2))
    for _, nodes in nodes_on(body, mesh, pull.stretches, pull.name):
        lengths = nodal_lengths(mesh.points_mm, nodes)
        np.add.at(forces[0, :, 0], nodes, lengths)
        np.add.at(forces[1, :, 1], nodes, lengths)
    return np.asarray(forces.reshape(2, -1) / forces[0].sum())
