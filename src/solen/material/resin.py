"""Resins: files that say what a material's index and loss are, a small library of them, and what a design uses.

The idea: a resin is data with a source. Its file is TOML with ``schema = 1``, a ``name``, a ``source``, an ``[index]``
of one of the kinds of `solen.material.dispersion`, and optionally a ``[loss]``. A design names a resin of the library
or a file; the index is evaluated at its emitter's wavelength.

The interface: `load_resin`, `library`, `library_resin`; `optical` gives the numbers of a design's material.
"""

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field, field_validator

from solen.errors import DataError, SolenError
from solen.files import read_text
from solen.material.dispersion import KINDS, Dispersion
from solen.parts import light_of
from solen.spec import Design
from solen.spec.shelf import Shelf
from solen.spec.strict import Migrations, NotNegative, Strict, Text, migrated, nearest, parse_toml, refused, told_of

RESIN_SCHEMA = 1
RESIN_MIGRATIONS: Migrations = {}  # old version -> tables of that version into those of the next

_SHELF = Shelf(files("solen.material") / "library", "resin")


class Loss(Strict):
    """What a resin takes from the light."""

    table: ClassVar[str] = "loss"
    error: ClassVar[type[SolenError]] = DataError

    absorption_per_mm: NotNegative = Field(0.0, description="Absorption of power per mm, base e.")


class Resin(Strict):
    """A material: its index against wavelength, its loss, and where the numbers come from."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="the resin's name, one line.")
    source: str = Field("", description="Where the numbers come from.")
    notes: str = Field("", description="Anything worth knowing.")
    index: Dispersion = Field(description="a table [index] with its kind.")
    loss: Loss = Field(default_factory=Loss, description="What it takes from the light.")

    @field_validator("index", mode="before")
    @classmethod
    def _of_its_kind(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        kinds = f"must be one of {', '.join(KINDS)}"
        if "kind" not in value:
            raise refused("kind", f"missing: {kinds}", remedy='add e.g. kind = "cauchy"')
        kind = KINDS.get(value["kind"]) if isinstance(value["kind"], str) else None
        if kind is None:
            near = nearest(str(value["kind"]), KINDS)
            raise refused("kind", kinds, value=value["kind"], remedy=f"did you mean {near}?" if near else "")
        return kind(**value)


@dataclass(frozen=True)
class Optical:
    """What light meets in a material at one wavelength.

    Attributes
    ----------
    index, u_index
        Refractive index and its standard uncertainty (None where unknown).
    absorption_per_mm
        Absorption of power per mm, base e.
    source
        Where the numbers come from, in words.
    dispersion
        Index by wavelength, for light of several; None where a single number is all that is known.
    """

    index: float
    u_index: float | None
    absorption_per_mm: float
    source: str
    dispersion: Dispersion | None = field(default=None, compare=False, repr=False)


def _resin(text: str, what: str) -> Resin:
    data = parse_toml(text, what, DataError)
    data = migrated(data, what, current=RESIN_SCHEMA, migrations=RESIN_MIGRATIONS, error=DataError)
    with told_of(what):
        return Resin(**data)


def load_resin(path: Path | str) -> Resin:
    """Resin of a file.

    Raises
    ------
    DataError
        Where the file cannot be read, is not TOML, has another schema, or is not a valid resin.
    """
    path = Path(path)
    return _resin(read_text(path, DataError), str(path))


def library() -> tuple[str, ...]:
    """Names of the resins that solen ships, sorted."""
    return _SHELF.names()


def library_resin(name: str) -> Resin:
    """Resin of the library; `DataError` with the nearest name where there is none of that name."""
    return _resin(_SHELF.text(name), f"resin {name}")


def optical(design: Design) -> Optical:
    """Index, uncertainty and absorption of a design's material at its emitter's wavelength.

    The design's own absorption, where stated, overrules the resin's.

    Raises
    ------
    DataError
        Where the resin cannot be found or read, or does not know that wavelength.
    """
    material = design.material
    if material.resin is None:
        assert material.index is not None  # noqa: S101  the table gives exactly one of the two
        return Optical(material.index, None, material.absorption_per_mm, "the design's material.index")
    path = design.resin_file
    resin = library_resin(material.resin) if path is None else load_resin(path)
    wavelength_nm = light_of(design).wavelength_nm
    with told_of(f"resin {resin.name}"):
        index, u_index = resin.index.index(wavelength_nm), resin.index.u_index(wavelength_nm)
    stated = material.states_absorption
    absorption_per_mm = material.absorption_per_mm if stated else resin.loss.absorption_per_mm
    return Optical(index, u_index, absorption_per_mm, ": ".join(filter(None, (resin.name, resin.source))), resin.index)
