"""Scenes of ray-optics (ricktu288/ray-optics, JSON version 5) as scenes of solen.

A file lists objects that may overlap. Here each object becomes exact curves, and the plane that the curves divide
becomes regions and interfaces (`arrangement`). Sources become exactly the rays that ray-optics launches, detectors
become monitors, and unsupported content is listed with the reason.

`load` and `loads` return an `Imported`; `recognised` indicates whether parsed JSON is such a file. Formulas in curves
and modules are read by `solen.scene.rayoptics.formula`, which executes nothing.
"""

from solen.scene.rayoptics.facets import Facets
from solen.scene.rayoptics.fields import NotUnderstood
from solen.scene.rayoptics.importer import Imported, load, loads, recognised

__all__ = ["Facets", "Imported", "NotUnderstood", "load", "loads", "recognised"]
