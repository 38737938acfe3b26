"""Tables of the printed part: the material, the lens, the body, and the receivers on its arms."""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from solen.registry import BODY_KINDS, Registry, plugin_entries
from solen.spec.quantities import Index, Length
from solen.spec.strict import NotNegative, Number, Strict, Text, choices, refused, reported_as

Keys = dict[str, tuple[str, ...]]
"""Keys, listed by table."""

UNUSED_KEYS: dict[str, Keys] = {
    "y": {
        "body": ("parameters", "file", "units", "join_mm"),
        "emitter": ("point_mm", "axis_deg"),
        "motion": ("bend_mm",),
    },
    "outline": {
        "body": ("parameters", "stem_length_mm", "stem_curve_per_mm", "arm_length_mm", "arm_width_mm", "arm_angle_deg"),
        "lens": (
            "shape",
            "profile",
            "y_focus_mm",
            "layer_mm",
            "knots_um",
            "min_feature_um",
            "focus_mm",
            "half_width_mm",
            "design_index",
        ),
        "emitter": ("distance_mm",),
        "motion": ("join",),
    },
    "network": {
        "body": (
            "parameters",
            *("stem_length_mm", "stem_curve_per_mm", "arm_length_mm", "arm_width_mm", "arm_angle_deg"),
        ),
        "lens": ("profile", "y_focus_mm", "layer_mm"),
        "emitter": ("point_mm", "axis_deg", "ray_file"),
        "ambient": ("power", "irradiance_per_mm"),
        "motion": (
            *("kind", "pivot", "moves", "centre_line", "bend_mm", "join", "drives", "depths_mm", "forces_N"),
            *("emitter_on", "from_deg", "to_deg", "step_deg"),
        ),
    },
}
"""The keys that each built-in kind of body does not use; `solen.geometry.kinds` builds the bodies."""


def unused_keys(kind: str) -> Keys:
    """Return the keys that a kind of body does not use, by table."""
    if kind in UNUSED_KEYS:
        return UNUSED_KEYS[kind]
    added: Keys = Registry[Any](BODY_KINDS, {})[kind].unused_keys
    return added


def _check_kind(kind: str) -> str:
    if kind not in UNUSED_KEYS and kind not in plugin_entries(BODY_KINDS):
        known = dict.fromkeys([*UNUSED_KEYS, *plugin_entries(BODY_KINDS)])
        raise refused("", f"must be {choices(known)}", value=kind)
    return kind


class Parameters(Strict):
    """Parameters of a body kind from another package."""

    model_config = ConfigDict(extra="allow")
    table: ClassVar[str] = "body.parameters"
    __pydantic_extra__: dict[str, Number]

    @property
    def values(self) -> dict[str, float]:
        """The values of the parameters, keyed by name."""
        return dict(self.__pydantic_extra__)


class Material(Strict):
    """The material of the body and the lens: a refractive index, or a resin whose index depends on the wavelength."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["index"]}, {"required": ["resin"]}]})
    table: ClassVar[str] = "material"

    index: Index | None = Field(None, description="Refractive index at the emitter's wavelength, 1 to 5.")
    resin: Text | None = Field(
        None,
        description="Name of a resin in the library, or path of a resin file (ends in .toml or contains a / or \\), "
        "relative to the design file; evaluated at the emitter's wavelength.",
    )
    absorption_per_mm: NotNegative = Field(
        0.0, description="Absorption coefficient for power per mm (base e); default: the absorption of the resin."
    )

    @model_validator(mode="after")
    def _check_index_or_resin(self) -> Self:
        if self.index is not None and self.resin is not None:
            raise refused("", "contains both index and resin", remedy="omit one of them")
        if self.index is None and self.resin is None:
            raise refused(
                "", "contains neither index nor resin", remedy='add, for example, index = 1.44 or resin = "pmma"'
            )
        return self

    @property
    def sets_absorption(self) -> bool:
        """Whether the design sets the absorption coefficient; it then overrides the resin's value, even if it is 0."""
        return "absorption_per_mm" in self.model_fields_set


