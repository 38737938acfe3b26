"""The index of a printed layer: from what a spectrophotometer or a refractometer measured to n and k with uncertainty.

The idea: an index is never read off a curve that carries no information about it. Each way to an index is a route with
a name, states what it assumes, and masks with a reason what it cannot tell. Wavelengths are in nm, thicknesses in µm,
reflectance and transmittance are fractions; arrays of any shapes that broadcast.
"""
