"""The design file: the user's choices for a sensor, validated and frozen before anything is computed.

`solen.spec.design` defines `Design`; other modules define its tables. `solen.spec.toml` reads and writes design files,
`solen.spec.template` provides the shipped designs, and `solen.spec.strict` validates all of solen's TOML files.
"""

from solen.spec.body import Body, Lens, Material, Receivers
from solen.spec.design import Design, Trace
from solen.spec.light import Emitter
from solen.spec.motion import Join, Motion
from solen.spec.template import NewDesign, template, template_names
from solen.spec.toml import dumps, json_schema, load, loads, parse_assignment, save, value_at, with_values
from solen.spec.wall import Wall

__all__ = [
    "Body",
    "Design",
    "Emitter",
    "Join",
    "Lens",
    "Material",
    "Motion",
    "NewDesign",
    "Receivers",
    "Trace",
    "Wall",
    "dumps",
    "json_schema",
    "load",
    "loads",
    "parse_assignment",
    "save",
    "template",
    "template_names",
    "value_at",
    "with_values",
]
