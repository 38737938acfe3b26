"""Forces and stiffness of the quadratic elements at any displacement: finite strain, exact tangent.

Taylor-Hood elements, with quadratic displacements and linear, continuous pressure, prevent locking of a material that
conserves its volume. The energy per thickness is

    ∫ Ψ(F) + p (J − 1) − c p²/2 dA,

with Ψ and the compliance c of `solen.mechanics.material`; plane stress is the same without p. Stresses and tangent are
expressed in principal stretches (Simo & Taylor 1991), pushed forward to the deformed body.

`Elements.forces` returns the derivative of the energy with respect to displacements and pressures, `Elements.tangent`
its second derivative, as a sparse matrix. Displacements are numbered node by node, x before z; pressures follow.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import BodyMesh

ALIKE = 1e-5
"""Difference of principal strains below which the limiting value of the shear stiffness is used."""
ORDER = 4
"""Degree of the polynomials that the quadrature integrates exactly."""


class _State(NamedTuple):
    """Gradients with respect to deformed position, area ratio and stress at every quadrature point."""

    gradients: FloatArray  # (elements, points, 6, 2)
    area: FloatArray  # (elements, points)
    stress: FloatArray  # Kirchhoff: xx, zz, xz (elements, points, 3)
    pressure: FloatArray
    principal: "_Principal"


class _Principal(NamedTuple):
    """Principal strains (ln λ) and stresses; cosine and sine of twice the angle of the first principal direction."""

    first: FloatArray
    second: FloatArray
    stress: FloatArray
    cos: FloatArray
    sin: FloatArray


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of a mesh for a material and a plane; all quantities are per mm of thickness."""

    mesh: BodyMesh
    material: Material
    plane: Plane

    @cached_property
    def _basis(self) -> Any:
        from skfem import Basis, ElementTriP2

        return Basis(self.mesh.mesh, ElementTriP2(), intorder=ORDER)

    @cached_property
    def nodes(self) -> IndexArray:
        """Node indices (elements, 6) of every element, corners first."""
        return np.asarray(self._basis.element_dofs.T, dtype=np.intp)

    @cached_property
    def weights(self) -> FloatArray:
        """Quadrature weights (elements, points), which are areas in mm²."""
        return np.asarray(self._basis.dx)

    @cached_property
    def _gradients(self) -> FloatArray:
        """Gradients (elements, points, 6, 2) of the shape functions with respect to position at rest."""
        return np.ascontiguousarray(np.stack([np.moveaxis(one[0].grad, 0, -1) for one in self._basis.basis], axis=2))

    @cached_property
    def _flat_gradients(self) -> FloatArray:
        """Gradients of the shape functions, reshaped to (elements, 6, points · 2)."""
        swapped = self._gradients.transpose(0, 2, 1, 3)
        return np.ascontiguousarray(swapped.reshape(*swapped.shape[:2], -1))

    @cached_property
    def _linear(self) -> FloatArray:
        """Shape functions (points, 3) of the pressure."""
        x, z = self._basis.X
        return np.column_stack([1.0 - x - z, x, z])

    @property
    def has_pressure(self) -> bool:
        """Whether pressures are unknowns, as in plane strain."""
        return self.plane == "strain"

    @property
    def displacements(self) -> int:
        """Number of displacement components."""
        return 2 * len(self.mesh.points_mm)

    @property
    def unknowns(self) -> int:
        """Number of all unknowns: displacements, then pressures."""
        return self.displacements + (self.mesh.corners if self.has_pressure else 0)

    @cached_property
    def _numbers(self) -> IndexArray:
        """Indices (elements, 12 or 15) of the unknowns of every element."""
        moves = (2 * self.nodes[:, :, None] + np.arange(2)).reshape(len(self.nodes), 12)
        return np.hstack([moves, self.displacements + self.nodes[:, :3]]) if self.has_pressure else moves

    def deformation(self, unknowns: FloatArray) -> FloatArray:
        """Return the deformation gradients F (elements, points, 2, 2)."""
        moves = unknowns[: self.displacements].reshape(-1, 2)[self.nodes].transpose(0, 2, 1)
        elements, points = self.weights.shape
        slopes = (moves @ self._flat_gradients).reshape(elements, 2, points, 2)
        return np.asarray(np.eye(2) + slopes.transpose(0, 2, 1, 3))

    def turned_inside_out(self, unknowns: FloatArray) -> BoolArray:
        """Return a mask of the elements whose area ratio is not positive at every point."""
        return np.asarray((_det(self.deformation(unknowns)) <= 0.0).any(axis=1))

    def _state(self, unknowns: FloatArray) -> _State:
        f = self.deformation(unknowns)
        area = _det(f)
        inverse = np.stack([f[..., 1, 1], -f[..., 0, 1], -f[..., 1, 0], f[..., 0, 0]], axis=-1).reshape(f.shape)
        gradients = self._gradients @ (inverse / area[..., None, None])
        principal = self._principal(f, area)
        mean, half = principal.stress.sum(axis=-1) / 2, (principal.stress[..., 0] - principal.stress[..., 1]) / 2
        pressure = np.zeros_like(area)
        if self.has_pressure:
            pressure = unknowns[self.displacements :][self.nodes[:, :3]] @ self._linear.T
        mean = mean + pressure * area
        stress = np.stack([mean + half * principal.cos, mean - half * principal.cos, half * principal.sin], axis=-1)
        return _State(gradients, area, stress, pressure, principal)

    def _principal(self, f: FloatArray, area: FloatArray) -> _Principal:
        (a, b), (c, d) = np.moveaxis(f[..., 0, :], -1, 0), np.moveaxis(f[..., 1, :], -1, 0)
        xx, zz, xz = a * a + b * b, c * c + d * d, a * c + b * d
        along, across = (xx - zz) / 2, xz
        radius = np.hypot(along, across)
        largest = (xx + zz) / 2 + radius
        first = 0.5 * np.log(largest)
        second = np.log(area) - first
        safe = np.where(radius > 0.0, radius, 1.0)
        cos, sin = np.where(radius > 0.0, along / safe, 1.0), across / safe
        return _Principal(first, second, self.material.stresses(self.plane, first, second), cos, sin)

    def largest_strain(self, unknowns: FloatArray) -> FloatArray:
        """Return the signed principal strain ln λ of largest magnitude at quadrature points (elements, points)."""
        f = self.deformation(unknowns)
        found = self._principal(f, _det(f))
        return np.where(np.abs(found.first) >= np.abs(found.second), found.first, found.second)

    def thickness_strain(self, unknowns: FloatArray) -> FloatArray:
        """Return the strain along y at the corners of the elements (N,); in plane strain, that of a body free along y.

        In that case, the stress along y is the pressure, to first order, and E = 3 μ.
        """
        if self.has_pressure:
            return -unknowns[self.displacements :] / (3.0 * self.material.shear_modulus_MPa)
        means = -np.log(_det(self.deformation(unknowns))).mean(axis=1)
        corners = self.nodes[:, :3].ravel()
        return np.asarray(np.bincount(corners, np.repeat(means, 3)) / np.bincount(corners))

    def forces(self, unknowns: FloatArray) -> FloatArray:
        """Return the derivative of the energy by every unknown: forces in N/mm, then missing areas in mm²."""
        state = self._state(unknowns)
        xx, zz, xz = np.moveaxis(state.stress, -1, 0)
        stress = np.stack([xx, xz, xz, zz], axis=-1).reshape(*xx.shape, 2, 2) * self.weights[..., None, None]
        local = np.einsum("eqaj,eqij->eai", state.gradients, stress, optimize=True).reshape(len(self.nodes), 12)
        if self.has_pressure:
            missing = state.area - 1.0 - self.material.compliance_per_MPa * state.pressure
            local = np.hstack([local, (missing * self.weights) @ self._linear])
        summed = np.bincount(self._numbers.ravel(), weights=local.ravel(), minlength=self.unknowns)
        return np.asarray(summed, dtype=float)

    def tangent(self, unknowns: FloatArray) -> Any:
        """Return the second derivative of the energy: a symmetric sparse matrix of all unknowns."""
        from scipy.sparse import csc_array

        local = self._local_tangent(self._state(unknowns))
        order, begins, rows, columns = self._places
        data = np.add.reduceat(local.ravel()[order], begins)
        return csc_array((data, rows, columns), shape=(self.unknowns, self.unknowns))

    def _local_tangent(self, state: _State) -> FloatArray:
        elements, points = state.area.shape
        dx, dz = state.gradients[..., 0], state.gradients[..., 1]
        strain = np.zeros((elements, points, 3, 12))
        strain[:, :, 0, 0::2], strain[:, :, 1, 1::2] = dx, dz
        strain[:, :, 2, 0::2], strain[:, :, 2, 1::2] = dz, dx
        weighted = (self._moduli(state) * self.weights[..., None, None]) @ strain
        flat = (elements, points * 3, 12)
        local = strain.reshape(flat).transpose(0, 2, 1) @ weighted.reshape(flat)
        xx, zz, xz = np.moveaxis(state.stress * self.weights[..., None], -1, 0)
        pulled = np.stack([dx * xx[..., None] + dz * xz[..., None], dx * xz[..., None] + dz * zz[..., None]], axis=2)
        both = state.gradients.transpose(0, 1, 3, 2).reshape(elements, points * 2, 6)
        turned = both.transpose(0, 2, 1) @ pulled.reshape(elements, points * 2, 6)
        local[:, 0::2, 0::2] += turned
        local[:, 1::2, 1::2] += turned
        return self._with_pressure(local, state) if self.has_pressure else local

    def _moduli(self, state: _State) -> FloatArray:
        """Return the moduli (elements, points, 3, 3) from strains xx, zz, 2 xz to Kirchhoff stress."""
        found = state.principal
        mean, half = found.stress.sum(axis=-1) / 2, (found.stress[..., 0] - found.stress[..., 1]) / 2
        slopes = self.material.slopes(self.plane, found.first, found.second)
        a, b, d = slopes[..., 0, 0], slopes[..., 0, 1], slopes[..., 1, 1]
        swell, mixed, spread = (a + 2 * b + d) / 4, (a - d) / 4, (a - 2 * b + d) / 4
        volume = state.pressure * state.area
        difference = found.first - found.second
        near = np.abs(difference) < ALIKE
        apart = np.where(near, 1.0, difference)
        shear = np.where(near, spread, half / np.tanh(apart)) - mean
        one = np.ones_like(mean)
        zero = np.zeros_like(mean)
        whole, along = np.stack([one, one, zero], axis=-1), np.stack([found.cos, -found.cos, found.sin], axis=-1)
        across = np.stack([-found.sin, found.sin, found.cos], axis=-1)
        moduli = _dyad(swell - mean + volume, whole, whole) + _dyad(spread - mean, along, along)
        moduli += _dyad(mixed - half, whole, along) + _dyad(mixed - half, along, whole)
        moduli += _dyad(shear, across, across)
        return moduli - volume[..., None, None] * np.diag([2.0, 2.0, 1.0])

    def _with_pressure(self, local: FloatArray, state: _State) -> FloatArray:
        """Return the tangent, bordered by the rows and columns of the pressures."""
        whole = np.zeros((len(local), 15, 15))
        whole[:, :12, :12] = local
        sweep = np.einsum("eq,qp,eqai->epai", state.area * self.weights, self._linear, state.gradients, optimize=True)
        whole[:, 12:, :12] = sweep.reshape(len(local), 3, 12)
        whole[:, :12, 12:] = whole[:, 12:, :12].transpose(0, 2, 1)
        mass = np.einsum("eq,qp,qr->epr", self.weights, self._linear, self._linear, optimize=True)
        whole[:, 12:, 12:] = -self.material.compliance_per_MPa * mass
        return whole

    @cached_property
    def _places(self) -> tuple[IndexArray, IndexArray, IndexArray, IndexArray]:
        """Order of the local entries by their index in the sparse matrix, start of each, rows and column starts."""
        rows = np.repeat(self._numbers[:, :, None], self._numbers.shape[1], axis=2).ravel()
        columns = np.repeat(self._numbers[:, None, :], self._numbers.shape[1], axis=1).ravel()
        order = np.lexsort((rows, columns))
        key = columns[order] * self.unknowns + rows[order]
        begins = np.flatnonzero(np.diff(key, prepend=-1))
        starts = np.searchsorted(columns[order][begins], np.arange(self.unknowns + 1))
        return order, begins, rows[order][begins], starts


def _dyad(factor: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(factor[..., None, None] * left[..., :, None] * right[..., None, :])


def _det(f: FloatArray) -> FloatArray:
    return np.asarray(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])
