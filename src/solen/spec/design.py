"""The design: everything that determines a sensor and its simulation, as frozen tables.

The idea: one value holds what the user decided and nothing that follows from it. Keys are those of the design file,
names carry units, and the defaults are the paper's sensor at 860 nm, so that a file states only what differs.
Whether what a design describes can be built (an oval beyond tangency, a body crossing itself) is for later stages.

The interface: `Design` and its tables `Material`, `Emitter`, `Ambient`, `Lens`, `Body`, `Wall`, `Receivers`, `Motion`,
`Trace`, `Fabricate`, `Readout`; `Motion.angles_deg` are the angles of a sweep; `Design.files` is where the files lie
that a design names. What several tables say together is checked by `solen.spec.together`.
"""

from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, PrivateAttr, model_validator

from solen.spec.fabricate import Fabricate
from solen.spec.readout import Readout
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, or_refuse, refused
from solen.spec.together import check_together
from solen.spec.wall import Wall

MAX_STEPS = 100_000
READOUT_PARTS = ("part", "emitter_part", "trimmer", "adc")
"""Keys of the readout that name a part."""
_SAME_ANGLE = Decimal("1e-9")  # of a step: nearer than this, two angles are one

Length = Annotated[Number, Field(ge=1e-6, le=1e6)]
Place = Annotated[Number, Field(ge=-1e6, le=1e6)]
Index = Annotated[Number, Field(ge=1, lt=5)]
Sweep = Annotated[Number, Field(gt=-90, lt=90)]
Point = tuple[Place, Place]
Size = Annotated[Number, Field(ge=0, le=1e6)]
Angle = Annotated[Number, Field(ge=0, le=180)]
Wavelength = Annotated[Number, Field(ge=100, le=20_000)]
Pivot = Literal["stem-base", "emitter"] | Point
Part = Literal["lens", "emitter", "receivers", "mirrors"]
PARTS: tuple[Part, ...] = ("lens", "emitter", "receivers", "mirrors")
PARTS_LIMIT = 'must be a list of "lens", "emitter", "receivers", "mirrors", at least one and none twice'


def _parts(moves: tuple[Part, ...]) -> tuple[Part, ...]:
    if len(set(moves)) != len(moves) or not moves:
        raise refused("", PARTS_LIMIT, value=list(moves))
    return tuple(part for part in PARTS if part in moves)


def names_file(name: str | None) -> bool:
    """Whether a resin or a part is named by its file rather than by its name in the library."""
    return name is not None and (name.endswith(".toml") or "/" in name or "\\" in name)


def why_no_pattern(pairs: Sequence[tuple[float, float]]) -> str:
    """Why pairs of an angle in degrees and a relative intensity are no pattern; empty where they are one."""
    if len(pairs) < 2:
        return "must have at least 2 entries"
    angles = [angle for angle, _ in pairs]
    if angles[0] != 0.0 or angles[-1] > 180.0 or any(low >= high for low, high in pairwise(angles)):
        return "its angles must ascend from 0, up to 180 at most"
    values = [value for _, value in pairs]
    return "" if min(values) >= 0.0 and max(values) > 0.0 else "its values must be at least 0, and not 0 everywhere"


