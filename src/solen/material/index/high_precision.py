"""Forward model of a layer in air, and its inverse, at one wavelength: the published formulas, with fifty digits.

With fifty digits, rounding errors are negligible; the code is not optimised for speed. `forward` in
`solen.material.index.stack` and `solen.material.index.inversion` are tested against it.
"""

from decimal import Decimal, localcontext

DIGITS = 50
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803")

Number = Decimal | float


def layer(n: Number, k: Number, thickness_um: Number, wavelength_nm: Number) -> tuple[Decimal, Decimal]:
    """Return R and T of a layer with n and k, summed over all passes."""
    with localcontext(prec=DIGITS):
        n, k, h, wavelength = Decimal(n), Decimal(k), 1000 * Decimal(thickness_um), Decimal(wavelength_nm)
        face = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
        tau = (-4 * PI * k * h / wavelength).exp()
        transmittance = (1 - face) ** 2 * tau / (1 - face**2 * tau**2)
        return face + face * tau * transmittance, transmittance


def index(
    reflectance: Number, transmittance: Number, thickness_um: Number, wavelength_nm: Number
) -> tuple[Decimal, Decimal]:
    """Return n and k of a layer with R and T, from the formulas as published by Nichelatti (2002) and in the paper.

    Raises
    ------
    ArithmeticError
        If a logarithm or a root has no value.
    """
    with localcontext(prec=DIGITS):
        r, t = Decimal(reflectance), Decimal(transmittance)
        h, wavelength = 1000 * Decimal(thickness_um), Decimal(wavelength_nm)
        b = 2 + t**2 - (1 - r) ** 2
        face = (b - (b**2 - 4 * r * (2 - r)).sqrt()) / (2 * (2 - r))
        k = wavelength / (4 * PI * h) * (face * t / (r - face)).ln()
        n = (1 + face) / (1 - face) + (4 * face / (1 - face) ** 2 - k**2).sqrt()
        return n, k
