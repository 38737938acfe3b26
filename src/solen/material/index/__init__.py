"""The index of a printed layer: from what a spectrophotometer or a refractometer measured to n and k with uncertainty.

The idea: an index is never read off a curve that carries no information about it. Each way to an index is a route with
a name, states what it assumes, and masks with a reason what it cannot tell. Wavelengths are in nm, thicknesses in µm,
reflectance and transmittance are fractions; arrays of any shapes that broadcast.

`solen.material.index.slab` is the forward model of a free-standing layer and `solen.material.index.inversion` its exact
inverse, both tested against `solen.material.index.reference` at fifty digits; `solen.material.index.reading` holds what
was measured and what is known of its errors, `solen.material.index.routes` the ways to an `IndexSpectrum`, and
`solen.material.index.masks` the reasons why a value is not told.
"""

from solen.material.index.inversion import Inverted, invert, invert_many, slopes
from solen.material.index.reading import Length, Reading, reading
from solen.material.index.routes import absorptance, as_published, is_absorbance, lossless, measured
from solen.material.index.slab import forward, fringe_spacing_nm
from solen.material.index.spectrum import Estimate, IndexSpectrum

__all__ = [
    "Estimate",
    "IndexSpectrum",
    "Inverted",
    "Length",
    "Reading",
    "absorptance",
    "as_published",
    "forward",
    "fringe_spacing_nm",
    "invert",
    "invert_many",
    "is_absorbance",
    "lossless",
    "measured",
    "reading",
    "slopes",
]