class Ambient(Strict):
    """Light from around: the same from all sides, told apart from the emitter's at every receiver."""

    table: ClassVar[str] = "ambient"

    power: NotNegative = Field(
        0.0, description="Power through a circle round the sensor, relative to the emitter's; 0 for none."
    )
    irradiance_per_mm: NotNegative = Field(
        0.0, description="The same, stated as the power on each mm of an open face, relative to the emitter's."
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(10_000, description="Number of rays.")

    @model_validator(mode="after")
    def _stated_once(self) -> Self:
        if self.power > 0.0 and self.irradiance_per_mm > 0.0:
            raise refused(
                "irradiance_per_mm", "has no meaning beside power", value=self.irradiance_per_mm, remedy="keep one"
            )
        return self


class Material(Strict):
    """What the body and the lens are printed in: an index, or a resin whose index depends on the wavelength."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["index"]}, {"required": ["resin"]}]})
    table: ClassVar[str] = "material"

    index: Index | None = Field(None, description="Refractive index at the emitter's wavelength, 1 to 5.")
    resin: Text | None = Field(
        None,
        description="Name of a resin in the library, or a resin file (ends in .toml or holds a / or \\), "
        "relative to the design file; evaluated at the emitter's wavelength.",
    )
    absorption_per_mm: NotNegative = Field(
        0.0, description="Absorption of power per mm (base e); where left out, a resin's own loss is taken."
    )

    @model_validator(mode="after")
    def _one_of_index_and_resin(self) -> Self:
        if self.index is not None and self.resin is not None:
            raise refused("", "gives both index and resin", remedy="keep one of the two")
        if self.index is None and self.resin is None:
            raise refused("", "gives neither index nor resin", remedy='add index = 1.44 or resin = "pmma"')
        return self

    @property
    def states_absorption(self) -> bool:
        """Whether the absorption was stated, and so overrules a resin's own loss, even where it is 0."""
        return "absorption_per_mm" in self.model_fields_set


class Emitter(Strict):
    """The light source before the lens, and the rays that stand for it."""

    table: ClassVar[str] = "emitter"
    reserved: ClassVar[frozenset[str]] = frozenset({"power_mW"})

    part: Text | None = Field(
        None,
        description="Name of an emitter in the library, or a part file (ends in .toml or holds a / or \\), relative to "
        "the design file: its pattern, spectrum and size hold where this table states none.",
    )
    wavelength_nm: Wavelength = Field(
        860.0, description="Wavelength in nm; default: the part's or the spectrum's, 860 without these."
    )
    spectrum: Annotated[tuple[tuple[Wavelength, Positive], ...], Field(min_length=1)] | None = Field(
        None, description="Wavelengths in nm with their weights, [[850, 1], [870, 0.5]]."
    )
    fwhm_nm: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="Full width at half maximum, in nm, of a Gaussian spectrum about the wavelength."
    )
    distance_mm: Length = Field(1.0, description="Distance to the lens vertex in mm.")
    offset_mm: Place = Field(0.0, description="Decentre from the axis in mm, towards +x.")
    width_mm: Size = Field(0.0, description="Width of the chip across the axis in mm; 0 for a point.")
    height_mm: Size = Field(0.0, description="Height of the chip along y in mm; 0 for a line.")
    cone_deg: Annotated[Number, Field(gt=0, le=360)] = Field(
        120.0,
        description="Full opening angle in degrees beyond which nothing is emitted; default: 120 for a fan, 180 for "
        "uniform and lambertian, 360 for a table.",
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(100, description="Number of rays.")
    point_mm: Annotated[Point, or_refuse("must be [x_mm, z_mm] with two finite numbers")] | None = Field(
        None, description="Place [x_mm, z_mm] of the emitter of an outline; default: as drawn."
    )
    axis_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        None, description="Where the emitter of an outline looks, counter-clockwise from +z; default: as drawn."
    )
    pattern: Literal["fan", "uniform", "lambertian", "table"] = Field(
        "fan",
        description="Angular pattern: a fan uniform in angle in the plane, uniform in all directions, cos^exponent, or "
        "a table.",
    )
    exponent: Annotated[Number, Field(ge=0, le=10_000)] = Field(
        1.0, description="m of the pattern cos^m, with lambertian only."
    )
    pattern_table: Annotated[tuple[tuple[Angle, NotNegative], ...], Field(min_length=2)] | None = Field(
        None, description="Angles from the axis in degrees with relative intensities per solid angle, from 0 on."
    )
    pattern_file: Text | None = Field(
        None, description="Text file of such pairs, one in a line, relative to the design file."
    )
    ray_file: Text | None = Field(
        None,
        description="File of rays (Zemax .dat or .sdf, TM-25 .tm25ray), relative to the design file: it stands for "
        "pattern and size.",
    )

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.spectrum is not None and self.fwhm_nm is not None:
            raise refused("fwhm_nm", "has no meaning beside spectrum", value=self.fwhm_nm, remedy="keep one of the two")
        tables = [key for key in ("pattern_table", "pattern_file") if getattr(self, key) is not None]
        if len(tables) > 1:
            raise refused("pattern_file", "has no meaning beside pattern_table", remedy="keep one of the two")
        if tables and self.pattern != "table":
            raise refused(tables[0], f'has no meaning with pattern = "{self.pattern}"', remedy='set pattern = "table"')
        if self.pattern == "table" and not tables:
            remedy = "add pattern_table = [[0, 1], [90, 0]], or pattern_file"
            raise refused("pattern_table", 'missing: pattern = "table" needs it', remedy=remedy)
        if self.pattern_table is not None and (bad := why_no_pattern(self.pattern_table)):
            raise refused("pattern_table", bad)
        if self.exponent != 1.0 and self.pattern != "lambertian":
            limit = f'has no meaning with pattern = "{self.pattern}"'
            raise refused("exponent", limit, value=self.exponent, remedy='set pattern = "lambertian"')
        if self.height_mm > 0.0 and self.pattern == "fan" and self.part is None:
            limit = 'has no meaning with pattern = "fan", which lies in the plane'
            raise refused("height_mm", limit, value=self.height_mm, remedy='set pattern = "lambertian"')
        if self.ray_file is not None:
            self._rays_alone()
        return self

    def _rays_alone(self) -> None:
        """A file of rays says all but the wavelength."""
        for key in ("part", "width_mm", "height_mm", "cone_deg", "pattern", "spectrum", "fwhm_nm"):
            if self.states(key):
                raise refused(key, "has no meaning beside ray_file", remedy="leave it out")

    def states(self, key: str) -> bool:
        """Whether a key was stated, even as its default."""
        return key in self.model_fields_set


