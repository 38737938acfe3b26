"""A network of guides: ``[network]`` and its lists, for ``body.kind = "network"``.

Guides connect nodes. Lenses, emitters and receivers are placed at nodes where a single guide ends, or on the side of a
guide. ``[lens]``, ``[emitter]`` and ``[receivers]`` contain the values that all lenses, emitters and receivers share; a
key of a single part overrides the shared value. The emitters are lit in turn, and ``lit`` names the emitter that is on.
``at_deg`` is the current angle of each motion.

With ``body.file`` the network is drawn: the lists then name the emitters, lenses and receivers, and the drawing
contains their positions.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, Field, model_validator

from solen.spec.motion import Join
from solen.spec.quantities import Index, Length, Place, Point, Size, Wavelength
from solen.spec.reading import Formula, Reading
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, refused, reported_as

Side = Literal["right", "left"]
Shape = Literal["cartesian-oval", "spline", "none"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
Width = Annotated[
    Length | Annotated[tuple[Number, ...], Field(min_length=1, max_length=12)],
    reported_as("must be a width above 0 in mm, or up to 12 coefficients of a polynomial such as [4.0, 0.0, 0.008]"),
]
Turn = Annotated[Number, Field(gt=-350, lt=350)]
Heading = Annotated[Number, Field(ge=-360, le=360)]
Through = Annotated[
    tuple[Point, ...], Field(max_length=1000), reported_as("must be a list of points [x_mm, z_mm], at most 1000")
]
Pivot = Annotated[Point | Literal["emitter"], reported_as('must be "emitter" or [x_mm, z_mm] with two finite numbers')]
Position = Annotated[Point, reported_as("must be [x_mm, z_mm] with two finite numbers")]

RESERVED_WORDS = ("receiver", "mirror", "black", "lens", "end", "join", "fillet")
"""First words of the names of all faces other than the sides of guides."""


def _check_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_-]*[A-Za-z0-9])?", name):
        limit = "must consist of letters, digits, - and _, and begin and end with a letter or a digit"
        raise refused("", limit, value=name)
    return name


def _check_guide_name(name: str) -> str:
    if re.match(r"[A-Za-z]*", _check_name(name))[0].lower() in RESERVED_WORDS:  # type: ignore[index]  # always matches
        limit = f"must not begin with {', '.join(RESERVED_WORDS)}, which are reserved for other faces"
        raise refused("", limit, value=name)
    return name


Name = Annotated[Text, AfterValidator(_check_name)]


class Node(Strict):
    """A node: a point where guides meet or where a guide ends."""

    table: ClassVar[str] = "network.nodes"

    name: Name = Field(description="name of the node.")
    at_mm: Position | None = Field(
        None,
        description="Position [x_mm, z_mm]; default: the end of the guide that leads to the node, or the origin for "
        "the first node.",
    )
    fillet_mm: Size = Field(0.0, description="Radius of the fillets in the corners between guides in mm; 0 for none.")
    end: Literal["open", "mirror", "black"] = Field(
        "open", description="Face at the end of a guide without a part: open, mirror or black."
    )


class Guide(Strict):
    """A guide along a centre line from its first node to its second node."""

    table: ClassVar[str] = "network.guides"

    name: Annotated[Text, AfterValidator(_check_guide_name)] = Field(
        description="name of the guide; its sides are called NAME-right and NAME-left."
    )
    nodes: tuple[Text, Text] = Field(description='first and second node of the guide, such as ["base", "fork"].')
    width_mm: Width = Field(
        description="width in mm, or the coefficients of a polynomial in the arc length from the first node."
    )
    direction_deg: Heading | None = Field(
        None,
        description="Direction at the first node in degrees, counter-clockwise from +z; default: to the second node.",
    )
    length_mm: Length | None = Field(
        None, description="Length of the centre line in mm; default: up to the second node."
    )
    turn_deg: Turn = Field(
        0.0, description="Angle of the arc along which the guide turns, counter-clockwise, in degrees; 0 if straight."
    )
    through_mm: Through = Field(
        (),
        description="Points between the nodes, through which the centre line passes as a spline; default: no spline.",
    )
    flush: Side | None = Field(
        None,
        description="Side of this guide whose wall continues the wall of the guide that leads to the first node; only "
        "one guide may lead there. Default: the guide is centred on the node.",
    )

    @property
    def widths(self) -> tuple[float, ...]:
        """Coefficients of the polynomial for the width."""
        return self.width_mm if isinstance(self.width_mm, tuple) else (self.width_mm,)

    @model_validator(mode="after")
    def _check_centre_line(self) -> Self:
        if self.nodes[0] == self.nodes[1]:
            remedy = "make a loop of two guides, with another node between them"
            raise refused("nodes", "must be two different nodes", value=list(self.nodes), remedy=remedy)
        for key in ("turn_deg", "direction_deg", "flush", "length_mm"):
            value = getattr(self, key)
            if self.through_mm and value:
                raise refused(key, "does not apply with through_mm", value=value, remedy="omit one of them")
        if self.direction_deg is not None and self.length_mm is None:
            raise refused(
                "length_mm", "is missing: required with direction_deg", remedy="add, for example, length_mm = 10.0"
            )
        if self.length_mm is not None and self.direction_deg is None and self.flush is None:
            raise refused(
                "direction_deg", "is missing: required with length_mm", remedy="add, for example, direction_deg = 0.0"
            )
        if self.flush is not None and self.length_mm is None:
            raise refused("length_mm", "is missing: required with flush", remedy="add, for example, length_mm = 10.0")
        return self


REMEDY_OF_POSITION = 'set node = "tip", or guide and side'


class Placed(Strict):
    """A part at a node where a single guide ends, or on a guide's side; in a drawn network, the drawing places it."""

    name: Name = Field(description="name of the part.")
    node: Text | None = Field(None, description="Node at which the part is placed; only one guide may end there.")
    guide: Text | None = Field(None, description="Guide on whose side the part is placed.")
    side: Side | None = Field(None, description="Side of that guide, seen from its first node.")

    def check_position(self, side_keys: Iterable[str]) -> None:
        """Raise an error if both a node and a guide are given, or if a key of a side is missing or does not apply."""
        if self.node is not None and self.guide is not None:
            raise refused("node", "does not apply with guide", value=self.node, remedy=REMEDY_OF_POSITION)
        for key in ("side", *side_keys):
            value = getattr(self, key)
            if (value is None) == (self.guide is not None):
                limit = "is missing: required with guide" if value is None else "does not apply without guide"
                raise refused(key, limit, value=value, remedy=f"add {key}" if value is None else f"omit {key}")


