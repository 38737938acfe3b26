"""Optical data of materials: refractive index with its uncertainty, and loss, for a resin at a wavelength.

`solen.material.dispersion` defines the forms of an index; `solen.material.resin` reads resin files and the library, and
computes the optical data.
"""

from solen.material.dispersion import KINDS, Cauchy, Constant, Dispersion, Sellmeier, Tabulated
from solen.material.resin import Loss, Optical, Resin, library, library_resin, load_resin, optical

__all__ = [
    "KINDS",
    "Cauchy",
    "Constant",
    "Dispersion",
    "Loss",
    "Optical",
    "Resin",
    "Sellmeier",
    "Tabulated",
    "library",
    "library_resin",
    "load_resin",
    "optical",
]