class Lens(Strict):
    """The lens at the stem's base."""

    model_config = ConfigDict(
        json_schema_extra={
            "if": {"properties": {"shape": {"const": "measured"}}, "required": ["shape"]},
            "then": {"required": ["profile"]},
        }
    )
    table: ClassVar[str] = "lens"
    reserved: ClassVar[frozenset[str]] = frozenset({"outline"})

    shape: Literal["cartesian-oval", "measured", "none"] = Field(
        "cartesian-oval",
        description="A Cartesian oval; measured: that oval as it was printed, by its profile; or none: a flat face at "
        "the stem's base, the emitter distance_mm before it.",
    )
    profile: Text | None = Field(
        None,
        description='Profile of the lens as it is, with shape = "measured": what solen inspect writes, or a table of '
        "x_mm, z_mm and u_mm, relative to the design file.",
    )
    focus_mm: Length = Field(20.0, description="Distance in mm from the vertex into the body where it focuses.")
    half_width_mm: Length = Field(2.0, description="Half the lens aperture in mm.")
    design_index: Index | None = Field(
        None,
        description="Index that the lens is shaped for; default: the material's at the emitter's wavelength.",
    )

    @model_validator(mode="after")
    def _profile_of_a_measured_one(self) -> Self:
        if self.shape == "measured" and self.profile is None:
            raise refused("profile", 'missing: shape = "measured" needs it', remedy='add profile = "lens.json"')
        return self


class Body(Strict):
    """The printed guide: a stem that widens as a parabola and forks into two arms, or an outline of one's own."""

    table: ClassVar[str] = "body"

    kind: Literal["y", "outline"] = Field("y", description="Shape of the body: a Y, or an outline read from file.")
    file: Text | None = Field(
        None,
        description='Drawing of the outline, .dxf, .svg or .json, relative to the design file; with kind="outline".',
    )
    units: Literal["um", "mm", "cm", "m", "in"] | None = Field(
        None, description="Unit of the drawing; default: what the drawing says."
    )
    join_mm: Annotated[Number, Field(ge=1e-9, le=1.0)] | None = Field(
        None, description="Ends of a drawing this near in mm are joined; default: 0.001."
    )
    stem_length_mm: Length = Field(16.2, description="Length of the stem in mm.")
    stem_curve_per_mm: Annotated[Number, Field(ge=-1e3, le=1e3)] = Field(
        0.004, description="Quadratic coefficient of the stem's edge in 1/mm."
    )
    arm_length_mm: Length = Field(22.2, description="Length of an arm in mm.")
    arm_width_mm: Length = Field(3.0, description="Width of an arm in mm.")
    arm_angle_deg: Annotated[Number, Field(gt=0, lt=90)] | None = Field(
        None,
        description="Angle of an arm from the axis in degrees; default: tangent to the stem's edge at the fork.",
    )
    thickness_mm: Length = Field(4.0, description="Thickness in mm, along y.")


