"""Seats for assembly: pockets for the receivers, and slots for glued-in films that carry a part."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from solen.spec.strict import Number, Strict, Text, or_refuse, refused

Length = Annotated[Number, Field(ge=1e-3, le=1e3)]
Place = Literal["receivers", "emitter"]
PLACES: tuple[Place, ...] = ("receivers", "emitter")
PLACES_LIMIT = 'must be a list of "receivers" and "emitter", each at most once'


def _places(slots: tuple[Place, ...]) -> tuple[Place, ...]:
    if len(set(slots)) != len(slots):
        raise refused("", PLACES_LIMIT, value=list(slots))
    return tuple(place for place in PLACES if place in slots)


class Fabricate(Strict):
    """Seats for the electronics, cut from the solid; the ray trace ignores them."""

    table: ClassVar[str] = "fabricate"

    pockets: Annotated[bool, Field(strict=True)] = Field(
        False, description="Whether the face of each receiver has a pocket for its package."
    )
    receiver_part: Text = Field(
        "TEMT7100X01",
        description="Receiver whose package the pockets fit: its name in the library, or a part file (ends in "
        ".toml or contains a / or \\), relative to the design file.",
    )
    pocket_depth_mm: Length | None = Field(
        None,
        description="Depth of a pocket in mm; default: that of the package, which puts its back flush with the face.",
    )
    slots: Annotated[tuple[Place, ...], AfterValidator(_places), or_refuse(PLACES_LIMIT)] = Field(
        (),
        description="Parts at which slots for a supporting film are cut into the top: receivers, emitter.",
        json_schema_extra={"uniqueItems": True},
    )
    film_mm: Length = Field(0.1, description="Thickness of the film in mm: the depth of a slot.")
    slot_width_mm: Length = Field(2.0, description="Width of the film in mm.")
    slot_length_mm: Length = Field(2.0, description="How far a slot reaches into the body, in mm.")
    mark: Annotated[bool, Field(strict=True)] = Field(
        False, description="Whether the top of the left arm has a dimple that distinguishes the faces of a print."
    )
    clearance_mm: Annotated[Number, Field(ge=0, le=10)] = Field(
        0.05, description="Clearance in mm on each side of a package and of a film."
    )
