"""The design: everything that determines a sensor and its simulation, as frozen tables.

A `Design` stores the user's choices and nothing derived from them. Its keys are those of the design file; they end in
the unit. The defaults describe the paper's sensor at 860 nm, so a file contains only the differences. Later stages
check whether the design can be built (an oval beyond tangency, a self-intersecting body).

Public names: `Design` and `Trace`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PrivateAttr, model_validator

from solen.errors import SpecError
from solen.spec.body import Body, Lens, Material, Receivers
from solen.spec.combinations import check_combinations
from solen.spec.fabricate import Fabricate
from solen.spec.light import Ambient, Emitter
from solen.spec.motion import Motion
from solen.spec.network import Network
from solen.spec.readout import Readout
from solen.spec.soft import Hold, Mechanics, Press, Pull
from solen.spec.strict import Strict, Text, nearest, reported_as
from solen.spec.tolerance import Tolerance
from solen.spec.wall import Wall

READOUT_PARTS = ("part", "emitter_part", "trimmer", "adc")
"""Readout keys that name parts."""


def is_file_path(name: str | None) -> bool:
    """Return whether a resin or a part is specified by the path of a file, not by a name in the library."""
    return name is not None and (name.endswith(".toml") or "/" in name or "\\" in name)


class Trace(Strict):
    """Options of the ray trace."""

    table: ClassVar[str] = "trace"
    reserved: ClassVar[frozenset[str]] = frozenset({"min_weight", "seed"})

    mode: Literal["count", "power", "roulette"] = Field(
        "count",
        description="What a ray does at a face. count: it is refracted, or totally reflected, with all its power; "
        "power: it splits into both Fresnel branches; roulette: it follows one branch, chosen at random.",
    )
    dimension: Annotated[
        Literal["2d", "extruded"], reported_as("must be '2d' (in the plane) or 'extruded' (in space)")
    ] = Field(
        "2d",
        description="2d: in the plane of the sensor; extruded: in space, in a body of thickness body.thickness_mm.",
    )


class Design(Strict):
    """A sensor: its name, material, optics, body, motion and trace.

    Two designs are equal if their tables are equal and they refer to the same files.
    """

    name: Text = Field(description="the name of the design, one line.")
    material: Material = Field(description='the printed material, index = 1.44 or resin = "pmma".')
    emitter: Emitter = Field(default_factory=Emitter, description="The light source.")
    ambient: Ambient = Field(default_factory=Ambient, description="Ambient light.")
    lens: Lens = Field(default_factory=Lens, description="The lens.")
    body: Body = Field(default_factory=Body, description="The printed guide.")
    network: Network = Field(
        default_factory=Network, description="Guides, lenses, emitters and receivers of a network."
    )
    wall: tuple[Wall, ...] = Field((), description="Surface finish of parts of the walls, and the medium outside.")
    receivers: Receivers = Field(default_factory=Receivers, description="The receivers.")
    motion: Motion = Field(default_factory=Motion, description="The motion and the sweep.")
    hold: tuple[Hold, ...] = Field((), description="Supports of a soft body.")
    press: tuple[Press, ...] = Field((), description="Fingers that press on the soft body.")
    pull: tuple[Pull, ...] = Field((), description="Forces that pull on the soft body.")
    mechanics: Mechanics = Field(default_factory=Mechanics, description="Elasticity of the soft body.")
    trace: Trace = Field(default_factory=Trace, description="Options of the ray trace.")
    tolerance: Tolerance = Field(default_factory=Tolerance, description="Tolerances of the numbers in the design.")
    fabricate: Fabricate = Field(
        default_factory=Fabricate, description="Seats for the electronics in the printed part."
    )
    readout: Readout = Field(default_factory=Readout, description="Conversion of received light to voltage.")

    _folder: Path = PrivateAttr(default_factory=Path)
    _shared: Emitter | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        if self.body.lens_is_drawn and "moves" not in self.motion.model_fields_set:
            # only the emitter can move without tearing a drawn outline
            self.__dict__["motion"] = self.motion.model_copy(update={"moves": ("emitter",)})
        check_combinations(self)
        return self

    def set(self, values: Mapping[str, Any] | None = None, /, **keys: Any) -> "Design":
        """Return a copy of the design with some values changed.

        Parameters
        ----------
        values
            New values by dotted key, as in TOML: ``{"lens.focus_mm": 25}``; None resets an optional key to its default.
        keys
            New values of keys that occur in a single table, without its name: ``focus_mm=25``.

        Raises
        ------
        SpecError
            If a key is unknown or occurs in several tables, or if the design would be invalid.
        """
        from solen.spec.toml import with_values

        return with_values(self, dict(values or {}) | {self._dotted(key): value for key, value in keys.items()})

    @classmethod
    def _dotted(cls, key: str) -> str:
        """Return the dotted form of a key that occurs in a single table; ``name`` (of the design) is unchanged."""
        tables: dict[str, Any] = {name: field.annotation for name, field in cls.model_fields.items()}
        keys = {name: kind.model_fields for name, kind in tables.items() if hasattr(kind, "model_fields")}
        dotted = [f"{name}.{key}" for name, fields in keys.items() if key in fields]
        if key == "name" or len(dotted) == 1:
            return dotted[0] if dotted else key
        if dotted:
            remedy = f'specify the table: design.set({{"{dotted[0]}": ...}})'
            raise SpecError(key, limit=f"is a key of several tables: {', '.join(dotted)}", remedy=remedy)
        near = nearest(key, (field for fields in keys.values() for field in fields))
        raise SpecError(
            key, limit="unknown key", remedy=f"did you mean {near}?" if near else "list the keys with solen schema"
        )

    @property
    def folder(self) -> Path:
        """Base folder of relative paths: the design file's folder, or the working directory for a design in memory."""
        return self._folder

    @property
    def resin_file(self) -> Path | None:
        """Path of the resin file, or None if the design gives an index or names a resin in the library."""
        return self.named_file(self.material.resin)

    @property
    def part_file(self) -> Path | None:
        """Path of the emitter's part file, or None if the emitter has no part or its part is in the library."""
        return self.named_file(self.emitter.part)

    @property
    def receiver_file(self) -> Path | None:
        """Path of the part file of the receiver that the pockets fit, or None if that receiver is in the library."""
        return self.named_file(self.fabricate.receiver_part)

    @property
    def files(self) -> dict[str, Path]:
        """Paths of the files named in the design, keyed by design key."""
        paths = {
            "material.resin": self.resin_file,
            "emitter.part": self.part_file,
            "emitter.pattern_file": self.file_of(self.emitter.pattern_file),
            "emitter.ray_file": self.file_of(self.emitter.ray_file),
            "lens.profile": self.profile_file,
            "body.file": self.outline_file,
            "fabricate.receiver_part": self.receiver_file,
            **{f"readout.{key}": self.named_file(getattr(self.readout, key)) for key in READOUT_PARTS},
        }
        return {key: path for key, path in paths.items() if path is not None}

    def file_of(self, name: str | None) -> Path | None:
        """Return the path of a file named in the design, or None if the name is None."""
        return None if name is None else self._folder / name

    def named_file(self, name: str | None) -> Path | None:
        """Return the path of a resin or part file, or None if it is in the library or not specified."""
        return self.file_of(name) if is_file_path(name) else None

    @property
    def profile_file(self) -> Path | None:
        """Path of the profile of a measured or layered lens, or None if the design names none."""
        return self.file_of(self.lens.profile)

    @property
    def outline_file(self) -> Path | None:
        """Path of the drawing of an outline or a network, or None if the body is not drawn."""
        return self.file_of(self.body.file)

    @property
    def shared_emitter(self) -> Emitter:
        """The ``[emitter]`` table of the file; in a network, these are the values that all emitters share."""
        return self._shared or self.emitter

    def with_emitter(self, emitter: Emitter, network: Network) -> Self:
        """Return a copy of a network design with one emitter lit.

        The table of the lit emitter replaces the shared ``[emitter]`` table, which remains available as
        `shared_emitter`.
        """
        copy = self.model_copy(update={"emitter": emitter, "network": network})
        copy._shared = self.shared_emitter
        return copy

    def in_folder(self, folder: Path) -> Self:
        """Return the design with its relative paths based on another folder."""
        copy = self.model_copy()
        copy._folder = folder
        return copy

    def __eq__(self, other: Any) -> bool:
        if not isinstance(other, Design):
            return NotImplemented
        return self.__dict__ == other.__dict__ and self.files == other.files
