"""Homogeneous deformations of an incompressible specimen, each described by a single stretch λ.

In every test of this kind, the three principal stretches are powers of one stretch, λᵢ = λ^cᵢ with Σ cᵢ = 0. The
engineering stress is the derivative of the energy per reference volume W with respect to λ, divided by the number of
loaded directions: P = (dW/dλ)/m. Compression is the uniaxial mode with λ below 1.

`MODES` contains the modes, keyed by name; `Mode.principal` computes the stretches, and `Mode.slope_ratio` is the ratio
of the initial slope of the engineering stress to Young's modulus.
"""

from dataclasses import dataclass
from typing import Literal

from solen.arrays import FloatArray


@dataclass(frozen=True)
class Mode:
    """One mode of deformation.

    Attributes
    ----------
    name
        ``uniaxial``, ``planar`` (pure shear) or ``equibiaxial``.
    powers
        Exponents cᵢ of λᵢ = λ^cᵢ.
    directions
        Number m of directions that are loaded with the same stress.
    """

    name: Literal["uniaxial", "planar", "equibiaxial"]
    powers: tuple[float, float, float]
    directions: int

    def principal(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the three principal stretches, each with the shape of ``stretch``."""
        first, second, third = (stretch**power for power in self.powers)
        return first, second, third

    @property
    def slope_ratio(self) -> float:
        """Ratio of the initial slope of engineering stress against stretch to Young's modulus.

        From W ≈ μ Σ (ln λᵢ)² and E = 3μ, it is 2 Σ cᵢ²/(3 m): 1 (uniaxial), 4/3 (planar), 2 (equibiaxial).
        """
        return 2 * sum(power**2 for power in self.powers) / (3 * self.directions)


UNIAXIAL = Mode("uniaxial", (1.0, -0.5, -0.5), 1)
PLANAR = Mode("planar", (1.0, 0.0, -1.0), 1)
EQUIBIAXIAL = Mode("equibiaxial", (1.0, 1.0, -2.0), 2)
MODES: dict[str, Mode] = {mode.name: mode for mode in (UNIAXIAL, PLANAR, EQUIBIAXIAL)}
TestMode = Literal["tension", "compression", "uniaxial", "planar", "equibiaxial"]
"""Modes of a test; tension and compression are uniaxial, and ``uniaxial`` includes both, by the signs in the file."""
