"""Body kinds, selected by ``body.kind`` of a design.

A new kind is a function that builds a body from a design, or (with `drawn_kind`) a function that draws it from numbers.
Another package adds a kind as an entry point in the group ``solen.body_kinds``; a script calls `register`::

    register("cross", BodyKind(cross_body, unused_keys={"body": ("file", "units", "join_mm")}))

This registry defines everything that depends on the kind: how the body is built, and whether solen computes its lens.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from solen import registry
from solen.errors import DesignError
from solen.geometry.body import Body
from solen.geometry.drawing import Drawing
from solen.geometry.network import network_body
from solen.geometry.outline import drawn_body, outline_body
from solen.geometry.y import y_body
from solen.lens import Lens
from solen.spec import Design
from solen.spec.body import UNUSED_KEYS, Keys


@dataclass(frozen=True)
class BodyKind:
    """A kind of body.

    Attributes
    ----------
    build
        Function that returns the checked body of a design with its lens, moved to an angle in degrees, and raises
        `DesignError` if the body cannot be built. The lens is None if it is drawn.
    unused_keys
        Design keys that do not apply to this kind, keyed by table.
    lens_is_drawn
        Whether the lenses are parts of the body, as in a drawing or a network, rather than one computed lens in front
        of it.
    parameters
        Names and defaults of the parameters in ``[body.parameters]``.
    """

    build: Callable[[Design, Lens | None, float], Body]
    unused_keys: Keys
    lens_is_drawn: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)

    def numbers(self, design: Design) -> dict[str, float]:
        """Return the parameters of a design's body, specified or default; raise `DesignError` for an unknown name."""
        specified = design.body.parameters.values if design.body.parameters else {}
        for name in specified:
            if name not in self.parameters:
                remedy = f"the parameters of this kind are {', '.join(self.parameters) or 'none'}"
                raise DesignError(f"body.parameters.{name}", limit="unknown key", remedy=remedy)
        return dict(self.parameters) | specified


def drawn_kind(draw: Callable[[Mapping[str, float]], Drawing], parameters: Mapping[str, float]) -> BodyKind:
    """Return a kind of body that a function draws from its parameters, in mm, including the lens.

    The drawing consists of closed strokes, one emitter and optionally a pivot; stroke names define the faces, as in a
    file: ``wall``, ``lens``, ``receiver-right``, ``receiver-left``.
    """

    def build(design: Design, _lens: Lens | None, angle_deg: float) -> Body:
        return drawn_body(design, draw(kind.numbers(design)), angle_deg)

    outline = UNUSED_KEYS["outline"]
    unused = outline | {"body": (*(key for key in outline["body"] if key != "parameters"), "file", "units")}
    kind = BodyKind(build, unused, lens_is_drawn=True, parameters=parameters)
    return kind


def _y(design: Design, lens: Lens | None, angle_deg: float) -> Body:
    if lens is None:
        raise AssertionError("a Y-shaped body requires a lens or a flat face")
    return y_body(design, lens, angle_deg)


BODY_KINDS: registry.Registry[BodyKind] = registry.Registry(
    registry.BODY_KINDS,
    {
        "y": BodyKind(_y, UNUSED_KEYS["y"]),
        "outline": BodyKind(
            lambda design, _, angle_deg: outline_body(design, angle_deg), UNUSED_KEYS["outline"], lens_is_drawn=True
        ),
        "network": BodyKind(
            lambda design, _, angle_deg: network_body(design, angle_deg), UNUSED_KEYS["network"], lens_is_drawn=True
        ),
    },
    BodyKind,
)


def register(name: str, kind: BodyKind) -> None:
    """Register a body kind under a name."""
    BODY_KINDS.own[name] = kind
    UNUSED_KEYS[name] = kind.unused_keys


def body_of(design: Design, lens: Lens | None, angle_deg: float = 0.0) -> Body:
    """Return the checked body of a design moved to ``angle_deg``; raise the errors of its kind."""
    kind = BODY_KINDS[design.body.kind]
    kind.numbers(design)  # rejects a parameter that the kind does not have
    return kind.build(design, lens, angle_deg)
