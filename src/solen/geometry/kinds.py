"""Kinds of bodies, by the name that a design gives them in ``body.kind``.

A new kind is a function that builds its body from a design, or that makes a drawing from numbers, `drawn_kind`. Another
package adds it by an entry point of ``solen.body_kinds``, a script by its name::

    register("cross", BodyKind(cross_body, unused_keys={"body": ("file", "units", "join_mm")}))

Everything that depends on the kind asks this registry: how the body is built, and whether solen cuts its lens.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from solen import registry
from solen.errors import DesignError
from solen.geometry.body import Body
from solen.geometry.drawing import Drawing
from solen.geometry.outline import drawn_body, outline_body
from solen.geometry.y import y_body
from solen.lens import Lens
from solen.spec import Design
from solen.spec.body import UNUSED_KEYS, Keys


@dataclass(frozen=True)
class BodyKind:
    """One kind of body.

    Attributes
    ----------
    build
        Checked body of a design with its lens in the motion's state at an angle in degrees; `DesignError` if it
        cannot be. The lens is None if it is drawn.
    unused_keys
        Keys of the design that have no meaning for this kind, by table.
    lens_is_drawn
        Whether the lens is part of the body's own drawing, so that solen computes none.
    parameters
        Names and defaults of the numbers that a design may state in ``[body.parameters]``.
    """

    build: Callable[[Design, Lens | None, float], Body]
    unused_keys: Keys
    lens_is_drawn: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)

    def numbers(self, design: Design) -> dict[str, float]:
        """Parameters of a design's body, stated or by default; `DesignError` for a name that the kind lacks."""
        stated = design.body.parameters.values if design.body.parameters else {}
        for name in stated:
            if name not in self.parameters:
                remedy = f"the keys here are {', '.join(self.parameters) or 'none'}"
                raise DesignError(f"body.parameters.{name}", limit="unknown key", remedy=remedy)
        return dict(self.parameters) | stated


def drawn_kind(draw: Callable[[Mapping[str, float]], Drawing], parameters: Mapping[str, float]) -> BodyKind:
    """Kind of body that a function draws from its parameters, in mm, its lens with it.

    The drawing has closed strokes, one emitter and perhaps a pivot; names of strokes say what the faces are, as in a
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
        raise AssertionError("a Y has a lens, if only a flat face")
    return y_body(design, lens, angle_deg)


BODY_KINDS: registry.Registry[BodyKind] = registry.Registry(
    registry.BODY_KINDS,
    {
        "y": BodyKind(_y, UNUSED_KEYS["y"]),
        "outline": BodyKind(
            lambda design, _, angle_deg: outline_body(design, angle_deg), UNUSED_KEYS["outline"], lens_is_drawn=True
        ),
    },
    BodyKind,
)


def register(name: str, kind: BodyKind) -> None:
    """Make a kind of body known under a name, to designs as well."""
    BODY_KINDS.own[name] = kind
    UNUSED_KEYS[name] = kind.unused_keys


def body_of(design: Design, lens: Lens | None, angle_deg: float = 0.0) -> Body:
    """Checked body of a design in the motion's state at ``angle_deg``, by its kind; errors as of its builder."""
    kind = BODY_KINDS[design.body.kind]
    kind.numbers(design)  # refuses a parameter that the kind does not have
    return kind.build(design, lens, angle_deg)
