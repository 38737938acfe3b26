"""solen: from the index of a resin to the response curve of a 3D-printed soft optical sensor.

Axes and units, everywhere: x is lateral (right is +x), z runs along the undeformed optical axis from the lens vertex
into the body, y is out of plane; the undeformed lens vertex is the origin. Lengths are mm, wavelengths nm, angles
degrees, counter-clockwise with z up and x to the right, so a turn by -3 deg brightens the right receiver. Powers are
fractions of the emitted power.
"""

__version__ = "0.1.0"
