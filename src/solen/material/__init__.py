"""Materials: from the name of a resin and a wavelength to an index with its uncertainty, and a loss.

`solen.material.dispersion` holds the kinds of index, `solen.material.resin` the files, the library and `optical`.
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
