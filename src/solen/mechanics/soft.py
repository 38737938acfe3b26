"""A soft body through the successive states of its loads.

Newton's method for finite strains. Its matrix is factorised at rest and reused as long as it converges: the first step
is the small-strain solution, and the following steps remove its error, so that a clamp's turn is exact at every angle
(docs/decisions/0090). During contact with a finger, the matrix is recomputed at every step. If a load is too far from
the previous state, the step to it is halved.

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
from solen.mechanics.fingers import Finger, contact_sizes, finger_of, pairs_of
from solen.mechanics.load import Hold, Load, Press, Pull, Turn
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import BodyMesh, MeshOptions, mesh_of
from solen.mechanics.newton import MAX_PUSH, Demand, DivergedError, Factors, Guess, Problem, step
from solen.mechanics.outcome import Outcome
from solen.mechanics.stretches import cuts_of, edge_shares, nodes_on
from solen.mechanics.supports import supports_of

EXACT_MM = 1e-8
"""Accuracy of the computed displacements."""
MAX_STEPS = 25
SLOW = 0.3
"""A reused matrix is recomputed if a step leaves more than this fraction of the error."""
MAX_HALVINGS = 5
MAX_TURN_DEG = 12.0
"""Largest rotation of a clamp in one step."""
REMEMBERED = 4
"""Number of states from which the next one is extrapolated."""


@dataclass(frozen=True)
class SoftBody:
    """A held body of soft material, ready to be loaded.

    Attributes
    ----------
    body
        The body at rest.
    material
        Material of the entire body.
    holds
        Supports at rest.
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
            limit = "must be 0.5 in plane stress, where the thickness conserves the volume"
            raise DesignError("mechanics.poisson", value=self.material.poisson, limit=limit)

    def state(self, loads: Sequence[Load]) -> Deformed:
        """Return the body under the given loads, starting from rest; raises the errors of `states`."""
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
            If the body is not held, a stretch is not on its outline, a finger would pass through it, or it cannot bear
            a load: with the place.
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
    """Name of each entry of `_values`."""
    found: list[str] = []
    for load in loads:
        if isinstance(load, Turn):
            found.append(f"{load.name}.angle_deg")
        elif isinstance(load, Pull):
            found += [f"{load.name}.force_N (x)", f"{load.name}.force_N (z)"]
        else:
            found.append(f"{load.name}.{'depth_mm' if load.force_N is None else 'force_N'}")
    return tuple(found)


def _values(loads: Sequence[Load]) -> FloatArray:
    """Return the load amounts in degrees, mm or N: one for each load, and two for a pull."""
    found: list[float] = []
    for load in loads:
        if isinstance(load, Turn):
            found.append(load.angle_deg)
        elif isinstance(load, Pull):
            found += load.force_N
        else:
            found.append(load.force_N if load.force_N is not None else load.depth_mm or 0.0)
        if not np.isfinite(found).all():
            raise DesignError(load.name, value=found[-1], limit="must be finite")
    return np.array(found)


class State(NamedTuple):
    """Load amounts, and the equilibrium under them."""

    values: FloatArray
    guess: Guess


