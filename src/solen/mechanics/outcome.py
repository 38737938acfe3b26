"""Results of an equilibrium: displaced walls, reactions, contacts, strain, warnings."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict

import numpy as np

from solen.arrays import FloatArray, IndexArray, flag_runs
from solen.curve import Measure
from solen.geometry import Body, Face
from solen.mechanics.deformed import Contact, Deformed, Picture, Reaction, Wall
from solen.mechanics.fingers import Touch, shares_of, touch_of
from solen.mechanics.newton import Guess, Problem
from solen.plane import Point

PULLED = 0.02
"""A sliding hold causes no warning if its pull is at most this fraction of its push."""
BULGE_FRACTION = 0.9
"""Fraction of the area in which walls bulge by at most the reported value; at sharp corners the bulge is unbounded."""
FAINT = 1e-6
"""A node does not count as loaded by the finger if its force is below this fraction of the largest force."""
FEW = 5
"""The contact width is not resolved if fewer nodes than this are in contact."""
LARGE = 1.0
"""Principal strain ln λ beyond the range in which models were fitted for most resins."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """An equilibrium of a held body.

    Attributes
    ----------
    body, problem, guess
        The body at rest, its supports and fingers, and the equilibrium.
    pulls
        Forces (N, 2) of every pull on all nodes by its name, in N for the whole thickness.
    thickness_mm
        Thickness of the body.
    """

    body: Body
    problem: Problem
    guess: Guess
    pulls: Mapping[str, FloatArray]
    thickness_mm: float

    def deformed(self) -> Deformed:
        """Return the deformed body: walls, reactions, contacts and strain."""
        mesh = self.problem.elements.mesh
        moves = self._points - mesh.points_mm
        walls = {name: Wall(e.u, mesh.points_mm[e.nodes], moves[e.nodes]) for name, e in mesh.faces.items()}
        triangles = mesh.mesh.t.T.astype(np.intp)
        n = mesh.corners
        return Deformed(
            self.body,
            walls,
            (*self._held(), *self._pulled(), *self._pressed()),
            tuple(self._contacts()),
            Picture(mesh.points_mm[:n], moves[:n], triangles, self._at_corners),
            float(np.abs(self._strain).max()),
            self._bulge_mm,
            tuple(self._warnings()),
        )

    @cached_property
    def _points(self) -> FloatArray:
        return self.problem.displaced(self.guess.unknowns)

    @cached_property
    def _touch(self) -> Touch:
        return touch_of(self.problem.fingers, self.problem.pairs, self._points, self.guess.depth)

    @cached_property
    def _strain(self) -> FloatArray:
        return self.problem.elements.largest_strain(self.guess.unknowns)

    @cached_property
    def _at_corners(self) -> FloatArray:
        """Return the absolute strain (N,) at the triangle corners, averaged over the adjacent elements."""
        elements = self.problem.elements
        corners, n = elements.nodes[:, :3].ravel(), elements.mesh.corners
        means = np.repeat(np.abs(self._strain).mean(axis=1), 3)  # both signs occur if the volume is conserved
        return np.asarray(np.bincount(corners, means, n) / np.bincount(corners, minlength=n))

    @cached_property
    def _bulge_mm(self) -> float:
        """Return the bulge, see `Deformed`: a gradient in x and z of the strain along y bends a wall by t²/8 of it."""
        elements = self.problem.elements
        strain = elements.thickness_strain(self.guess.unknowns)[elements.nodes[:, :3]]
        a, b, c = elements.mesh.points_mm[elements.nodes[:, :3]].transpose(1, 0, 2)
        sides = np.stack([b - a, c - a], axis=1)
        steps = (strain[:, 1:] - strain[:, :1])[..., None]
        slopes = np.hypot(*np.linalg.solve(sides, steps)[..., 0].T)
        order, areas = np.argsort(slopes), elements.weights.sum(axis=1)
        reached = np.cumsum(areas[order])
        most = slopes[order[np.searchsorted(reached, BULGE_FRACTION * reached[-1])]]
        return float(self.thickness_mm**2 / 8.0 * most)

    @cached_property
    def _pushes(self) -> FloatArray:
        """Return the forces (M, 2) of the fingers on their contact pairs, in N."""
        return np.asarray(self.thickness_mm * self.guess.force[:, None] * self._touch.normal)

    @cached_property
    def _exerted(self) -> FloatArray:
        """Return the forces (N, 2) of holds and clamps on the nodes, in N: the residual of the force balance there."""
        elements = self.problem.elements
        inner = elements.forces(self.guess.unknowns)[: elements.displacements]
        exerted = self.thickness_mm * inner.reshape(-1, 2)
        np.subtract.at(exerted, self.problem.pairs.node, self._pushes)
        for forces in self.pulls.values():
            exerted = exerted - forces
        return exerted

    def _held(self) -> Iterator[Reaction]:
        for group in self.problem.supports.groups:
            yield self._reaction(group.name, group.nodes, self._exerted[group.nodes], group.pivot)

    def _pulled(self) -> Iterator[Reaction]:
        for name, forces in self.pulls.items():
            nodes = np.flatnonzero(forces.any(axis=1))
            x, z = self._points[nodes].mean(axis=0) if nodes.size else (0.0, 0.0)
            yield self._reaction(name, nodes, forces[nodes], (float(x), float(z)))

    def _pressed(self) -> Iterator[Reaction]:
        for k, finger in enumerate(self.problem.fingers):
            own = self.problem.pairs.finger == k
            x, z = finger.start_mm + self.guess.depth[k] * finger.way
            nodes = self.problem.pairs.node[own]
            yield self._reaction(finger.press.name, nodes, self._pushes[own], (float(x), float(z)))

    def _reaction(self, name: str, nodes: IndexArray, forces: FloatArray, about: Point) -> Reaction:
        (x, z), (fx, fz) = (self._points[nodes] - about).T, forces.T
        moment = float(np.sum(x * fz - z * fx))
        return Reaction(name=name, force_N=(float(fx.sum()), float(fz.sum())), moment_Nmm=moment, about_mm=about)

    def _contacts(self) -> Iterator[Contact]:
        shares = shares_of(self.problem.elements.mesh, self._points)
        for k, finger in enumerate(self.problem.fingers):
            own = (self.problem.pairs.finger == k) & (self.guess.force > FAINT * self.guess.force.max(initial=1e-6))
            nodes = self.problem.pairs.node[own]
            if not nodes.size:
                continue
            pressure = float((self.guess.force[own] / shares[nodes]).max())
            left = dict(zip(nodes.tolist(), self._pushes[own] @ finger.way, strict=True))
            for face in self.body.all_faces:
                for low, high, touched in self._touched(face, nodes):
                    yield Contact(
                        name=finger.press.name,
                        face=face.name,
                        u_from=low,
                        u_to=high,
                        **_lengths(face, low, high),
                        depth_mm=float(self.guess.depth[k]),
                        force_N=float(sum(left.pop(node, 0.0) for node in touched.tolist())),
                        pressure_MPa=pressure,
                    )

    def _touched(self, face: Face, nodes: IndexArray) -> Iterator[tuple[float, float, IndexArray]]:
        """Yield the parts of a face in contact, with their nodes; each extends halfway to the next free node."""
        edges = self.problem.elements.mesh.faces[face.name]
        touching = np.isin(edges.nodes, nodes)
        if not touching.any():
            return
        halves = np.concatenate([[0.0], 0.5 * (edges.u[1:] + edges.u[:-1]), [1.0]])
        for low, high in flag_runs(touching):
            yield float(halves[low]), float(halves[high]), edges.nodes[low:high]

    def _warnings(self) -> Iterator[str]:
        largest = float(np.abs(self._strain).max())
        if largest > LARGE:
            yield (
                f"strains reach {largest:.2f} (ln of the stretch): check that the material's "
                "model is valid in this range"
            )
        for k, finger in enumerate(self.problem.fingers):
            count = int(np.sum((self.problem.pairs.finger == k) & (self.guess.force > 0.0)))
            if 0 < count < FEW:
                nodes = f"{finger.press.name} touches only {count} nodes"
                yield f"{nodes}: its contact is not resolved; use a finer mesh there"
        yield from self._pulling()

    def _pulling(self) -> Iterator[str]:
        """Yield warnings about sliding holds that pull at the body."""
        supports = self.problem.supports
        x, z = supports.ways.T
        push = np.zeros(len(self._points))
        push[supports.sliding] = np.sum(self._exerted[supports.sliding] * np.column_stack([-z, x]), axis=1)
        for group in supports.groups:
            own = push[group.nodes]
            pulled, pushed = -own[own < 0.0].sum(), own[own > 0.0].sum()
            if pulled > PULLED * pushed and pulled > FAINT:
                yield (
                    f"{group.name} pulls at the body with {pulled:.2g} N and pushes "
                    f"with {pushed:.2g} N: if it can only push, its contact is shorter"
                )


class _Stretch(TypedDict):
    from_mm: float
    to_mm: float


def _lengths(face: Face, u_from: float, u_to: float) -> _Stretch:
    """Return the length range of a part of a face, measured as in wall tables."""
    measure = Measure(face.curve)
    low, high = measure.lengths_at(np.array([u_from, u_to])).tolist()
    ends = (measure.length_mm - high, measure.length_mm - low) if face.from_end else (low, high)
    return _Stretch(from_mm=face.begins_mm + ends[0], to_mm=face.begins_mm + ends[1])
