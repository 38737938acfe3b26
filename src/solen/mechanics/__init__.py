"""Soft bodies under load, computed by finite elements from the body, material, supports and loads.

The exact outline is meshed once, and each combination of loads gives one state of a soft body. Only
`solen.mechanics.design` depends on design files and on the optical walls.

Example::

    soft = SoftBody(body, Material.neo_hookean(1.0), (Hold((Stretch("receiver-*"),)),), thickness_mm=4.0)
    states = soft.states([[Turn((Stretch("lens"),), (0.0, 2.0), angle)] for angle in angles])

`SoftBody.states` takes the loads of every state, in the order in which the body passes through the states, and returns
a `Deformed` for each; `SoftBody.state` does so for a single state.
"""

from solen.mechanics.deformed import Contact, Deformed, Picture, Reaction, Wall
from solen.mechanics.load import Hold, HoldKind, Load, Press, Pull, Stretch, Turn
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import MeshOptions
from solen.mechanics.soft_body import SoftBody

__all__ = [
    "Contact",
    "Deformed",
    "Hold",
    "HoldKind",
    "Load",
    "Material",
    "MeshOptions",
    "Picture",
    "Plane",
    "Press",
    "Pull",
    "Reaction",
    "SoftBody",
    "Stretch",
    "Turn",
    "Wall",
]
