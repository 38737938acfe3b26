"""A network of guides: ``[network]`` and its lists, for ``body.kind = "network"``.

Guides connect nodes. Lenses, emitters and receivers are placed at nodes where a single guide ends, or on the side of a
guide. ``[lens]``, ``[emitter]`` and ``[receivers]`` contain the values that all lenses, emitters and receivers share; a
key of a single part overrides the shared value. The emitters are lit in turn, and ``lit`` names the current one.
``at_deg`` is the current position of each motion.

With ``body.file`` the network is drawn: the lists then name emitters, lenses and receivers, but do not place them.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, Field, model_validator

from solen.spec.motion import Join
from solen.spec.quantities import Index, Length, Place, Point, Size, Wavelength
from solen.spec.reading import Formula, Reading
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, or_refuse, refused

Side = Literal["right", "left"]
Shape = Literal["cartesian-oval", "spline", "none"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
Width = Annotated[
    Length | Annotated[tuple[Number, ...], Field(min_length=1, max_length=12)],
    or_refuse("must be a width above 0 in mm, or up to 12 coefficients of a polynomial: [4.0, 0.0, 0.008]"),
]
Turn = Annotated[Number, Field(gt=-350, lt=350)]
Heading = Annotated[Number, Field(ge=-360, le=360)]
Through = Annotated[
    tuple[Point, ...], Field(max_length=1000), or_refuse("must be a list of points [x_mm, z_mm], at most 1000")
]
PivotOf = Annotated[Point | Literal["emitter"], or_refuse('must be "emitter" or [x_mm, z_mm] with two finite numbers')]
PlaceOf = Annotated[Point, or_refuse("must be [x_mm, z_mm] with two finite numbers")]

OF_FACES = ("receiver", "mirror", "black", "lens", "end", "join", "fillet")
"""First words of the names of all faces other than the sides of guides."""


def _name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_-]*[A-Za-z0-9])?", name):
        raise refused("", "must consist of letters, digits, - and _", value=name)
    return name


def _name_of_guide(name: str) -> str:
    if re.match(r"[A-Za-z]*", _name(name))[0].lower() in OF_FACES:  # type: ignore[index]  # it always matches
        raise refused("", f"must not begin with {', '.join(OF_FACES)}, which name other faces", value=name)
    return name


Name = Annotated[Text, AfterValidator(_name)]


class Node(Strict):
    """A node: a place where guides meet or where a guide ends."""

    table: ClassVar[str] = "network.nodes"

    name: Name = Field(description="its name.")
    at_mm: PlaceOf | None = Field(
        None,
        description="Position [x_mm, z_mm]; default: the end of the guide that leads to it, or "
        "the origin for the first node.",
    )
    fillet_mm: Size = Field(0.0, description="Radius of the fillets in the corners between guides; 0 for none.")
    end: Literal["open", "mirror", "black"] = Field(
        "open", description="Face that closes a guide where no part is placed: open, a mirror, or black."
    )


class Guide(Strict):
    """A guide along a centre line from its first node to its second."""

    table: ClassVar[str] = "network.guides"

    name: Annotated[Text, AfterValidator(_name_of_guide)] = Field(
        description="its name; its sides are called NAME-right and NAME-left."
    )
    nodes: tuple[Text, Text] = Field(description='the nodes from which and to which it leads, ["base", "fork"].')
    width_mm: Width = Field(
        description="its width in mm, or the coefficients of a polynomial in the arc length from the first node."
    )
    direction_deg: Heading | None = Field(
        None, description="Direction at the first node, counter-clockwise from +z; default: towards the second."
    )
    length_mm: Length | None = Field(None, description="Length of the centre line; default: up to the second node.")
    turn_deg: Turn = Field(
        0.0, description="Angle through which the guide turns as an arc, counter-clockwise; 0: straight."
    )
    through_mm: Through = Field(
        (), description="Points between the nodes through which the centre line passes as a spline; default: no spline."
    )
    flush: Side | None = Field(
        None,
        description="Side that continues the wall of the single guide that leads to the first node, so that "
        "this guide begins in its corner; default: centred on the node.",
    )

    @property
    def widths(self) -> tuple[float, ...]:
        """Coefficients of the polynomial that gives the width."""
        return self.width_mm if isinstance(self.width_mm, tuple) else (self.width_mm,)

    @model_validator(mode="after")
    def _one_centre_line(self) -> Self:
        if self.nodes[0] == self.nodes[1]:
            raise refused(
                "nodes", "must be two different nodes", value=list(self.nodes), remedy="put a node in between"
            )
        stated = {"turn_deg": self.turn_deg, "direction_deg": self.direction_deg, "flush": self.flush}
        stated["length_mm"] = self.length_mm
        for key, value in stated.items():
            if self.through_mm and value:
                raise refused(key, "does not apply with through_mm", value=value, remedy="leave one of them out")
        if self.direction_deg is not None and self.length_mm is None:
            raise refused("length_mm", "missing: direction_deg needs it", remedy="add it")
        if self.length_mm is not None and self.direction_deg is None and self.flush is None:
            raise refused("direction_deg", "missing: length_mm needs it", remedy="add it")
        if self.flush is not None and self.length_mm is None:
            raise refused("length_mm", "missing: flush needs it", remedy="add it")
        return self


REMEDY_OF_PLACE = 'state node = "tip", or guide and side'


class Placed(Strict):
    """A part at a node where a single guide ends, or on a guide's side; in a drawn network, the drawing places it."""

    name: Name = Field(description="its name.")
    node: Text | None = Field(None, description="Node at which the part is placed; only one guide may end there.")
    guide: Text | None = Field(None, description="Guide on whose side the part is placed.")
    side: Side | None = Field(None, description="Side of that guide, as seen from its first node.")

    def check_place(self, beside: Iterable[str]) -> None:
        """Raise an error if both a node and a side are given, or if keys of a side are missing or do not apply."""
        if self.node is not None and self.guide is not None:
            raise refused("node", "does not apply with guide", value=self.node, remedy=REMEDY_OF_PLACE)
        for key in ("side", *beside):
            value = getattr(self, key)
            if (value is None) == (self.guide is not None):
                limit = "missing: guide needs it" if value is None else "does not apply without guide"
                raise refused(key, limit, value=value, remedy="add it" if value is None else "leave it out")