class PlacedLens(Placed):
    """A lens of a network; omitted keys have the values of ``[lens]``."""

    table: ClassVar[str] = "network.lenses"

    at_mm: NotNegative | None = Field(
        None, description="Position of the lens centre in mm along the side, from the guide's first node."
    )
    shape: Shape | None = Field(None, description="Replaces lens.shape for this lens.")
    focus_mm: Length | None = Field(None, description="Replaces lens.focus_mm for this lens.")
    half_width_mm: Length | None = Field(
        None,
        description="Replaces lens.half_width_mm for this lens; default for a lens at the end of a guide: half the "
        "width of the guide, unless [lens] gives a half width.",
    )
    design_index: Index | None = Field(None, description="Replaces lens.design_index for this lens.")
    knots_um: tuple[Number, ...] | None = Field(None, description="Replaces lens.knots_um for this lens.")

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        self.check_position(("at_mm",))
        return self


class PlacedEmitter(Placed):
    """An emitter in front of a lens, a bare end or a side; omitted keys have the values of ``[emitter]``."""

    table: ClassVar[str] = "network.emitters"

    lens: Text | None = Field(
        None, description="Lens in front of which the emitter is placed; instead of a node or a guide."
    )
    at_mm: NotNegative | None = Field(None, description="Position in mm along the side, from the guide's first node.")
    part: Text | None = Field(None, description="Replaces emitter.part for this emitter.")
    wavelength_nm: Wavelength | None = Field(None, description="Replaces emitter.wavelength_nm for this emitter.")
    distance_mm: Length | None = Field(None, description="Replaces emitter.distance_mm for this emitter.")
    offset_mm: Place | None = Field(None, description="Replaces emitter.offset_mm for this emitter.")
    width_mm: Size | None = Field(None, description="Replaces emitter.width_mm for this emitter.")
    height_mm: Size | None = Field(None, description="Replaces emitter.height_mm for this emitter.")
    cone_deg: Annotated[Number, Field(gt=0, le=360)] | None = Field(
        None, description="Replaces emitter.cone_deg for this emitter."
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        if self.lens is None:
            self.check_position(("at_mm",))
            return self
        for key in ("node", "guide", "side", "at_mm"):
            if getattr(self, key) is not None:
                raise refused(key, "does not apply with lens", value=getattr(self, key), remedy=f"omit {key}")
        return self


class PlacedReceiver(Placed):
    """A receiver at the end of a guide or on part of a side."""

    table: ClassVar[str] = "network.receivers"

    from_mm: NotNegative | None = Field(
        None, description="Start of the receiver in mm along the side, from the guide's first node."
    )
    to_mm: Positive | None = Field(
        None, description="End of the receiver in mm along the side, from the guide's first node."
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        self.check_position(("from_mm", "to_mm"))
        if self.from_mm is not None and self.to_mm is not None and not self.from_mm < self.to_mm:
            raise refused("from_mm", f"must be less than to_mm = {self.to_mm}", value=self.from_mm)
        return self


class NamedMotion(Strict):
    """A named motion: a bend of a guide, or a rotation of a part."""

    table: ClassVar[str] = "network.motion"

    name: Name = Field(description="name of the motion.")
    kind: Literal["bend", "rotation"] = Field(description="bend of a guide between its nodes, or rotation of a part.")
    part: Text = Field(
        description="guide that bends; or guide, lens or emitter that rotates. Everything beyond a guide moves with it."
    )
    pivot: Pivot | None = Field(
        None,
        description="Centre of a rotation: [x_mm, z_mm] with all motions at 0, or emitter; default: the node of the "
        "guide that is nearer to the fixed node, or the centre of the base of a lens.",
    )
    join: Join | None = Field(
        None, description="How a rotating lens is joined to its guide, as motion.join; default: by seams."
    )
    at_deg: Turn = Field(0.0, description="Current angle of the moving part in degrees, counter-clockwise.")
    from_deg: Turn = Field(-3.0, description="First angle of the range in degrees.")
    to_deg: Turn = Field(3.0, description="Last angle of the range in degrees, greater than from_deg.")
    steps: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        6, description="Number of steps from the first angle to the last."
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for key in ("pivot", "join"):
            if self.kind == "bend" and getattr(self, key) is not None:
                raise refused(key, "does not apply to a bend", value=getattr(self, key), remedy=f"omit {key}")
        if not self.from_deg < self.to_deg:
            raise refused("from_deg", f"must be less than to_deg = {self.to_deg}", value=self.from_deg)
        if not self.from_deg <= self.at_deg <= self.to_deg:
            limit = f"must be from_deg = {self.from_deg:g} to to_deg = {self.to_deg:g}"
            raise refused("at_deg", limit, value=self.at_deg)
        return self

    def angles_deg(self) -> tuple[float, ...]:
        """Return the angles of the range in ascending order, including both ends."""
        step = (self.to_deg - self.from_deg) / self.steps
        inner = (self.from_deg + i * step for i in range(1, self.steps))
        return (self.from_deg, *(0.0 if abs(angle) < 1e-9 * step else angle for angle in inner), self.to_deg)


class Network(Strict):
    """A network of guides with lenses, emitters, receivers and motions."""

    table: ClassVar[str] = "network"

    lit: Text | None = Field(None, description="Emitter that is lit; default: the first one.")
    fixed: Text | None = Field(None, description="Node that is stationary while parts move; default: the first one.")
    nodes: tuple[Node, ...] = Field((), description="Nodes where guides meet or end.")
    guides: tuple[Guide, ...] = Field((), description="Guides between nodes.")
    lenses: tuple[PlacedLens, ...] = Field((), description="Lenses.")
    emitters: tuple[PlacedEmitter, ...] = Field((), description="Emitters, which are lit in turn.")
    receivers: tuple[PlacedReceiver, ...] = Field((), description="Receivers.")
    motion: tuple[NamedMotion, ...] = Field((), description="Motions.")
    reading: tuple[Reading, ...] = Field((), description="Named expressions of received powers.")

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for key in LISTS:
            _check_unique(key, [entry.name for entry in getattr(self, key)])
        for key, name, kind, known in self._references():
            if name is not None and name not in known:
                limit = f"is not the name of a {kind}; known names: {', '.join(known) or 'none'}"
                raise refused(key, limit, value=name)
        for number in range(len(self.motion)):
            self._check_motion(number)
        _ = self.formulas  # parsed here to reject an invalid one
        return self

    def _check_motion(self, number: int) -> None:
        motion, what = self.motion[number], f"motion[{number}]"
        earlier = [other.name for other in self.motion[:number] if other.part == motion.part]
        if earlier:
            limit = f"is already moved by {earlier[0]}"
            raise refused(f"{what}.part", limit, value=motion.part, remedy="omit one of the two motions")
        if motion.join is not None and motion.part not in [lens.name for lens in self.lenses if lens.guide is None]:
            limit = "applies only to a lens at the end of a guide"
            raise refused(f"{what}.join", limit, value=motion.join, remedy="omit join")
        if motion.pivot == "emitter" and motion.part in [guide.name for guide in self.guides]:
            limit = "applies only to a lens or an emitter"
            raise refused(f"{what}.pivot", limit, value=motion.pivot, remedy="omit pivot, or set pivot = [x_mm, z_mm]")
        if isinstance(motion.pivot, tuple) and motion.part in self._on_sides():
            limit = "must be at the end of a guide to rotate about a point; it is on a side"
            raise refused(f"{what}.part", limit, value=motion.part, remedy='set pivot = "emitter"')
        parts = [part.name for key in ("guides", "lenses", "emitters") for part in getattr(self, key)]
        if motion.kind == "rotation" and parts.count(motion.part) > 1:
            limit = "is the name of several parts"
            raise refused(f"{what}.part", limit, value=motion.part, remedy="give each part its own name")

    def _on_sides(self) -> set[str]:
        """Return the names of lenses on sides, and of emitters on sides or in front of these lenses."""
        lenses = {lens.name for lens in self.lenses if lens.guide is not None}
        return lenses | {
            emitter.name for emitter in self.emitters if emitter.guide is not None or emitter.lens in lenses
        }

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """The parsed formulas of the network's readings."""
        emitters, receivers = ([part.name for part in parts] for parts in (self.emitters, self.receivers))
        return tuple(
            Formula.of(reading, emitters, receivers, f"reading[{i}].value") for i, reading in enumerate(self.reading)
        )

    def _references(self) -> Iterator[tuple[str, str | None, str, list[str]]]:
        """Yield each key that refers to a part, with the name of the part, its kind, and the names of that kind."""
        known = {key: [entry.name for entry in getattr(self, key)] for key in LISTS}
        yield "lit", self.lit, "emitter", known["emitters"]
        yield "fixed", self.fixed, "node", known["nodes"]
        for number, guide in enumerate(self.guides):
            for end, name in enumerate(guide.nodes):
                yield f"guides[{number}].nodes[{end}]", name, "node", known["nodes"]
        for key in ("lenses", "emitters", "receivers"):
            for number, part in enumerate(getattr(self, key)):
                yield f"{key}[{number}].node", part.node, "node", known["nodes"]
                yield f"{key}[{number}].guide", part.guide, "guide", known["guides"]
        for number, emitter in enumerate(self.emitters):
            yield f"emitters[{number}].lens", emitter.lens, "lens", known["lenses"]
        for number, motion in enumerate(self.motion):
            lists = ("guides",) if motion.kind == "bend" else ("guides", "lenses", "emitters")
            names = [name for key in lists for name in known[key]]
            yield f"motion[{number}].part", motion.part, "guide" if motion.kind == "bend" else "part", names


LISTS = ("nodes", "guides", "lenses", "emitters", "receivers", "motion", "reading")


def _check_unique(key: str, names: list[str]) -> None:
    """Raise an error if two entries of a list have the same name."""
    for number, name in enumerate(names):
        first = names.index(name)
        if first < number:
            limit = f"is also the name of {key}[{first}]"
            raise refused(f"{key}[{number}].name", limit, value=name, remedy="give it another name")
