"""Results of an equilibrium: displaced walls, reactions, contacts, strain and warnings."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict

import numpy as np

from solen.arrays import FloatArray, IndexArray, flag_runs
from solen.curve import ArcLength
from solen.geometry import Body, Face
from solen.mechanics.deformed import Contact, Deformed, Picture, Reaction, Wall
from solen.mechanics.fingers import Touch, touch_of, tributary_lengths
from solen.mechanics.newton_step import Guess, Problem
from solen.plane import Point

MAX_PULL_FRACTION = 0.02
"""Largest pull of a sliding hold that causes no warning, as a fraction of its push."""
BULGE_FRACTION = 0.9
"""Fraction of the area in which the walls bulge by at most the reported value; the bulge at corners is unbounded."""
MIN_FORCE_FRACTION = 1e-6
"""A finger touches the nodes on which its force is above this fraction of the largest force on a node."""
MIN_PULL_N = 1e-6
"""Smallest pull of a sliding hold that causes a warning."""
MIN_CONTACT_NODES = 5
"""Number of nodes in contact below which the contact width is not resolved."""
MAX_FITTED_STRAIN = 1.0
"""Principal strain ln λ up to which the models of most resins were fitted."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """An equilibrium of a supported body.

    Attributes
    ----------
    body, problem, guess
        The body at rest, its supports and fingers, and the equilibrium.
    pulls
        Forces (N, 2) of every pull on all nodes, keyed by its name, in N for the entire thickness.
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
        displacement = self._points - mesh.points_mm
        walls = {name: Wall(e.u, mesh.points_mm[e.nodes], displacement[e.nodes]) for name, e in mesh.faces.items()}
        triangles = mesh.mesh.t.T.astype(np.intp)
        n = mesh.corners
        return Deformed(
            self.body,
            walls,
            (*self._support_reactions(), *self._pull_reactions(), *self._finger_reactions()),
            tuple(self._contacts()),
            Picture(mesh.points_mm[:n], displacement[:n], triangles, self._corner_strain),
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
    def _corner_strain(self) -> FloatArray:
        """Absolute strain (N,) at the triangle corners, averaged over the adjacent elements."""
        elements = self.problem.elements
        corners, n = elements.nodes[:, :3].ravel(), elements.mesh.corners
        means = np.repeat(np.abs(self._strain).mean(axis=1), 3)  # in an incompressible body, both signs occur
        return np.asarray(np.bincount(corners, means, n) / np.bincount(corners, minlength=n))

    @cached_property
    def _bulge_mm(self) -> float:
        """The ``bulge_mm`` of `Deformed`: t²/8 times the slope in the x-z plane of the strain along y; t: thickness."""
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
        """Forces (M, 2) of the fingers on their contact pairs, in N."""
        return np.asarray(self.thickness_mm * self.guess.force[:, None] * self._touch.normal)

    @cached_property
    def _exerted(self) -> FloatArray:
        """Forces (N, 2) of holds and clamps on the nodes, in N: the residual of the force balance."""
        elements = self.problem.elements
        internal = elements.forces(self.guess.unknowns)[: elements.displacement_count]
        exerted = self.thickness_mm * internal.reshape(-1, 2)
        np.subtract.at(exerted, self.problem.pairs.node, self._pushes)
        for forces in self.pulls.values():
            exerted = exerted - forces
        return exerted

    def _support_reactions(self) -> Iterator[Reaction]:
        for group in self.problem.supports.groups:
            yield self._reaction(group.name, group.nodes, self._exerted[group.nodes], group.pivot)

    def _pull_reactions(self) -> Iterator[Reaction]:
        for name, forces in self.pulls.items():
            nodes = np.flatnonzero(forces.any(axis=1))
            x, z = self._points[nodes].mean(axis=0) if nodes.size else (0.0, 0.0)
            yield self._reaction(name, nodes, forces[nodes], (float(x), float(z)))

    def _finger_reactions(self) -> Iterator[Reaction]:
        for k, finger in enumerate(self.problem.fingers):
            pairs = self.problem.pairs.finger == k
            x, z = finger.start_mm + self.guess.depth[k] * finger.direction
            nodes = self.problem.pairs.node[pairs]
            yield self._reaction(finger.press.name, nodes, self._pushes[pairs], (float(x), float(z)))

    def _reaction(self, name: str, nodes: IndexArray, forces: FloatArray, about: Point) -> Reaction:
        (x, z), (fx, fz) = (self._points[nodes] - about).T, forces.T
        moment = float(np.sum(x * fz - z * fx))
        return Reaction(name=name, force_N=(float(fx.sum()), float(fz.sum())), moment_Nmm=moment, about_mm=about)

    def _contacts(self) -> Iterator[Contact]:
        lengths = tributary_lengths(self.problem.elements.mesh, self._points)
        loaded = self.guess.force > MIN_FORCE_FRACTION * self.guess.force.max(initial=1e-6)
        for k, finger in enumerate(self.problem.fingers):
            pairs = (self.problem.pairs.finger == k) & loaded
            nodes = self.problem.pairs.node[pairs]
            if not nodes.size:
                continue
            pressure = float((self.guess.force[pairs] / lengths[nodes]).max())
            forces = dict(zip(nodes.tolist(), self._pushes[pairs] @ finger.direction, strict=True))
            for face in self.body.all_faces:
                for low, high, touched in self._contact_parts(face, nodes):
                    yield Contact(
                        name=finger.press.name,
                        face=face.name,
                        u_from=low,
                        u_to=high,
                        **_lengths(face, low, high),
                        depth_mm=float(self.guess.depth[k]),
                        force_N=float(sum(forces.pop(node, 0.0) for node in touched.tolist())),
                        pressure_MPa=pressure,
                    )

    def _contact_parts(self, face: Face, nodes: IndexArray) -> Iterator[tuple[float, float, IndexArray]]:
        """Yield the parts of a face in contact, with their nodes; each part extends halfway to the next free node."""
        edges = self.problem.elements.mesh.faces[face.name]
        touching = np.isin(edges.nodes, nodes)
        if not touching.any():
            return
        halves = np.concatenate([[0.0], 0.5 * (edges.u[1:] + edges.u[:-1]), [1.0]])
        for low, high in flag_runs(touching):
            yield float(halves[low]), float(halves[high]), edges.nodes[low:high]

    def _warnings(self) -> Iterator[str]:
        largest = float(np.abs(self._strain).max())
        if largest > MAX_FITTED_STRAIN:
            yield (
                f"strains reach {largest:.2f} (logarithmic): check that the material's model is valid at such strains"
            )
        for k, finger in enumerate(self.problem.fingers):
            count = int(np.sum((self.problem.pairs.finger == k) & (self.guess.force > 0.0)))
            if 0 < count < MIN_CONTACT_NODES:
                resolution = f"{finger.press.name} touches only {count} nodes, which do not resolve the contact"
                yield f"{resolution}: set a smaller mechanics.mesh_mm"
        yield from self._pull_warnings()

    def _pull_warnings(self) -> Iterator[str]:
        """Yield warnings about sliding holds that pull on the body."""
        supports = self.problem.supports
        x, z = supports.directions.T
        push = np.zeros(len(self._points))
        push[supports.sliding] = np.sum(self._exerted[supports.sliding] * np.column_stack([-z, x]), axis=1)
        for group in supports.groups:
            pushes = push[group.nodes]
            pulled, pushed = -pushes[pushes < 0.0].sum(), pushes[pushes > 0.0].sum()
            if pulled > MAX_PULL_FRACTION * pushed and pulled > MIN_PULL_N:
                yield (
                    f"{group.name} pulls on the body with {pulled:.2g} N and pushes with {pushed:.2g} N: "
                    "if this support can only push, shorten it until it no longer pulls"
                )


class _Range(TypedDict):
    from_mm: float
    to_mm: float


def _lengths(face: Face, u_from: float, u_to: float) -> _Range:
    """Return the ends of a part of a face as lengths, measured as in wall tables."""
    measure = ArcLength(face.curve)
    low, high = measure.lengths_at(np.array([u_from, u_to])).tolist()
    ends = (measure.length_mm - high, measure.length_mm - low) if face.from_end else (low, high)
    return _Range(from_mm=face.begins_mm + ends[0], to_mm=face.begins_mm + ends[1])
