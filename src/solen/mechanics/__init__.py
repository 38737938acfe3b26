"""Soft bodies under load, by finite elements: body, material, what holds it and what loads it -> the deformed body.

The idea: the exact outline is meshed once; every load is a state of one soft body. `solen.mechanics.design` alone knows
design files, and the walls that light meets.

The interface::

    soft = SoftBody(body, Material.neo_hookean(1.0), (Hold((Stretch("receiver-*"),)),), thickness_mm=4.0)
    states = soft.states([[Turn((Stretch("lens"),), (0.0, 2.0), angle)] for angle in angles])

`SoftBody.states` takes the loads of each state, in the order in which the body passes through them, and gives a
`Deformed` for each; `SoftBody.state` takes those of one.
"""

from solen.mechanics.deformed import Contact, Deformed, Picture, Reaction, Wall
from solen.mechanics.load import Hold, HoldKind, Load, Press, Pull, Stretch, Turn
from solen.mechanics.material import Material, Plane
from solen.mechanics.mesh import MeshOptions
from solen.mechanics.soft import SoftBody

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
