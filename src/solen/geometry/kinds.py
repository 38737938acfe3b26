"""Kinds of bodies, by the name that a design gives them in ``body.kind``.

A new kind is a function that builds its body from a design, registered under its name::

    register("cross", BodyKind(cross_body, unused_keys={"body": ("file", "units", "join_mm")}))

Everything that depends on the kind asks this registry: how the body is built, and whether solen cuts its lens.
"""

from collections.abc import Callable
from dataclasses import dataclass

from solen.geometry.body import Body
from solen.geometry.outline import outline_body
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
        Checked body of a design with its lens in the motion's state at an angle in degrees; `DesignError` where it
        cannot be. The lens is None where it is drawn.
    unused_keys
        Keys of the design that have no meaning for this kind, by table.
    lens_is_drawn
        Whether the lens is part of the body's own drawing, so that solen computes none.
    """

    build: Callable[[Design, Lens | None, float], Body]
    unused_keys: Keys
    lens_is_drawn: bool = False


def _y(design: Design, lens: Lens | None, angle_deg: float) -> Body:
    if lens is None:
        raise AssertionError("a Y has a lens, if only a flat face")
    return y_body(design, lens, angle_deg)


BODY_KINDS: dict[str, BodyKind] = {
    "y": BodyKind(_y, UNUSED_KEYS["y"]),
    "outline": BodyKind(
        lambda design, _, angle_deg: outline_body(design, angle_deg), UNUSED_KEYS["outline"], lens_is_drawn=True
    ),
}


def register(name: str, kind: BodyKind) -> None:
    """Make a kind of body known under a name, to designs as well."""
    BODY_KINDS[name] = kind
    UNUSED_KEYS[name] = kind.unused_keys


def body_of(design: Design, lens: Lens | None, angle_deg: float = 0.0) -> Body:
    """Checked body of a design in the motion's state at ``angle_deg``, by its kind; errors as of its builder."""
    return BODY_KINDS[design.body.kind].build(design, lens, angle_deg)
