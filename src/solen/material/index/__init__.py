"""The index of a printed layer: from what a spectrophotometer or a refractometer measured to n and k with uncertainty.

The idea: an index is never read off a curve that carries no information about it. Each way to an index is a route with
a name, states what it assumes, and masks with a reason what it cannot determine. Wavelengths are in nm, thicknesses in
µm, reflectance and transmittance are fractions; arrays of any shapes that broadcast.

The interface: `index_of_layer` goes from a recording to a `LayerIndex`. Behind it, `solen.material.index.stack` is the
forward model, `solen.material.index.inversion` its exact inverse for a layer in air and
`solen.material.index.substrate` that on a substrate; `solen.material.index.reading` holds what was measured and what is
known of its errors, `solen.material.index.routes` the ways to an `IndexSpectrum`, and `solen.material.index.masks` the
reasons why a value is masked.
"""

from solen.material.index.inversion import invert, invert_many, slopes
from solen.material.index.reading import Length, reading
from solen.material.index.routes import absorptance, as_published, lossless, measured
from solen.material.index.spectrum import IndexSpectrum
from solen.material.index.stack import forward

__all__ = [
    "IndexSpectrum",
    "Length",
    "absorptance",
    "as_published",
    "forward",
    "invert",
    "invert_many",
    "lossless",
    "measured",
    "reading",
    "slopes",
]
