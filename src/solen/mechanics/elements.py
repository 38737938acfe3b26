"""Forces and stiffness of quadratic elements at finite strain, with the exact tangent.

Taylor-Hood elements, with quadratic displacements and a linear, continuous pressure, prevent volumetric locking of an
incompressible material. The energy per unit thickness is

    ∫ Ψ(F) + p (J − 1) − c p²/2 dA,

with Ψ and the compliance c of `solen.mechanics.material`; in plane stress, there is no p. Stresses and tangent are
expressed in principal stretches (Simo & Taylor 1991) and pushed forward to the deformed body.

`Elements.forces` returns the derivative of the energy with respect to displacements and pressures, `Elements.tangent`
its second derivative as a sparse matrix. Displacements are numbered node by node, x before z; pressures follow.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import BodyMesh

MIN_STRAIN_DIFFERENCE = 1e-5
"""Difference of principal strains below which the shear stiffness has its limiting value for equal strains."""
QUADRATURE_DEGREE = 4
"""Highest degree of the polynomials that the quadrature integrates exactly."""


class _State(NamedTuple):
    """Area ratio, stress, and shape function gradients with respect to the deformed position, at quadrature points."""

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

        return Basis(self.mesh.mesh, ElementTriP2(), intorder=QUADRATURE_DEGREE)

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
        gradients = [np.moveaxis(function[0].grad, 0, -1) for function in self._basis.basis]
        return np.ascontiguousarray(np.stack(gradients, axis=2))

    @cached_property
    def _flat_gradients(self) -> FloatArray:
        """Gradients of the shape functions, reshaped to (elements, 6, points · 2)."""
        swapped = self._gradients.transpose(0, 2, 1, 3)
        return np.ascontiguousarray(swapped.reshape(*swapped.shape[:2], -1))

    @cached_property
    def _linear(self) -> FloatArray:
        """Linear shape functions of the pressure at the quadrature points (points, 3)."""
        x, z = self._basis.X
        return np.column_stack([1.0 - x - z, x, z])

    @property
    def has_pressure(self) -> bool:
        """Whether pressures are unknowns, as in plane strain."""
        return self.plane == "strain"

    @property
    def displacement_count(self) -> int:
        """Number of displacement degrees of freedom."""
        return 2 * len(self.mesh.points_mm)

    @property
    def unknown_count(self) -> int:
        """Number of unknowns: displacements and pressures."""
        return self.displacement_count + (self.mesh.corners if self.has_pressure else 0)

    @cached_property
    def _dofs(self) -> IndexArray:
        """Indices (elements, 12 or 15) of the unknowns of every element."""
        displacements = (2 * self.nodes[:, :, None] + np.arange(2)).reshape(len(self.nodes), 12)
        if not self.has_pressure:
            return displacements
        return np.hstack([displacements, self.displacement_count + self.nodes[:, :3]])

    def deformation(self, unknowns: FloatArray) -> FloatArray:
        """Return the deformation gradients F (elements, points, 2, 2)."""
        displacements = unknowns[: self.displacement_count].reshape(-1, 2)[self.nodes].transpose(0, 2, 1)
        elements, points = self.weights.shape
        slopes = (displacements @ self._flat_gradients).reshape(elements, 2, points, 2)
        return np.asarray(np.eye(2) + slopes.transpose(0, 2, 1, 3))

    def inverted(self, unknowns: FloatArray) -> BoolArray:
        """Return a mask of the elements whose area ratio is not positive at every quadrature point."""
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
            pressure = unknowns[self.displacement_count :][self.nodes[:, :3]] @ self._linear.T
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
        principal = self._principal(f, _det(f))
        return np.where(np.abs(principal.first) >= np.abs(principal.second), principal.first, principal.second)

    def thickness_strain(self, unknowns: FloatArray) -> FloatArray:
        """Return the strain along y at the corners of the elements (N,), as if the body were free along y.

        In plane strain, the stress along y is the pressure to first order; releasing it strains the body by −p/E along
        y, with E = 3 μ.
        """
        if self.has_pressure:
            return -unknowns[self.displacement_count :] / (3.0 * self.material.shear_modulus_MPa)
        means = -np.log(_det(self.deformation(unknowns))).mean(axis=1)
        corners = self.nodes[:, :3].ravel()
        return np.asarray(np.bincount(corners, np.repeat(means, 3)) / np.bincount(corners))

    def forces(self, unknowns: FloatArray) -> FloatArray:
        """Return the energy's derivative with respect to every unknown: forces in N/mm, then area residuals in mm²."""
        state = self._state(unknowns)
        xx, zz, xz = np.moveaxis(state.stress, -1, 0)
        stress = np.stack([xx, xz, xz, zz], axis=-1).reshape(*xx.shape, 2, 2) * self.weights[..., None, None]
        local = np.einsum("eqaj,eqij->eai", state.gradients, stress, optimize=True).reshape(len(self.nodes), 12)
        if self.has_pressure:
            residual = state.area - 1.0 - self.material.compliance_per_MPa * state.pressure
            local = np.hstack([local, (residual * self.weights) @ self._linear])
        assembled = np.bincount(self._dofs.ravel(), weights=local.ravel(), minlength=self.unknown_count)
        return np.asarray(assembled, dtype=float)

    def tangent(self, unknowns: FloatArray) -> Any:
        """Return the second derivative of the energy with respect to all unknowns: a symmetric sparse matrix."""
        from scipy.sparse import csc_array

        local = self._local_tangent(self._state(unknowns))
        order, starts, rows, column_starts = self._sparsity
        data = np.add.reduceat(local.ravel()[order], starts)
        return csc_array((data, rows, column_starts), shape=(self.unknown_count, self.unknown_count))

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
        tractions = np.stack([dx * xx[..., None] + dz * xz[..., None], dx * xz[..., None] + dz * zz[..., None]], axis=2)
        gradients = state.gradients.transpose(0, 1, 3, 2).reshape(elements, points * 2, 6)
        geometric = gradients.transpose(0, 2, 1) @ tractions.reshape(elements, points * 2, 6)
        local[:, 0::2, 0::2] += geometric
        local[:, 1::2, 1::2] += geometric
        return self._with_pressure(local, state) if self.has_pressure else local

    def _moduli(self, state: _State) -> FloatArray:
        """Return the moduli (elements, points, 3, 3) from strains xx, zz, 2 xz to Kirchhoff stress."""
        principal = state.principal
        mean, half = principal.stress.sum(axis=-1) / 2, (principal.stress[..., 0] - principal.stress[..., 1]) / 2
        slopes = self.material.slopes(self.plane, principal.first, principal.second)
        a, b, d = slopes[..., 0, 0], slopes[..., 0, 1], slopes[..., 1, 1]
        areal, mixed, deviatoric = (a + 2 * b + d) / 4, (a - d) / 4, (a - 2 * b + d) / 4
        pressure = state.pressure * state.area
        difference = principal.first - principal.second
        equal = np.abs(difference) < MIN_STRAIN_DIFFERENCE
        shear = np.where(equal, deviatoric, half / np.tanh(np.where(equal, 1.0, difference))) - mean
        area, stretch, rotation = _strain_directions(principal)
        moduli = _dyad(areal - mean + pressure, area, area) + _dyad(deviatoric - mean, stretch, stretch)
        moduli += _dyad(mixed - half, area, stretch) + _dyad(mixed - half, stretch, area)
        moduli += _dyad(shear, rotation, rotation)
        return moduli - pressure[..., None, None] * np.diag([2.0, 2.0, 1.0])

    def _with_pressure(self, local: FloatArray, state: _State) -> FloatArray:
        """Return the tangent with the rows and columns of the pressures appended."""
        tangent = np.zeros((len(local), 15, 15))
        tangent[:, :12, :12] = local
        areas = np.einsum("eq,qp,eqai->epai", state.area * self.weights, self._linear, state.gradients, optimize=True)
        tangent[:, 12:, :12] = areas.reshape(len(local), 3, 12)
        tangent[:, :12, 12:] = tangent[:, 12:, :12].transpose(0, 2, 1)
        mass = np.einsum("eq,qp,qr->epr", self.weights, self._linear, self._linear, optimize=True)
        tangent[:, 12:, 12:] = -self.material.compliance_per_MPa * mass
        return tangent

    @cached_property
    def _sparsity(self) -> tuple[IndexArray, IndexArray, IndexArray, IndexArray]:
        """Order that groups local entries by matrix entry, start and row of each group, first group of each column."""
        rows = np.repeat(self._dofs[:, :, None], self._dofs.shape[1], axis=2).ravel()
        columns = np.repeat(self._dofs[:, None, :], self._dofs.shape[1], axis=1).ravel()
        order = np.lexsort((rows, columns))
        key = columns[order] * self.unknown_count + rows[order]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        column_starts = np.searchsorted(columns[order][starts], np.arange(self.unknown_count + 1))
        return order, starts, rows[order][starts], column_starts


def _strain_directions(principal: _Principal) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return three unit strains (…, 3), each xx, zz, 2 xz: equal, opposite, and shear in the principal directions."""
    cos, sin = principal.cos, principal.sin
    return (
        np.stack([np.ones_like(cos), np.ones_like(cos), np.zeros_like(cos)], axis=-1),
        np.stack([cos, -cos, sin], axis=-1),
        np.stack([-sin, sin, cos], axis=-1),
    )


def _dyad(factor: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(factor[..., None, None] * left[..., :, None] * right[..., None, :])


def _det(f: FloatArray) -> FloatArray:
    return np.asarray(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])