YFocus = Annotated[
    Length | Literal["collimated", "body"],
    reported_as('must be "collimated", "body" or a finite number of at least 1e-6'),
]

SHAPE_KEYS = (
    ("y_focus_mm", "line-focus"),
    ("layer_mm", "layered"),
    ("knots_um", "spline", "measured"),
    ("min_feature_um", "spline", "measured"),
)
"""Lens keys, each followed by the lens shapes that use it."""

Deviation = Annotated[Number, Field(ge=-1e4, le=1e4)]
"""Deviation of a lens surface from the Cartesian oval, in µm."""


class Lens(Strict):
    """The lens at the base of the stem."""

    model_config = ConfigDict(
        json_schema_extra={
            "allOf": [
                {
                    "if": {"properties": {"shape": {"const": shape}}, "required": ["shape"]},
                    "then": {"required": [key]},
                }
                for shape, key in (("measured", "profile"), ("spline", "knots_um"))
            ]
        }
    )
    table: ClassVar[str] = "lens"
    reserved: ClassVar[frozenset[str]] = frozenset({"outline"})

    shape: Literal["cartesian-oval", "spline", "line-focus", "layered", "measured", "none"] = Field(
        "cartesian-oval",
        description="Shape of the lens. cartesian-oval; spline: a free form, the oval plus a deviation given by "
        "knots_um; line-focus: a smooth surface that focuses rays in space on one line; layered: such a surface in "
        "upright layers, each with its own profile; measured: the profile measured on the printed lens; none: a flat "
        "face at the stem's base, distance_mm from the emitter.",
    )
    y_focus_mm: YFocus | None = Field(
        None,
        description="For line-focus: distance in mm in front of the vertex from which light in the body appears to "
        "diverge in y; collimated; or body: the shortest distance at which the top and the bottom reflect all light "
        "totally. Default: body.",
    )
    layer_mm: Length | None = Field(
        None,
        description="For layered: height in mm of each layer of the lens, which spans one or more printed layers; "
        "default: 0.025.",
    )
    knots_um: Annotated[tuple[Deviation, ...], Field(min_length=1, max_length=64)] | None = Field(
        None,
        description="For spline, and for measured if a spline was printed: deviations from the oval along z in µm, "
        "at evenly spaced lateral positions from the axis towards the edge, where the deviation is 0. Negative values "
        "add material.",
    )
    min_feature_um: Annotated[Number, Field(gt=0, le=1e4)] | None = Field(
        None,
        description="Minimum width in µm of a bump or dimple of knots_um, and minimum radius of curvature; solen "
        "warns of smaller ones, which a printer rounds off. Default: 130.",
    )
    profile: Text | None = Field(
        None,
        description='With shape = "measured": measured profile of the lens, a file written by solen print inspect or '
        'a table of x_mm, z_mm and u_mm, relative to the design file. With shape = "layered": profiles of all layers, '
        "written by solen print predict.",
    )
    focus_mm: Length = Field(20.0, description="Distance of the focus from the vertex in mm, inside the body.")
    half_width_mm: Length = Field(2.0, description="Half the lens aperture in mm.")
    design_index: Index | None = Field(
        None,
        description="Refractive index for which the lens is designed; default: that of the material at the "
        "emitter's wavelength.",
    )

    @model_validator(mode="after")
    def _check_shape_keys(self) -> Self:
        if self.shape == "measured" and self.profile is None:
            raise refused(
                "profile",
                'is missing: required with shape = "measured"',
                remedy='add, for example, profile = "lens.json"',
            )
        if self.shape == "spline" and self.knots_um is None:
            remedy = "add knots_um = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"
            raise refused("knots_um", 'is missing: required with shape = "spline"', remedy=remedy)
        if self.min_feature_um is not None and self.knots_um is None:
            limit = "does not apply without knots_um"
            raise refused("min_feature_um", limit, value=self.min_feature_um, remedy="omit min_feature_um")
        if self.layer_mm is not None and self.profile is not None:
            raise refused("layer_mm", "does not apply with profile", value=self.layer_mm, remedy="omit one of them")
        for key, *shapes in SHAPE_KEYS:
            if getattr(self, key) is not None and self.shape not in shapes:
                limit, remedy = f'does not apply with shape = "{self.shape}"', f'set shape = "{shapes[0]}"'
                raise refused(key, limit, value=getattr(self, key), remedy=remedy)
        return self

    @property
    def designed_shape(self) -> str:
        """The designed shape of the lens; it differs from `shape` only if the lens is a measured one."""
        return "cartesian-oval" if self.knots_um is None else "spline"

    @property
    def in_space(self) -> bool:
        """Whether the lens surface varies with height; if not, the lens consists of vertical walls."""
        return self.shape in ("line-focus", "layered")


