"""Surface finish of a wall, and the medium outside it: one ``[[wall]]`` table for each part of the outline.

A table applies to a face, to all faces that match a pattern, or to part of a face. The medium in contact with it is a
*pad* of thickness ``depth_mm`` with its own index, behind a thin film of air if ``gap_um`` is set. The pad ends in
black or in air.
"""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from solen.registry import FINISHES, plugin_entries
from solen.spec.stretch import Stretch
from solen.spec.strict import NotNegative, Number, Strict, Text, refused

Share = Annotated[Number, Field(ge=0, le=1)]
SCATTER_KEYS = {"gaussian": ("sigma",), "harvey-shack": ("shoulder", "slope"), "lambertian": ()}


OWN_FINISHES = ("clear", "mirror", "black")


def _known_finish(name: str) -> str:
    known = list(dict.fromkeys([*OWN_FINISHES, *plugin_entries(FINISHES)]))
    if name not in known:
        raise refused("", f"must be {' or '.join(map(repr, known))}", value=name)
    return name


class Layer(Strict):
    """One thin film of a coating."""

    table: ClassVar[str] = "wall.coating"

    index: Annotated[Number, Field(gt=0, le=100)] = Field(description="its refractive index.")
    thickness_nm: Annotated[Number, Field(ge=0, le=1e6)] = Field(description="its thickness in nm.")
    extinction: Annotated[Number, Field(ge=0, le=100)] = Field(0.0, description="Extinction coefficient.")


class Wall(Stretch):
    """Part of the body's walls: the medium in contact with it, and its finish."""

    table: ClassVar[str] = "wall"

    outside: Text = Field(
        "air", description="Medium in contact with this part of the wall: air, or a name of your own."
    )
    index: Annotated[Number, Field(ge=1, lt=5)] | None = Field(None, description="Refractive index of that medium.")
    absorption_per_mm: NotNegative = Field(0.0, description="Absorption of power per mm in that medium.")
    depth_mm: Annotated[Number, Field(ge=1e-3, le=1e3)] = Field(1.0, description="Depth of that medium in mm.")
    beyond: Literal["black", "air"] = Field("black", description="What lies behind that medium: black or air.")
    gap_um: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="Film of air in µm between the body and that medium; default: none."
    )
    finish: Annotated[Text, AfterValidator(_known_finish)] = Field(
        "clear",
        description="Clear, mirrored or blackened, or a finish from another package.",
        json_schema_extra=lambda schema: schema.update(enum=[*OWN_FINISHES, *plugin_entries(FINISHES)]),
    )
    reflectance: Share = Field(1.0, description="Fraction of the power that a mirrored wall reflects.")
    scatter: Literal["none", "lambertian", "gaussian", "harvey-shack"] = Field(
        "none", description="How the wall scatters light."
    )
    scatter_share: Share = Field(1.0, description="Fraction of the power that is scattered.")
    sigma: Annotated[Number, Field(gt=0, le=10)] | None = Field(
        None, description="Width of gaussian scatter, in direction cosines."
    )
    shoulder: Annotated[Number, Field(ge=1e-4, le=10)] | None = Field(
        None, description="Shoulder of harvey-shack scatter, in direction cosines."
    )
    slope: Annotated[Number, Field(ge=0.5, le=10)] | None = Field(
        None, description="Slope of the wing of harvey-shack scatter."
    )
    texture_pitch_um: Annotated[Number, Field(gt=0, le=1e5)] | None = Field(
        None, description="Period of a print's ripple in um."
    )
    texture_amplitude_um: Annotated[Number, Field(gt=0, le=1e5)] | None = Field(
        None, description="Amplitude of a print's ripple in um, half the peak-to-valley height."
    )
    texture_direction: Literal["along", "across"] = Field(
        "along", description="Direction in which the crests follow one another: along the wall, or across it, along y."
    )
    coating: Annotated[tuple[Layer, ...], Field(max_length=63)] = Field(
        (), description="Thin films on the wall, from the body outwards."
    )

    @model_validator(mode="after")
    def _the_keys_fit_together(self) -> Self:
        self._check_outside()
        self._check_added_finish()
        self._check_finish()
        if (self.texture_pitch_um is None) != (self.texture_amplitude_um is None):
            missing = "texture_pitch_um" if self.texture_pitch_um is None else "texture_amplitude_um"
            raise refused(missing, "missing: a texture needs a pitch and an amplitude", remedy="add it")
        return self

    def _check_outside(self) -> None:
        if self.outside == "body":
            raise refused("outside", "is reserved for the printed part itself", value="body", remedy="use another name")
        if self.outside != "air":
            if self.index is None:
                raise refused("index", f"missing: {self.outside} needs an index", remedy="add index = 1.5")
            return
        stated = {"index": self.index, "absorption_per_mm": self.absorption_per_mm, "gap_um": self.gap_um}
        for key, value in stated.items():
            if value:
                remedy = (
                    f'leave it out, or name what touches the wall: outside = "{"glue" if key != "gap_um" else "skin"}"'
                )
                raise refused(key, 'does not apply where outside = "air"', value=value, remedy=remedy)

    @property
    def finish_is_added(self) -> bool:
        """Whether the finish is defined by another package."""
        return self.finish not in OWN_FINISHES

    def _check_added_finish(self) -> None:
        stated = {
            "outside": self.outside != "air",
            "coating": bool(self.coating),
            "scatter": self.scatter != "none",
            "texture_pitch_um": self.texture_pitch_um is not None,
        }
        for key, has in stated.items():
            if self.finish_is_added and has:
                limit = (
                    f'does not apply with finish = "{self.finish}", which defines the whole surface '
                    "between body and air"
                )
                raise refused(key, limit, remedy="leave it out")

    def _check_finish(self) -> None:
        needed = SCATTER_KEYS.get(self.scatter, ())
        for key in ("sigma", "shoulder", "slope"):
            value = getattr(self, key)
            if (value is None) == (key in needed):
                limit = f'missing: scatter = "{self.scatter}" needs it' if value is None else ""
                limit = limit or f'does not apply with scatter = "{self.scatter}"'
                raise refused(key, limit, value=value, remedy="add it" if value is None else "leave it out")
        if self.finish != "mirror" and self.reflectance != 1.0:
            raise refused("reflectance", 'does not apply without finish = "mirror"', value=self.reflectance)
        if self.finish != "clear" and (self.outside != "air" or self.coating):
            key = "outside" if self.outside != "air" else "coating"
            raise refused(key, f'does not apply with finish = "{self.finish}": no light reaches it')
        if self.finish == "black" and (self.scatter != "none" or self.texture_pitch_um is not None):
            raise refused("finish", "does not apply to a black wall, which absorbs all light", value="black")