class PlacedLens(Placed):
    """A lens of a network; omitted keys have the values of ``[lens]``."""

    table: ClassVar[str] = "network.lenses"

    at_mm: NotNegative | None = Field(
        None, description="Position of its middle, in mm along the side from the guide's first node."
    )
    shape: Shape | None = Field(None, description="Replaces lens.shape for this lens.")
    focus_mm: Length | None = Field(None, description="Replaces lens.focus_mm for this lens.")
    half_width_mm: Length | None = Field(
        None,
        description="Replaces lens.half_width_mm for this lens; default: half the guide's "
        "width, or lens.half_width_mm on a side.",
    )
    design_index: Index | None = Field(None, description="Replaces lens.design_index for this lens.")
    knots_um: tuple[Number, ...] | None = Field(None, description="Replaces lens.knots_um for this lens.")

    @model_validator(mode="after")
    def _stands_somewhere(self) -> Self:
        self.check_place(("at_mm",))
        return self


class PlacedEmitter(Placed):
    """An emitter in front of a lens, a bare end or a side; omitted keys have the values of ``[emitter]``."""

    table: ClassVar[str] = "network.emitters"

    lens: Text | None = Field(
        None, description="Lens before which the emitter is placed, instead of a node or a guide."
    )
    at_mm: NotNegative | None = Field(None, description="Position in mm along the side from the guide's first node.")
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
    def _stands_somewhere(self) -> Self:
        if self.lens is None:
            self.check_place(("at_mm",))
            return self
        for key in ("node", "guide", "side", "at_mm"):
            if getattr(self, key) is not None:
                raise refused(key, "does not apply with lens", value=getattr(self, key), remedy="leave it out")
        return self