class Receivers(Strict):
    """The two receivers at the arm ends, and how the light reaches them."""

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
        "matched", description="Black and index-matched on the arm ends, or behind an air gap of gap_mm."
    )
    gap_mm: Length | None = Field(None, description='Air gap in mm; with coupling = "air-gap", and only then.')
    height_mm: Length | None = Field(
        None,
        description='Height in mm along y, about the middle, with dimension = "extruded"; default: all of it.',
    )

    @model_validator(mode="after")
    def _gap_with_air_gap_only(self) -> Self:
        if self.coupling == "air-gap" and self.gap_mm is None:
            raise refused("gap_mm", 'missing: coupling = "air-gap" needs it', remedy="add gap_mm = 0.5")
        if self.coupling != "air-gap" and self.gap_mm is not None:
            remedy = 'leave it out, or set coupling = "air-gap"'
            raise refused(
                "gap_mm", f'has no meaning with coupling = "{self.coupling}"', value=self.gap_mm, remedy=remedy
            )
        return self


class Motion(Strict):
    """How the sensor is moved, and the angles of a sweep; counter-clockwise with z up and x to the right."""

    table: ClassVar[str] = "motion"

    kind: Literal["rotation", "bend"] = Field(
        "rotation", description="A rotation of parts about a pivot, or a bend of the stem."
    )
    pivot: Annotated[Pivot, or_refuse('must be "stem-base", "emitter" or [x_mm, z_mm] with two finite numbers')] = (
        Field("stem-base", description="Centre of the rotation: stem-base, emitter, or a point [x_mm, z_mm].")
    )
    moves: Annotated[tuple[Part, ...], AfterValidator(_parts), or_refuse(PARTS_LIMIT)] = Field(
        ("lens", "emitter"),
        description="Parts that turn: lens, emitter, receivers (behind an air gap), mirrors (of an outline).",
        json_schema_extra={"uniqueItems": True, "minItems": 1},
    )
    centre_line: (
        Annotated[
            tuple[Point, ...],
            Field(min_length=3, max_length=1000),
            or_refuse("must be a list of 3 to 1000 points [x_mm, z_mm]"),
        ]
        | None
    ) = Field(
        None,
        description="Points of a bent stem's centre line, from base to fork: how the bend is shared out along it; "
        "default: evenly.",
    )
    bend_mm: Annotated[tuple[Place, Place], or_refuse("must be two heights [z_from_mm, z_to_mm]")] | None = Field(
        None, description="Heights z between which an outline bends; the part below is carried along."
    )
    from_deg: Sweep = Field(-3.0, description="First angle in degrees.")
    to_deg: Sweep = Field(3.0, description="Last angle in degrees, greater than from_deg.")
    step_deg: Positive = Field(0.25, description=f"Step in degrees; at most {MAX_STEPS:,} steps.")

    @model_validator(mode="after")
    def _sweep_ascends_in_few_steps(self) -> Self:
        if not self.from_deg < self.to_deg:
            limit = f"must be less than motion.to_deg = {self.to_deg}"
            remedy = "swap the two" if self.from_deg > self.to_deg else "raise motion.to_deg"
            raise refused("from_deg", limit, value=self.from_deg, remedy=remedy)
        if (self.to_deg - self.from_deg) / MAX_STEPS > self.step_deg * (1 + 1e-12):
            limit = f"at most {MAX_STEPS:,} steps from {self.from_deg} to {self.to_deg}"
            raise refused("step_deg", limit, value=self.step_deg, remedy="take a larger step")
        return self

    def angles_deg(self) -> tuple[float, ...]:
        """Angles from `from_deg` to `to_deg` by `step_deg`, both ends included where the step meets them.

        They are summed in decimal, as the file states them: -0.3 by 0.1 passes through exactly 0.0.

        Returns
        -------
        tuple of float
            Ascending, in degrees; none exceeds `to_deg`.
        """
        first, last, step = (Decimal(repr(value)) for value in (self.from_deg, self.to_deg, self.step_deg))
        steps = int((last - first) / step + _SAME_ANGLE)
        return tuple(_snapped(first + i * step, last, step * _SAME_ANGLE) for i in range(steps + 1))


def _snapped(angle: Decimal, last: Decimal, near: Decimal) -> float:
    """Angle as a float; a step such as 1/3 misses 0 and the end by its own rounding, which is mended here."""
    goal = next((goal for goal in (Decimal(0), last) if abs(angle - goal) <= near), angle)
    return float(goal)


