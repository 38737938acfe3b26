"""The accuracy of each method for the index: the uncertainty of n at 860 nm of a clear resin.

A resin with n = 1.48 is measured by R and T of a free-standing layer, by R and T or only T of a layer on PET film, or
with a refractometer. Each method has typical errors, which solen propagates to n.
"""

import numpy as np

from solen.material.index import Length, forward, lossless, measured, reading
from solen.material.index.refractometer import refractometer
from solen.material.index.stack import Setup, Substrate, on_substrate

NM, N, K, LAYER_UM, PET, PET_UM = 860.0, 1.48, 1e-4, 25.0, 1.57, 100.0
U_T = 1e-3


def free_standing(u_r: float) -> float:
    """Return the uncertainty of n from R and T of the layer alone."""
    r, t = forward(N, K, LAYER_UM, NM)
    return float(measured([NM], reading([t], U_T), reading([r], u_r), Length(LAYER_UM)).n.u[0])


def on_pet(u_pet: float, *, both: bool = True) -> float:
    """Return the uncertainty of n from R and T of the layer on PET, or from T of a clear layer relative to bare PET."""
    film = Substrate(PET, 0.0, PET_UM, u_n=u_pet)
    t, r = on_substrate(N, K if both else 0.0, LAYER_UM, NM, Setup(film))
    if both:
        spectrum = measured([NM], reading([t], U_T), reading([r], 1e-3), Length(LAYER_UM), Setup(film))
    else:
        spectrum = lossless([NM], reading([t], U_T), Setup(film))
    return float(spectrum.n.u[0])


def by_refractometer(*wavelength_nm: float) -> float:
    """Return the uncertainty of n from values known to 0.0005, and the typical dispersion of polymers."""
    n = 1.4733 + 0.0045 / (np.array(wavelength_nm) * 1e-3) ** 2
    return float(refractometer(n, 5e-4, wavelength_nm).fit.indices(NM)[1][0])


def main() -> dict[str, float]:
    """Return the standard uncertainty of n at 860 nm, keyed by method."""
    results = {
        "free layer, R to 0.001": free_standing(1e-3),
        "free layer, R to 0.003": free_standing(3e-3),
        "on PET known to 0.01": on_pet(0.01),
        "on PET known to 0.04": on_pet(0.04),
        "on PET, T alone": on_pet(0.01, both=False),
        "refractometer, one wavelength": by_refractometer(589.3),
        "refractometer, three": by_refractometer(450.0, 589.3, 860.0),
    }
    print("simulated, n = 1.48 at 860 nm")
    for name, u in results.items():
        print(f"  {name:30} u(n) = {u:.4f}")
    return results


if __name__ == "__main__":
    main()