class PlacedReceiver(Placed):
    """A receiver at the end of a guide or on part of a side."""

    table: ClassVar[str] = "network.receivers"

    from_mm: NotNegative | None = Field(
        None, description="Start of the receiver, in mm along the side from the first node."
    )
    to_mm: Positive | None = Field(None, description="End of the receiver, in mm along the side from the first node.")

    @model_validator(mode="after")
    def _stands_somewhere(self) -> Self:
        self.check_place(("from_mm", "to_mm"))
        if self.from_mm is not None and self.to_mm is not None and not self.from_mm < self.to_mm:
            raise refused("from_mm", f"must be less than to_mm = {self.to_mm}", value=self.from_mm)
        return self


class NamedMotion(Strict):
    """A named motion: a bend of a guide, or a rotation of a part."""

    table: ClassVar[str] = "network.motion"

    name: Name = Field(description="its name.")
    kind: Literal["bend", "rotation"] = Field(description="bend of a guide between its nodes, or rotation of a part.")
    part: Text = Field(
        description="guide that bends; or guide, lens or emitter that turns. A "
        "guide carries everything beyond it along."
    )
    pivot: PivotOf | None = Field(
        None,
        description="Centre [x_mm, z_mm] of a rotation, with all motions at 0, or emitter; default: the guide's nearer "
        "node, or the middle of a lens's base.",
    )
    join: Join | None = Field(
        None, description="How a lens that turns joins its guide, as for motion.join; default: by seams."
    )
    at_deg: Turn = Field(0.0, description="Current angle of the moving part, counter-clockwise.")
    from_deg: Turn = Field(-3.0, description="First angle of the range.")
    to_deg: Turn = Field(3.0, description="Last angle of the range, greater than from_deg.")
    steps: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        6, description="Number of steps from the first angle to the last."
    )

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        for key in ("pivot", "join"):
            if self.kind == "bend" and getattr(self, key) is not None:
                raise refused(key, "does not apply to a bend", value=getattr(self, key), remedy="leave it out")
        if not self.from_deg < self.to_deg:
            raise refused("from_deg", f"must be less than to_deg = {self.to_deg}", value=self.from_deg)
        if not self.from_deg <= self.at_deg <= self.to_deg:
            limit = f"must lie from from_deg = {self.from_deg:g} to to_deg = {self.to_deg:g}"
            raise refused("at_deg", limit, value=self.at_deg)
        return self

    def angles_deg(self) -> tuple[float, ...]:
        """Return the angles of the range in ascending order, including both ends."""
        step = (self.to_deg - self.from_deg) / self.steps
        inner = (self.from_deg + i * step for i in range(1, self.steps))
        return (self.from_deg, *(0.0 if abs(angle) < 1e-9 * step else angle for angle in inner), self.to_deg)