class Trace(Strict):
    """How rays are followed."""

    table: ClassVar[str] = "trace"
    reserved: ClassVar[frozenset[str]] = frozenset({"min_weight", "seed"})

    mode: Literal["count", "power", "roulette"] = Field(
        "count",
        description="Whole rays that refract or reflect totally, Fresnel power with both branches, or with one drawn.",
    )
    dimension: Literal["2d", "extruded"] = Field(
        "2d",
        description="The plane of the sensor alone, or rays in space in a body of body.thickness_mm.",
    )


class Design(Strict):
    """A sensor: its name, material, optics, body, motion and trace.

    Two designs are equal where their tables are and the files that they name are the same files.
    """

    reserved: ClassVar[frozenset[str]] = frozenset({"emitters", "lenses"})

    name: Text = Field(description="the name of the design, one line.")
    material: Material = Field(description='what it is printed in, index = 1.44 or resin = "pmma".')
    emitter: Emitter = Field(default_factory=Emitter, description="The light source.")
    ambient: Ambient = Field(default_factory=Ambient, description="Light from around.")
    lens: Lens = Field(default_factory=Lens, description="The lens.")
    body: Body = Field(default_factory=Body, description="The printed guide.")
    wall: tuple[Wall, ...] = Field((), description="What lies outside stretches of the walls, and their finish.")
    receivers: Receivers = Field(default_factory=Receivers, description="The receivers.")
    motion: Motion = Field(default_factory=Motion, description="The motion and the sweep.")
    trace: Trace = Field(default_factory=Trace, description="How rays are followed.")
    fabricate: Fabricate = Field(default_factory=Fabricate, description="Seats for the electronics in what is printed.")
    readout: Readout = Field(default_factory=Readout, description="How the receivers' light becomes volts.")

    _folder: Path = PrivateAttr(default_factory=Path)

    @model_validator(mode="after")
    def _tables_fit_together(self) -> Self:
        if self.body.kind == "outline" and "moves" not in self.motion.model_fields_set:
            # of an outline nothing but the emitter can be known to move without tearing it
            self.__dict__["motion"] = self.motion.model_copy(update={"moves": ("emitter",)})
        check_together(self)
        return self

    @property
    def folder(self) -> Path:
        """Folder that the design's relative paths start from: its file's, or the working one for a design in memory."""
        return self._folder

    @property
    def resin_file(self) -> Path | None:
        """Path of the resin file, or None where the material is an index or a library resin."""
        return self.file_of(self.material.resin) if names_file(self.material.resin) else None

    @property
    def part_file(self) -> Path | None:
        """Path of the emitter's part file, or None where it has no part or one of the library."""
        return self.file_of(self.emitter.part) if names_file(self.emitter.part) else None

    @property
    def receiver_file(self) -> Path | None:
        """Path of the part file of the receiver that pockets are made for, or None where it is one of the library."""
        name = self.fabricate.receiver_part
        return self.file_of(name) if names_file(name) else None

    @property
    def files(self) -> dict[str, Path]:
        """Paths of the files that the design names, by the key that names each."""
        found = {
            "material.resin": self.resin_file,
            "emitter.part": self.part_file,
            "emitter.pattern_file": self.file_of(self.emitter.pattern_file),
            "emitter.ray_file": self.file_of(self.emitter.ray_file),
            "lens.profile": self.profile_file,
            "body.file": self.outline_file,
            "fabricate.receiver_part": self.receiver_file,
            **{f"readout.{key}": self.named_file(getattr(self.readout, key)) for key in READOUT_PARTS},
        }
        return {key: path for key, path in found.items() if path is not None}

    def file_of(self, name: str | None) -> Path | None:
        """Path of a file by the name that the design gives it; None for None."""
        return None if name is None else self._folder / name

    def named_file(self, name: str | None) -> Path | None:
        """Path of a part's file by its name, or None where it is one of the library or none at all."""
        return self.file_of(name) if names_file(name) else None

    @property
    def profile_file(self) -> Path | None:
        """Path of the measured lens's profile, or None where the design names none."""
        return self.file_of(self.lens.profile)

    @property
    def outline_file(self) -> Path | None:
        """Path of the outline's drawing, or None for a Y."""
        return self.file_of(self.body.file)

    def in_folder(self, folder: Path) -> Self:
        """Return the same design with its relative paths starting from another folder."""
        copy = self.model_copy()
        copy._folder = folder
        return copy

    def __eq__(self, other: Any) -> bool:
        if not isinstance(other, Design):
            return NotImplemented
        return self.__dict__ == other.__dict__ and self.files == other.files