@dataclass(eq=False)
class Path:
    """States that a body has passed through, from rest.

    Attributes
    ----------
    problem
        The held body.
    names, kinds
        Name of each amount, and the kind of its load.
    by_force
        Mask of fingers with a given force.
    spread
        Forces on all components of displacement for each amount of a pull of 1 N, per mm of thickness.
    thickness_mm
        Thickness of the body.
    passed
        The states, rest first.
    """

    problem: Problem
    names: tuple[str, ...]
    kinds: tuple[type, ...]
    by_force: BoolArray
    spread: FloatArray
    thickness_mm: float
    passed: list[State]
    _kept: Factors | None = None

    @classmethod
    def of(cls, soft: SoftBody, states: Sequence[Sequence[Load]]) -> "Path":
        """Create the body at rest, with a mesh that suits its loads."""
        loads = states[0]
        if any(_without_amounts(state) != _without_amounts(loads) for state in states):
            raise DesignError("loads", limit="states may differ only by their angles, depths and forces")
        every = [[finger_of(soft.body, load) for load in state if isinstance(load, Press)] for state in states]
        fingers = {finger.press: finger for one in every for finger in one}
        sized = (contact_sizes(soft.body, finger, soft.material, soft.thickness_mm) for finger in fingers.values())
        options = replace(soft.mesh, finer=(*soft.mesh.finer, *chain.from_iterable(sized)))
        mesh = mesh_of(soft.body, options, cuts_of(soft.body, soft.holds, loads))
        problem = _problem(soft, mesh, loads, tuple(every[0]))
        rest = Guess(
            np.zeros(problem.elements.unknowns),
            np.zeros(len(problem.supports.hinges)),
            np.zeros(len(every[0])),
            np.zeros(len(problem.pairs.node)),
        )
        pulls = [_spread(soft.body, mesh, load) for load in loads if isinstance(load, Pull)]
        spread = np.vstack([*pulls, np.zeros((0, problem.elements.displacements))]) / soft.thickness_mm
        kinds = [kind for load in loads for kind in ((Pull, Pull) if isinstance(load, Pull) else (type(load),))]
        by_force = np.array([finger.by_force for finger in every[0]], dtype=bool)
        first = State(np.zeros(len(kinds)), rest)
        return cls(problem, _names(loads), tuple(kinds), by_force, spread, soft.thickness_mm, [first])

    def outcome(self, body: Body, loads: Sequence[Load]) -> Outcome:
        """Return the equilibrium under the given loads, starting from the last state."""
        guess = self.reach(_values(loads))
        own = self.thickness_mm * self.spread.reshape(-1, 2, *self.problem.supports.points_mm.shape)
        pulls = [load for load in loads if isinstance(load, Pull)]
        forces = {load.name: np.tensordot(load.force_N, one, 1) for load, one in zip(pulls, own, strict=True)}
        return Outcome(body, self.problem, guess, forces, self.thickness_mm)

    def reach(self, values: FloatArray) -> Guess:
        """Return the equilibrium at the given load amounts, starting from the last state."""
        state = self._reached(self.passed[-1], values, MAX_HALVINGS)
        self.passed.append(state)
        held = self._points_held(state.guess)
        for k, finger in enumerate(self.problem.fingers):
            push = float(state.guess.force[self.problem.pairs.finger == k].sum())
            finger.check(float(state.guess.depth[k]), push, held)
        return state.guess

    def _points_held(self, guess: Guess) -> FloatArray:
        """Return the positions (N, 2) of the outline nodes with prescribed displacements."""
        own = np.unique(np.concatenate([e.nodes for e in self.problem.elements.mesh.faces.values()]))
        held = np.intersect1d(own, self.problem.supports.fixed)
        return np.asarray(self.problem.displaced(guess.unknowns)[held])

    def _reached(self, start: State, values: FloatArray, halvings: int) -> State:
        """Return the state at the given load amounts from another state, in halved steps if that is too far away."""
        if not self._too_far(values - start.values):
            try:
                return State(values, self._equilibrium(self._extrapolated(start, values), values))
            except DivergedError as reason:
                self._kept = None
                if halvings == 0:
                    raise self._unbearable(start.values, values, str(reason)) from None
                halvings -= 1
        half = self._reached(start, 0.5 * (start.values + values), halvings)
        return self._reached(half, values, halvings)

    def _too_far(self, way: FloatArray) -> bool:
        """Return whether fingers or clamps move further than allowed in one step."""
        pushed = np.abs(way[[kind is Press for kind in self.kinds]])
        radii = np.array([finger.press.radius_mm for finger in self.problem.fingers])
        turned = np.abs(way[[kind is Turn for kind in self.kinds]])
        return bool((pushed > MAX_PUSH * radii)[~self.by_force].any() or (turned > MAX_TURN_DEG).any())

    def _unbearable(self, reached: FloatArray, tried: FloatArray, reason: str) -> DesignError:
        """Return an error about loads that the body cannot bear, with the loads that it can."""
        most, values = ("no more", reached) if reached.any() else ("less", tried)
        names = [f"{name} = {value:.4g}" for name, value in zip(self.names, values, strict=True)]
        limit = f"the body bears {most} than about {', '.join(names)}: {reason}"
        return DesignError("loads", limit=limit, remedy="load it less")

    def _extrapolated(self, start: State, values: FloatArray) -> Guess:
        """Return a guess from the polynomial through the last states, if their load amounts are on a straight line."""
        known = self.passed[-REMEMBERED:]
        way = values - start.values
        square = float(way @ way)
        if self.problem.fingers or start is not known[-1] or len(known) == 1 or square == 0.0:
            return start.guess
        left = np.array([state.values - values for state in known])
        amounts = left @ way / square
        near = np.abs(np.subtract.outer(amounts, amounts)) + np.eye(len(known))
        if np.abs(left - np.outer(amounts, way)).max() > 1e-9 * np.sqrt(square) or near.min() < 1e-6:
            return start.guess
        if np.abs(amounts).max() > 2 * REMEMBERED:
            return start.guess
        shares = [np.prod([b / (b - a) for b in amounts if b != a]) for a in amounts]
        mixed = (sum(share * state.guess[k] for share, state in zip(shares, known, strict=True)) for k in range(2))
        return start.guess._replace(unknowns=np.asarray(next(mixed)), angles=np.asarray(next(mixed)))

    def _equilibrium(self, guess: Guess, values: FloatArray) -> Guess:
        """Return the equilibrium at the given load amounts, starting from a guess."""
        turns, presses, pulls = (values[[k is kind for k in self.kinds]] for kind in (Turn, Press, Pull))
        push = np.where(self.by_force, presses, 0.0) / self.thickness_mm
        guess = guess._replace(depth=np.where(push > 0.0, guess.depth, np.where(self.by_force, 0.0, presses)))
        demand = Demand(self.problem.supports.given(turns.tolist()), pulls @ self.spread, push)
        before: BoolArray | None = None
        errors: list[float] = []
        for _ in range(MAX_STEPS):
            guess, before, settled = self._stepped(guess, demand, before, errors)
            if settled:
                return guess
        raise DivergedError(f"no equilibrium after {MAX_STEPS} steps, the last of {errors[-1]:.2g} mm")

    def _stepped(
        self, guess: Guess, demand: Demand, before: BoolArray | None, errors: list[float]
    ) -> tuple[Guess, BoolArray, bool]:
        """Take one step, and return the new guess, the pairs in contact, and whether it has converged."""
        taken = step(self.problem, guess, demand, self._kept)
        self._kept = taken.kept
        errors.append(taken.moved_mm)
        rate = errors[-1] / errors[-2] if len(errors) > 1 and errors[-2] > 0.0 else 1.0
        if len(errors) > 1 and rate > SLOW and errors[-1] > EXACT_MM:
            self._kept = None
        same = before is None or bool((taken.active == before).all())
        settled = same and (errors[-1] < EXACT_MM or (rate < SLOW and errors[-1] * rate < EXACT_MM))
        return taken.guess, taken.active, settled


def _problem(soft: SoftBody, mesh: BodyMesh, loads: Sequence[Load], fingers: tuple[Finger, ...]) -> Problem:
    turns = [load for load in loads if isinstance(load, Turn)]
    supports = supports_of(soft.body, mesh, soft.holds, turns)
    free = np.ones(len(mesh.points_mm), dtype=bool)
    free[supports.fixed] = False
    elements = Elements(mesh, soft.material, soft.plane)
    return Problem(elements, supports, fingers, pairs_of(mesh, len(fingers), free))


def _spread(body: Body, mesh: BodyMesh, pull: Pull) -> FloatArray:
    """Return the nodal forces (2, displacement components) for a pull of 1 N along x, and for a pull of 1 N along z."""
    forces = np.zeros((2, len(mesh.points_mm), 2))
    for _, nodes in nodes_on(body, mesh, pull.stretches, pull.name):
        shares = edge_shares(mesh.points_mm, nodes)
        np.add.at(forces[0, :, 0], nodes, shares)
        np.add.at(forces[1, :, 1], nodes, shares)
    return np.asarray(forces.reshape(2, -1) / forces[0].sum())
