"""Plane stress and plane strain of the hyperelastic models that `solen resin stiffness` fits.

The models are those of incompressible solids. In plane stress, the third stretch follows from the other two, and no
pressure is needed. In plane strain, the third stretch is 1; the energy depends on the other two, scaled to an area
ratio of 1, and a pressure constrains the area (`solen.mechanics.elements`). At small strain, this is exactly Hooke's
law with the same shear modulus and Poisson's ratio.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.material.stiffness.models import model

Plane = Literal["strain", "stress"]
"""``strain``: no displacement along y, as deep in a thick body; ``stress``: no stress along y, as in a thin body."""

MIN_COMPLIANCE = 1e-8
"""Smallest compliance to pressure of an incompressible material, relative to its shear compliance."""
OPPOSITE = np.array([1.0, -1.0])
MIN_POISSON = 0.4
"""Smallest Poisson's ratio, since the models are those of nearly incompressible solids."""


@dataclass(frozen=True)
class Material:
    """A soft solid.

    Attributes
    ----------
    kind
        A hyperelastic model: ``neo-hookean``, ``mooney-rivlin``, ``yeoh``, ``ogden-1`` to ``ogden-3``.
    parameters
        Parameters of the model, in the order of its names.
    poisson
        Poisson's ratio at small strain, 0.4 to 0.5 (incompressible). Plane stress requires 0.5.
    """

    kind: str
    parameters: tuple[float, ...]
    poisson: float = 0.5

    def __post_init__(self) -> None:
        names = model(self.kind).names
        if len(self.parameters) != len(names):
            limit = f"{self.kind} requires {len(names)} values"
            raise DesignError("material.parameters", value=self.parameters, limit=limit)
        if not MIN_POISSON <= self.poisson <= 0.5:
            limit = f"must be from {MIN_POISSON} to 0.5: the models are those of nearly incompressible rubbers"
            raise DesignError("mechanics.poisson", value=self.poisson, limit=limit)
        if not self.shear_modulus_MPa > 0.0:
            raise DesignError("material.shear_modulus_MPa", value=self.shear_modulus_MPa, limit="must be above 0")

    @classmethod
    def neo_hookean(cls, shear_modulus_MPa: float, poisson: float = 0.5) -> "Material":
        """Create a material from its shear modulus, E / (2 (1 + ν)) for a Young's modulus E."""
        return cls("neo-hookean", (0.5 * shear_modulus_MPa,), poisson)

    @property
    def shear_modulus_MPa(self) -> float:
        """Initial shear modulus."""
        return model(self.kind).shear_modulus_row(self.parameters)[0]

    @property
    def compliance_per_MPa(self) -> float:
        """Relative change of area per pressure in plane strain, (1 − 2ν)/μ, with a positive minimum for the solver."""
        return max(1.0 - 2.0 * self.poisson, MIN_COMPLIANCE) / self.shear_modulus_MPa

    def stresses(self, plane: Plane, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return Kirchhoff stresses (…, 2) in MPa at principal strains ln λ (…,); in plane strain, without pressure."""
        law = model(self.kind)
        if plane == "stress":
            return law.gradient(self.parameters, np.exp(first), np.exp(second))
        half = 0.5 * (first - second)
        slopes = law.gradient(self.parameters, np.exp(half), np.exp(-half))
        return np.asarray(0.5 * (slopes[..., :1] - slopes[..., 1:]) * OPPOSITE)

    def slopes(self, plane: Plane, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return derivatives (…, 2, 2) of `stresses` with respect to the principal strains."""
        law = model(self.kind)
        if plane == "stress":
            return law.hessian(self.parameters, np.exp(first), np.exp(second))
        half = 0.5 * (first - second)
        curves = law.hessian(self.parameters, np.exp(half), np.exp(-half))
        curve = 0.25 * (curves[..., 0, 0] - 2.0 * curves[..., 0, 1] + curves[..., 1, 1])
        return np.asarray(curve[..., None, None] * np.outer(OPPOSITE, OPPOSITE))