class Body(Strict):
    """The printed guide: a stem with parabolic edges that forks into two arms, or another kind of body."""

    table: ClassVar[str] = "body"

    kind: Annotated[Text, AfterValidator(_check_kind)] = Field(
        "y",
        description="Shape of the body: a Y, an outline read from a file, a network of guides, or a kind from another "
        "package.",
        json_schema_extra=lambda schema: schema.update(enum=[*UNUSED_KEYS, *plugin_entries(BODY_KINDS)]),
    )
    parameters: Parameters | None = Field(
        None, description="Parameters of a kind from another package: [body.parameters]."
    )
    file: Text | None = Field(
        None,
        description="Drawing of an outline or a network, .dxf, .svg or .json, relative to the design file.",
    )
    units: Literal["um", "mm", "cm", "m", "in"] | None = Field(
        None, description="Unit of the drawing; default: the unit given in the drawing."
    )
    join_mm: Annotated[Number, Field(ge=1e-9, le=1.0)] | None = Field(
        None, description="Maximum gap in mm between ends of lines that are joined; default: 0.001."
    )
    stem_length_mm: Length = Field(16.2, description="Length of the stem in mm.")
    stem_curve_per_mm: Annotated[Number, Field(ge=-1e3, le=1e3)] = Field(
        0.004, description="Quadratic coefficient of the stem's edge in 1/mm."
    )
    arm_length_mm: Length = Field(22.2, description="Length of an arm in mm.")
    arm_width_mm: Length = Field(3.0, description="Width of an arm in mm.")
    arm_angle_deg: Annotated[Number, Field(gt=0, lt=90)] | None = Field(
        None,
        description="Angle between an arm and the axis in degrees; default: tangent to the stem's edge at the fork.",
    )
    thickness_mm: Length = Field(4.0, description="Thickness along y in mm.")

    @property
    def lens_is_drawn(self) -> bool:
        """Whether the lens is part of the drawing, rather than defined in ``[lens]``."""
        return "shape" in unused_keys(self.kind).get("lens", ())


class Receivers(Strict):
    """The two receivers at the ends of the arms, and their optical coupling."""

    model_config = ConfigDict(
        json_schema_extra={
            "if": {"properties": {"coupling": {"const": "air-gap"}}, "required": ["coupling"]},
            "then": {"required": ["gap_mm"]},
            "else": {"not": {"required": ["gap_mm"]}},
        }
    )
    table: ClassVar[str] = "receivers"
    reserved: ClassVar[frozenset[str]] = frozenset({"part", "width_mm"})

    coupling: Literal["matched", "air-gap"] = Field(
        "matched", description="Black and index-matched to the ends of the arms, or behind an air gap of gap_mm."
    )
    gap_mm: Length | None = Field(
        None, description='Air gap in mm; applies only to coupling = "air-gap", which requires it.'
    )
    height_mm: Length | None = Field(
        None,
        description='Height along y in mm, centred; used with dimension = "extruded"; default: the full thickness.',
    )

    @model_validator(mode="after")
    def _check_gap(self) -> Self:
        if self.coupling == "air-gap" and self.gap_mm is None:
            raise refused(
                "gap_mm", 'is missing: required with coupling = "air-gap"', remedy="add, for example, gap_mm = 0.5"
            )
        if self.coupling != "air-gap" and self.gap_mm is not None:
            remedy = 'omit gap_mm, or set coupling = "air-gap"'
            raise refused(
                "gap_mm", f'does not apply with coupling = "{self.coupling}"', value=self.gap_mm, remedy=remedy
            )
        return self
