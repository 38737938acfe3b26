"""How a soft material resists: the hyperelastic models that `solen resin stiffness` fits, in a plane."""

from dataclasses import dataclass
from typing import Literal

from solen.errors import DesignError
from solen.material.stiffness.models import model

Plane = Literal["strain", "stress"]
"""``strain``: nothing moves along y, as far inside a thick body. ``stress``: free to move along y, as in a thin one."""

LEAST_POISSON = 0.4
"""The models are those of solids that keep their volume: nearly so at least."""


@dataclass(frozen=True)
class Material:
    """A soft solid.

    Attributes
    ----------
    kind
        A hyperelastic model: ``neo-hookean``, ``mooney-rivlin``, ``yeoh``, ``ogden-1`` to ``ogden-3``.
    parameters
        Of the model, in the order of its names.
    poisson
        Poisson's ratio at small strain, 0.4 to 0.5; 0.5 keeps every volume. Plane stress takes 0.5.
    """

    kind: str
    parameters: tuple[float, ...]
    poisson: float = 0.5

    def __post_init__(self) -> None:
        names = model(self.kind).names
        if len(self.parameters) != len(names):
            raise DesignError("material.parameters", value=self.parameters, limit=f"{self.kind} takes {len(names)}")
        if not LEAST_POISSON <= self.poisson <= 0.5:
            limit = f"must be from {LEAST_POISSON} to 0.5: the models are those of rubbers, which keep their volume"
            raise DesignError("material.poisson", value=self.poisson, limit=limit)
        if not self.shear_modulus_MPa > 0.0:
            raise DesignError("material.shear_modulus_MPa", value=self.shear_modulus_MPa, limit="must be above 0")

    @classmethod
    def neo_hookean(cls, shear_modulus_MPa: float, poisson: float = 0.5) -> "Material":
        """Of a shear modulus alone: E / (2 (1 + ν)) of Young's modulus E, a third of it at ν = 0.5."""
        return cls("neo-hookean", (0.5 * shear_modulus_MPa,), poisson)

    @property
    def shear_modulus_MPa(self) -> float:
        """Initial shear modulus."""
        return model(self.kind).shear_modulus_row(self.parameters)[0]
