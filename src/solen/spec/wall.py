"""Surface finish of a wall, and the medium outside it: one ``[[wall]]`` table for each part of the outline.

A table applies to a face, to all faces that match a pattern, or to part of a face. The medium outside is a *pad* of
thickness ``depth_mm`` with its own index, behind a thin film of air if ``gap_um`` is set. Behind the pad is a black
surface or air.
"""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from solen.registry import FINISHES, plugin_entries
from solen.spec.stretch import Stretch
from solen.spec.strict import NotNegative, Number, Strict, Text, choices, refused

Fraction = Annotated[Number, Field(ge=0, le=1)]
SCATTER_KEYS = {"gaussian": ("sigma",), "harvey-shack": ("shoulder", "slope"), "lambertian": ()}
BUILT_IN_FINISHES = ("clear", "mirror", "black")


def _check_finish(name: str) -> str:
    known = list(dict.fromkeys([*BUILT_IN_FINISHES, *plugin_entries(FINISHES)]))
    if name not in known:
        raise refused("", f"must be {choices(known)}", value=name)
    return name


class Layer(Strict):
    """A thin film of a coating."""

    table: ClassVar[str] = "wall.coating"

    index: Annotated[Number, Field(gt=0, le=100)] = Field(description="refractive index.")
    thickness_nm: Annotated[Number, Field(ge=0, le=1e6)] = Field(description="thickness in nm.")
    extinction: Annotated[Number, Field(ge=0, le=100)] = Field(0.0, description="Extinction coefficient.")


class Wall(Stretch):
    """Part of the walls of the body: its finish, and the medium outside."""

    table: ClassVar[str] = "wall"

    outside: Text = Field("air", description="Medium outside this part of the wall: air, or a name of your choice.")
    index: Annotated[Number, Field(ge=1, lt=5)] | None = Field(
        None, description="Refractive index of the medium outside."
    )
    absorption_per_mm: NotNegative = Field(
        0.0, description="Absorption coefficient for power per mm of the medium outside."
    )
    depth_mm: Annotated[Number, Field(ge=1e-3, le=1e3)] = Field(
        1.0, description="Thickness of the medium outside in mm."
    )
    beyond: Literal["black", "air"] = Field("black", description="What is behind the medium outside: black or air.")
    gap_um: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="Thickness in µm of an air film between the body and the medium outside; default: none."
    )
    finish: Annotated[Text, AfterValidator(_check_finish)] = Field(
        "clear",
        description="Finish of the wall: clear, mirror or black, or a finish from another package.",
        json_schema_extra=lambda schema: schema.update(enum=[*BUILT_IN_FINISHES, *plugin_entries(FINISHES)]),
    )
    reflectance: Fraction = Field(1.0, description="Fraction of the power that a mirror reflects.")
    scatter: Literal["none", "lambertian", "gaussian", "harvey-shack"] = Field(
        "none", description="How the wall scatters light."
    )
    scatter_share: Fraction = Field(1.0, description="Fraction of the power that is scattered.")
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
        None, description="Period of the ripple of a print in µm."
    )
    texture_amplitude_um: Annotated[Number, Field(gt=0, le=1e5)] | None = Field(
        None, description="Amplitude of the ripple of a print in µm, half the peak-to-valley height."
    )
    texture_direction: Literal["along", "across"] = Field(
        "along", description="Direction perpendicular to the crests: along the wall, or across it, which is along y."
    )
    coating: Annotated[tuple[Layer, ...], Field(max_length=63)] = Field(
        (), description="Thin films on the wall, from the body outwards."
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        self._check_outside()
        self._check_plugin_finish()
        self._check_scatter()
        self._check_built_in_finish()
        if (self.texture_pitch_um is None) != (self.texture_amplitude_um is None):
            missing = "texture_pitch_um" if self.texture_pitch_um is None else "texture_amplitude_um"
            raise refused(missing, "is missing: a texture has a pitch and an amplitude", remedy=f"add {missing} = 5.0")
        return self

    def _check_outside(self) -> None:
        if self.outside == "body":
            raise refused("outside", "is reserved for the printed part itself", value="body", remedy="use another name")
        if self.outside != "air":
            if self.index is None:
                limit = f'is missing: required with outside = "{self.outside}"'
                raise refused("index", limit, remedy="add index = 1.5")
            return
        for key in ("index", "absorption_per_mm", "gap_um"):
            if value := getattr(self, key):
                example = "skin" if key == "gap_um" else "glue"
                remedy = f'omit {key}, or name the medium outside, such as outside = "{example}"'
                raise refused(key, 'does not apply with outside = "air"', value=value, remedy=remedy)

    @property
    def has_plugin_finish(self) -> bool:
        """Whether the finish is defined by another package."""
        return self.finish not in BUILT_IN_FINISHES

    def _check_plugin_finish(self) -> None:
        if not self.has_plugin_finish:
            return
        given = {
            "outside": self.outside != "air",
            "coating": bool(self.coating),
            "scatter": self.scatter != "none",
            "texture_pitch_um": self.texture_pitch_um is not None,
        }
        for key in (key for key, is_given in given.items() if is_given):
            limit = f'does not apply with finish = "{self.finish}", which defines the surface between body and air'
            raise refused(key, limit, remedy=f"omit {key}")

    def _check_scatter(self) -> None:
        required = SCATTER_KEYS.get(self.scatter, ())
        for key in ("sigma", "shoulder", "slope"):
            value = getattr(self, key)
            if value is None and key in required:
                raise refused(key, f'is missing: required with scatter = "{self.scatter}"', remedy="add it")
            if value is not None and key not in required:
                limit = f'does not apply with scatter = "{self.scatter}"'
                raise refused(key, limit, value=value, remedy=f"omit {key}")

    def _check_built_in_finish(self) -> None:
        if self.finish != "mirror" and self.reflectance != 1.0:
            limit, remedy = 'does not apply without finish = "mirror"', 'omit reflectance, or set finish = "mirror"'
            raise refused("reflectance", limit, value=self.reflectance, remedy=remedy)
        if self.finish != "clear" and (self.outside != "air" or self.coating):
            key = "outside" if self.outside != "air" else "coating"
            raise refused(
                key, f'does not apply with finish = "{self.finish}": no light reaches it', remedy=f"omit {key}"
            )
        if self.finish == "black" and (self.scatter != "none" or self.texture_pitch_um is not None):
            key = "scatter" if self.scatter != "none" else "texture_pitch_um"
            raise refused(key, 'does not apply with finish = "black", which absorbs all light', remedy=f"omit {key}")