class Network(Strict):
    """A network of guides with its lenses, emitters, receivers and motions."""

    table: ClassVar[str] = "network"

    lit: Text | None = Field(None, description="Emitter that is lit; default: the first.")
    fixed: Text | None = Field(None, description="Node that stays fixed while parts move; default: the first.")
    nodes: tuple[Node, ...] = Field((), description="Nodes where guides meet or end.")
    guides: tuple[Guide, ...] = Field((), description="The guides.")
    lenses: tuple[PlacedLens, ...] = Field((), description="Its lenses.")
    emitters: tuple[PlacedEmitter, ...] = Field((), description="Emitters, which are lit in turn.")
    receivers: tuple[PlacedReceiver, ...] = Field((), description="Its receivers.")
    motion: tuple[NamedMotion, ...] = Field((), description="Its motions.")
    reading: tuple[Reading, ...] = Field((), description="Named expressions of received powers.")

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        for key in LISTS:
            _check_twice(key, [one.name for one in getattr(self, key)])
        parts = [one.name for key in ("guides", "lenses", "emitters") for one in getattr(self, key)]
        for key, name, kind, known in self._names():
            if name is not None and name not in known:
                limit = f"is not the name of a {kind}; known names: {', '.join(known) or 'none'}"
                raise refused(key, limit, value=name)
        for number, motion in enumerate(self.motion):
            before = [one.name for one in self.motion[:number] if one.part == motion.part]
            if before:
                limit = f"is already moved by {before[0]}"
                raise refused(f"motion[{number}].part", limit, value=motion.part, remedy="leave one of them out")
            lenses = {lens.name: lens for lens in self.lenses}
            if motion.join is not None and (motion.part not in lenses or lenses[motion.part].guide is not None):
                limit = "applies only to a lens at the end of a guide"
                raise refused(f"motion[{number}].join", limit, value=motion.join, remedy="leave it out")
            if motion.pivot == "emitter" and motion.part in [guide.name for guide in self.guides]:
                raise refused(f"motion[{number}].pivot", "applies only to a lens or an emitter", value=motion.pivot)
            if isinstance(motion.pivot, tuple) and motion.part in self._on_sides():
                limit, remedy = "is on a side", 'set pivot = "emitter", or place it at the end of a guide'
                raise refused(f"motion[{number}].part", limit, value=motion.part, remedy=remedy)
            if motion.kind == "rotation" and parts.count(motion.part) > 1:
                limit = "is the name of several parts"
                raise refused(f"motion[{number}].part", limit, value=motion.part, remedy="give each part its own name")
        _ = self.formulas  # parsed here to reject an invalid one
        return self

    def _on_sides(self) -> set[str]:
        """Return the names of lenses on sides, and of emitters on sides or in front of these lenses."""
        lenses = {lens.name for lens in self.lenses if lens.guide is not None}
        return lenses | {
            emitter.name for emitter in self.emitters if emitter.guide is not None or emitter.lens in lenses
        }

    @property
    def formulas(self) -> tuple[Formula, ...]:
        """The parsed formulas of the network's readings."""
        emitters, receivers = ([one.name for one in many] for many in (self.emitters, self.receivers))
        return tuple(
            Formula.of(reading, emitters, receivers, f"reading[{i}].value") for i, reading in enumerate(self.reading)
        )

    def _names(self) -> Iterator[tuple[str, str | None, str, list[str]]]:
        """Yield each key that refers to a name, with that name, the kind of part it must name, and those known."""
        known = {key: [one.name for one in getattr(self, key)] for key in LISTS}
        yield "lit", self.lit, "emitter", known["emitters"]
        yield "fixed", self.fixed, "node", known["nodes"]
        for number, guide in enumerate(self.guides):
            for place, name in enumerate(guide.nodes):
                yield f"guides[{number}].nodes[{place}]", name, "node", known["nodes"]
        for key in ("lenses", "emitters", "receivers"):
            for number, one in enumerate(getattr(self, key)):
                yield f"{key}[{number}].node", one.node, "node", known["nodes"]
                yield f"{key}[{number}].guide", one.guide, "guide", known["guides"]
        for number, emitter in enumerate(self.emitters):
            yield f"emitters[{number}].lens", emitter.lens, "lens", known["lenses"]
        for number, motion in enumerate(self.motion):
            kinds = ("guides",) if motion.kind == "bend" else ("guides", "lenses", "emitters")
            names = [name for kind in kinds for name in known[kind]]
            yield f"motion[{number}].part", motion.part, "guide" if motion.kind == "bend" else "part", names


LISTS = ("nodes", "guides", "lenses", "emitters", "receivers", "motion", "reading")


def _check_twice(key: str, names: list[str]) -> None:
    """Raise an error if two entries of the same kind have the same name."""
    for name, count in Counter(names).items():
        if count > 1:
            second = [number for number, one in enumerate(names) if one == name][1]
            limit = f"is also the name of {key}[{names.index(name)}]"
            raise refused(f"{key}[{second}].name", limit, value=name, remedy="give it another name")
