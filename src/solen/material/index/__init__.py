"""The index of a printed layer: n and k with uncertainty from spectrophotometer or refractometer measurements.

An index is never computed from data that contain no information about it. Each method of determining an index is a
named route with documented assumptions; values that a route cannot determine are masked, with the reason. Wavelengths
are in nm and thicknesses in µm; reflectance and transmittance are fractions; arrays may have any shapes that broadcast.

`index_of_layer` converts a recording to a `LayerIndex`. It uses the forward model in `solen.material.index.stack`; its
exact inverse, in `solen.material.index.inversion` for a layer in air and in `solen.material.index.substrate` for a
layer on a substrate; the readings with their errors in `solen.material.index.reading`; the routes to an `IndexSpectrum`
in `solen.material.index.routes`; and the reasons for masking a value in `solen.material.index.masks`.
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
