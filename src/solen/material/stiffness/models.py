"""Hyperelastic models of an incompressible, isotropic solid: energy, stress, and the exact derivatives of both.

A model is an energy per reference volume W as a function of the principal stretches, with λ₁λ₂λ₃ = 1. All other
quantities are derivatives of it: the engineering stress of a test in its mode (`solen.material.stiffness.modes`), the
derivatives of the stress with respect to the parameters (for the fit), and the matrix of second derivatives with
respect to the logarithmic strains (for stability).

- `Polynomial`: W = Σ C_ij (I₁ − 3)^i (I₂ − 3)^j: neo-Hookean (C10), Mooney-Rivlin (C10, C01; Mooney 1940, Rivlin 1948)
  and Yeoh (C10, C20, C30; Yeoh 1993). Linear in its parameters.
- `Ogden`: W = Σ μ_p/α_p (λ₁^α_p + λ₂^α_p + λ₃^α_p − 3) (Ogden 1972). Linear in μ_p, not in α_p.

The interface is `model(kind)`, with one of the `KINDS`; parameters are an array in the order of `Model.names`, stresses
are in MPa.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.material.stiffness.modes import Mode


class Model(ABC):
    """An energy function with the names of its parameters."""

    kind: str

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, with their units."""

    @abstractmethod
    def energy(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return W in MPa (= mJ/mm³) for the principal stretches λ₁ and λ₂, with λ₃ = 1/(λ₁λ₂)."""

    @abstractmethod
    def gradient(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return ∂W/∂ln λ₁ and ∂W/∂ln λ₂ in MPa, (stretches, 2): the first two Kirchhoff stresses minus the third."""

    @abstractmethod
    def stress(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:
        """Return the engineering stress in MPa at each stretch."""

    @abstractmethod
    def jacobian(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:
        """Return the derivatives of `stress` with respect to the parameters: (stretches, parameters)."""

    @abstractmethod
    def hessian(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return the second derivatives of W by ln λ₁ and ln λ₂ in MPa, (stretches, 2, 2)."""

    @abstractmethod
    def shear_modulus_row(self, parameters: ArrayLike) -> tuple[float, FloatArray]:
        """Return the initial shear modulus μ₀ in MPa, and its derivatives with respect to the parameters."""


@dataclass(frozen=True)
class Polynomial(Model):
    """A polynomial in the invariants.

    Attributes
    ----------
    kind
        Name of the model.
    terms
        Powers (i, j) of (I₁ − 3) and (I₂ − 3), one pair per parameter C_ij.
    """

    kind: str
    terms: tuple[tuple[int, int], ...]

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(f"C{i}{j}_MPa" for i, j in self.terms)

    def energy(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        a, b = _invariants((first, second, 1 / (first * second)))
        energy = np.zeros_like(a)
        for c, (i, j) in zip(np.asarray(parameters), self.terms, strict=True):
            energy += c * a**i * b**j
        return energy

    def gradient(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        squares = np.stack([first, second, 1 / (first * second)]) ** 2
        a, b = _invariants((first, second, 1 / (first * second)))
        by_a, by_b = _gradient(squares, 1), _gradient(1 / squares, -1)
        slopes = np.zeros((*a.shape, 2))
        for c, (i, j) in zip(np.asarray(parameters), self.terms, strict=True):
            slopes += c * (_power(a, i, 1) * b**j)[..., None] * by_a + c * (a**i * _power(b, j, 1))[..., None] * by_b
        return slopes

    def stress(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:  # noqa: D102
        return np.asarray(self.jacobian(parameters, mode, stretch) @ np.asarray(parameters, dtype=float))

    def jacobian(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:  # noqa: ARG002, D102
        a, b = _invariants(mode.principal(stretch))
        slope_a = sum(2 * c * stretch ** (2 * c - 1) for c in mode.powers) / mode.directions
        slope_b = sum(-2 * c * stretch ** (-2 * c - 1) for c in mode.powers) / mode.directions
        columns = [_power(a, i, 1) * b**j * slope_a + a**i * _power(b, j, 1) * slope_b for i, j in self.terms]
        return np.stack(columns, axis=-1)

    def hessian(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        squares = np.stack([first, second, 1 / (first * second)]) ** 2
        a, b = _invariants((first, second, 1 / (first * second)))
        by_a, by_b = _gradient(squares, 1), _gradient(1 / squares, -1)
        curvature_a, curvature_b = _curvature(squares), _curvature(1 / squares)
        matrix = np.zeros((*a.shape, 2, 2))
        for c, (i, j) in zip(np.asarray(parameters), self.terms, strict=True):
            matrix += c * _times(_power(a, i, 1) * b**j, curvature_a)
            matrix += c * _times(a**i * _power(b, j, 1), curvature_b)
            matrix += c * _times(_power(a, i, 2) * b**j, _outer(by_a, by_a))
            matrix += c * _times(a**i * _power(b, j, 2), _outer(by_b, by_b))
            matrix += c * _times(_power(a, i, 1) * _power(b, j, 1), _outer(by_a, by_b) + _outer(by_b, by_a))
        return matrix

    def shear_modulus_row(self, parameters: ArrayLike) -> tuple[float, FloatArray]:  # noqa: D102
        row = np.array([2.0 if i + j == 1 else 0.0 for i, j in self.terms])
        return float(row @ np.asarray(parameters)), row


@dataclass(frozen=True)
class Ogden(Model):
    """Ogden's sum of powers of the principal stretches, with parameters μ₁ … μ_N in MPa and α₁ … α_N."""

    order: int

    @property
    def kind(self) -> str:  # type: ignore[override]
        """Name of the model."""
        return f"ogden-{self.order}"

    @property
    def names(self) -> tuple[str, ...]:  # noqa: D102
        numbers = range(1, self.order + 1)
        return tuple(f"mu{p}_MPa" for p in numbers) + tuple(f"alpha{p}" for p in numbers)

    def split(self, parameters: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the moduli μ_p in MPa, and the powers α_p."""
        array = np.asarray(parameters, dtype=float)
        return array[: self.order], array[self.order :]

    def energy(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        third = 1 / (first * second)
        energy = np.zeros_like(third)
        for modulus, power in zip(*self.split(parameters), strict=True):
            energy += modulus / power * (first**power + second**power + third**power - 3)
        return energy

    def gradient(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        third = 1 / (first * second)
        slopes = np.zeros((*third.shape, 2))
        for modulus, power in zip(*self.split(parameters), strict=True):
            slopes += modulus * np.stack([first**power - third**power, second**power - third**power], axis=-1)
        return slopes

    def stress(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:  # noqa: D102
        moduli, powers = self.split(parameters)
        return np.asarray(ogden_basis(powers, mode, stretch) @ moduli)

    def jacobian(self, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:  # noqa: D102
        moduli, powers = self.split(parameters)
        logarithm = np.log(stretch)[:, None]
        by_power = sum(c**2 * logarithm * stretch[:, None] ** (c * powers - 1) / mode.directions for c in mode.powers)
        return np.hstack([ogden_basis(powers, mode, stretch), moduli * by_power])

    def hessian(self, parameters: ArrayLike, first: FloatArray, second: FloatArray) -> FloatArray:  # noqa: D102
        stretches = np.stack([first, second, 1 / (first * second)])
        matrix = np.zeros((*first.shape, 2, 2))
        for modulus, power in zip(*self.split(parameters), strict=True):
            matrix += modulus / 4 * power * _curvature(stretches**power)
        return matrix

    def shear_modulus_row(self, parameters: ArrayLike) -> tuple[float, FloatArray]:  # noqa: D102
        moduli, powers = self.split(parameters)
        return float(moduli @ powers) / 2, np.concatenate([powers, moduli]) / 2


def ogden_basis(powers: FloatArray, mode: Mode, stretch: FloatArray) -> FloatArray:
    """Return the engineering stress of each of Ogden's terms for μ = 1, (stretches, terms)."""
    terms = [c * stretch[:, None] ** (c * powers - 1) for c in mode.powers]
    return np.asarray(sum(terms) / mode.directions, dtype=float)


Kind = Literal["neo-hookean", "mooney-rivlin", "yeoh", "ogden-1", "ogden-2", "ogden-3"]
KINDS: dict[str, Model] = {
    "neo-hookean": Polynomial("neo-hookean", ((1, 0),)),
    "mooney-rivlin": Polynomial("mooney-rivlin", ((1, 0), (0, 1))),
    "yeoh": Polynomial("yeoh", ((1, 0), (2, 0), (3, 0))),
    "ogden-1": Ogden(1),
    "ogden-2": Ogden(2),
    "ogden-3": Ogden(3),
}


def model(kind: str) -> Model:
    """Return the model of a kind; raise `SpecError` if there is none."""
    if kind not in KINDS:
        raise SpecError("fit", value=kind, limit=f"must be one of {', '.join(KINDS)}")
    return KINDS[kind]


def _invariants(stretches: tuple[FloatArray, FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return I₁ − 3 and I₂ − 3; negative values due to rounding are set to 0, so that their powers are real."""
    squares = np.stack(stretches) ** 2
    return np.maximum(squares.sum(axis=0) - 3, 0.0), np.maximum((1 / squares).sum(axis=0) - 3, 0.0)


def _power(base: FloatArray, exponent: int, order: int) -> FloatArray:
    """Return the derivative of base^exponent of the given order."""
    factor = 1.0
    for k in range(order):
        factor *= exponent - k
    return np.zeros_like(base) if factor == 0 else factor * base ** (exponent - order)


def _gradient(squares: FloatArray, sign: int) -> FloatArray:
    """Return the derivatives of Σ λᵢ² (sign 1) or Σ λᵢ⁻² (sign −1) by ln λ₁ and ln λ₂, from its terms: (…, 2)."""
    return np.stack([2 * sign * (squares[0] - squares[2]), 2 * sign * (squares[1] - squares[2])], axis=-1)


def _curvature(squares: FloatArray) -> FloatArray:
    """Return the second derivatives of Σ λᵢ² or Σ λᵢ⁻² by ln λ₁ and ln λ₂, from its terms: (…, 2, 2)."""
    cross = 4 * squares[2]
    rows = [[4 * squares[0] + cross, cross], [cross, 4 * squares[1] + cross]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _times(factor: FloatArray, matrix: FloatArray) -> FloatArray:
    return factor[..., None, None] * matrix


def _outer(left: FloatArray, right: FloatArray) -> FloatArray:
    return left[..., :, None] * right[..., None, :]
