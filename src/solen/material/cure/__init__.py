"""Cure: how deep light hardens a resin, and what dose the parts of a print receive.

`solen.material.cure.curve` fits the working curve, `solen.material.cure.layers` says what it means for a print in
layers, `solen.material.cure.colour` finds the penetration depth from an absorbance, `solen.material.cure.stated` turns
statements of the kind "200 µm at 39 mJ/cm²" into bounds.
"""
