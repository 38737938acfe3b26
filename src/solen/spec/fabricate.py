"""Seats for assembly: pockets for the receivers, and slots for supporting films."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from solen.spec.strict import Number, Strict, Text, refused, reported_as

Length = Annotated[Number, Field(ge=1e-3, le=1e3)]
Slot = Literal["receivers", "emitter"]
SLOTS: tuple[Slot, ...] = ("receivers", "emitter")
SLOTS_LIMIT = 'must be a list of "receivers" and "emitter", each at most once'


def _in_order(slots: tuple[Slot, ...]) -> tuple[Slot, ...]:
    if len(set(slots)) != len(slots):
        raise refused("", SLOTS_LIMIT, value=list(slots))
    return tuple(slot for slot in SLOTS if slot in slots)


class Fabricate(Strict):
    """Seats for the electronics, cut out of the solid; the ray trace ignores them."""

    table: ClassVar[str] = "fabricate"

    pockets: Annotated[bool, Field(strict=True)] = Field(
        False, description="Whether each receiver's face has a pocket for its package."
    )
    receiver_part: Text = Field(
        "TEMT7100X01",
        description="Receiver for whose package the pockets are made: its name in the library, or a part file (ends in "
        ".toml or contains a / or \\), relative to the design file.",
    )
    pocket_depth_mm: Length | None = Field(
        None,
        description="Depth of a pocket in mm; default: that of the package, whose back is then flush with the face.",
    )
    slots: Annotated[tuple[Slot, ...], AfterValidator(_in_order), reported_as(SLOTS_LIMIT)] = Field(
        (),
        description="Parts next to which the top has slots for a supporting film: receivers, emitter.",
        json_schema_extra={"uniqueItems": True},
    )
    film_mm: Length = Field(0.1, description="Thickness of the film in mm, which is the depth of a slot.")
    slot_width_mm: Length = Field(2.0, description="Width of the film in mm.")
    slot_length_mm: Length = Field(2.0, description="Length of a slot into the body in mm.")
    mark: Annotated[bool, Field(strict=True)] = Field(
        False, description="Whether the top of the left arm has a dimple, which shows the orientation of a print."
    )
    clearance_mm: Annotated[Number, Field(ge=0, le=10)] = Field(
        0.05, description="Clearance in mm on each side of a package or film."
    )
