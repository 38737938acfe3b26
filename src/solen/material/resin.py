"""Resins: files that describe a material, a small library of them, and the optical constants of a design's material.

A resin file is TOML with ``schema = 1``, a ``name``, a ``source``, and a table for each known property: an ``[index]``
of one of the kinds in `solen.material.dispersion`, a ``[loss]``, a ``[cure]``, a ``[stiffness]``, a ``[[formulation]]``
by weight, and the measured files as ``[[sources]]``. A design names a resin of the library or a file; the index is
evaluated at the wavelength of the design's emitter.

`load_resin`, `library` and `library_resin` read resins; `dumps_resin` writes a file; and `optical` returns the optical
constants of a design's material.
"""

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar, Self

import tomli_w
from pydantic import Field, field_validator, model_validator

from solen.errors import DataError, SolenError
from solen.material.dispersion import KINDS, Covariance, Dispersion, Unknown, check_covariance
from solen.material.mix import MAX_TOTAL_ERROR_PERCENT, TOTAL_PERCENT
from solen.parts import light_of
from solen.ranks import Caution, do_not_use, prefixed, warning
from solen.results import HIDDEN, reported
from solen.spec import Design, Material
from solen.spec.shipped import Library
from solen.spec.strict import (
    Document,
    Migrations,
    NotNegative,
    Number,
    Positive,
    Strict,
    Text,
    error_context,
    nearest,
    refused,
    repeated,
)

RESIN_SCHEMA = 1
RESIN_MIGRATIONS: Migrations = {}  # old version -> function that converts its tables to the next version
MAX_LOSS_DISTANCE_NM = 20.0
"""Largest difference between the emitter's wavelength and that of the loss measurement that causes no warning."""
MEASURED = ("index", "loss", "cure", "stiffness")
"""Tables that are determined from measurements and may contain warnings."""

Interval = tuple[Number, Number]


class OrientationLoss(Strict):
    """Loss of guides that were built in one orientation."""

    error: ClassVar[type[SolenError]] = DataError

    orientation: Text = Field(description="build orientation.")
    absorption_per_mm: NotNegative = Field(description="power absorption coefficient per mm, base e.")
    u_absorption_per_mm: NotNegative | None = Field(
        None, description="Standard uncertainty of the absorption coefficient."
    )
    interval95_per_mm: Interval | None = Field(None, description="95 % interval of the absorption coefficient.")


class Loss(Strict):
    """Loss of a resin at one wavelength."""

    table: ClassVar[str] = "loss"
    error: ClassVar[type[SolenError]] = DataError

    absorption_per_mm: NotNegative = Field(0.0, description="Power absorption coefficient per mm, base e.")
    u_absorption_per_mm: NotNegative | None = Field(
        None, description="Standard uncertainty of the absorption coefficient."
    )
    interval95_per_mm: Interval | None = Field(None, description="95 % interval of the absorption coefficient.")
    wavelength_nm: Positive | None = Field(None, description="Wavelength of the measurement, in nm.")
    orientation: str = Field("", description="Build orientation of the guides; empty for all.")
    by_orientation: tuple[OrientationLoss, ...] = Field((), description="Loss of each orientation separately.")
    warnings: tuple[Text, ...] = Field((), description="Warnings about the loss, one sentence each.")


class Cure(Strict):
    """Jacobs' working curve: cure depth = Dp ln(E/Ec)."""

    table: ClassVar[str] = "cure"
    error: ClassVar[type[SolenError]] = DataError

    Dp_um: Positive = Field(description="penetration depth in µm.")
    Ec_mJ_per_cm2: Positive = Field(description="critical exposure in mJ/cm².")
    covariance: Covariance | None = Field(None, description="Covariance of (Dp_um, Ec_mJ_per_cm2).")
    interval95_Dp_um: Interval | None = Field(None, description="95 % interval of Dp.")
    interval95_Ec_mJ_per_cm2: Interval | None = Field(None, description="95 % interval of Ec.")
    wavelength_nm: Positive | None = Field(None, description="Wavelength of the exposure in nm.")
    irradiance_mW_per_cm2: Positive | None = Field(None, description="Irradiance of the exposure in mW/cm².")
    warnings: tuple[Text, ...] = Field((), description="Warnings about the working curve, one sentence each.")

    @model_validator(mode="after")
    def _check_covariance(self) -> Self:
        check_covariance(self.covariance, 2)
        return self


class Stiffness(Strict):
    """Young's modulus over a specified strain range, and the hyperelastic model fitted to the whole curve."""

    table: ClassVar[str] = "stiffness"
    error: ClassVar[type[SolenError]] = DataError

    modulus_MPa: Positive = Field(description="modulus in MPa.")
    u_modulus_MPa: NotNegative | None = Field(None, description="Standard uncertainty of the modulus.")
    interval95_MPa: Interval | None = Field(None, description="95 % interval of the modulus.")
    strain_range: Interval | None = Field(
        None, description="Lowest and highest strain over which the modulus was fitted."
    )
    test: str = Field("", description="Mode of loading: compression, tension.")
    model: str = Field("", description="Hyperelastic model of the whole curve.")
    parameters: dict[str, Number] = Field(default_factory=dict, description="Parameters of the model, keyed by name.")
    u_parameters: dict[str, NotNegative] = Field(
        default_factory=dict, description="Standard uncertainties of the parameters."
    )
    warnings: tuple[Text, ...] = Field((), description="Warnings about the stiffness, one sentence each.")

    @model_validator(mode="before")
    @classmethod
    def _refuse_relaxation(cls, data: Any) -> Any:
        if isinstance(data, dict) and "prony" in data:
            limit = "relaxation of the modulus is not modelled: a soft body follows every load immediately"
            raise refused("prony", limit, remedy="omit it")
        return data


class Part(Strict):
    """A component of a formulation."""

    error: ClassVar[type[SolenError]] = DataError

    component: Text = Field(description="name of the component.")
    wt_percent: Positive = Field(description="mass fraction in the whole mixture, in per cent.")


class Source(Strict):
    """A measured file from which a table was determined."""

    error: ClassVar[type[SolenError]] = DataError

    of: Text = Field(description="Table determined from the file.")
    file: str = Field("", description="Name of the file.")
    sha256: str = Field("", description="Checksum of the file contents.")
    format: str = Field("", description="Format in which the file was read.")
    instrument: str = Field("", description="Instrument named in the file.")
    date: str = Field("", description="Date given in the file.")
    simulated: bool = Field(False, description="Whether the data were simulated, not measured.")


class Resin(Strict):
    """A material: index against wavelength, loss, working curve, stiffness, and the sources of these numbers."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="name of the resin, one line.")
    source: str = Field("", description="Source of the numbers.")
    notes: str = Field("", description="Further notes.")
    index: Dispersion = Field(default_factory=Unknown, description="Index against wavelength; a table with a kind.")
    loss: Loss = Field(default_factory=Loss, description="Loss of light in the resin.")
    cure: Cure | None = Field(None, description="Working curve.")
    stiffness: Stiffness | None = Field(None, description="Stiffness of the cured resin.")
    formulation: tuple[Part, ...] = Field((), description="Components of the mixture.")
    sources: tuple[Source, ...] = Field((), description="Files of the measurements.")

    @field_validator("index", mode="before")
    @classmethod
    def _dispersion(cls, value: Any) -> Any:
        """Return the dispersion of the kind that the table names."""
        if not isinstance(value, dict):
            return value
        limit = f"must be one of {', '.join(KINDS)}"
        if "kind" not in value:
            raise refused("kind", f"is required and {limit}", remedy='add, for example, kind = "cauchy"')
        kind = KINDS.get(value["kind"]) if isinstance(value["kind"], str) else None
        if kind is None:
            near = nearest(str(value["kind"]), KINDS)
            raise refused("kind", limit, value=value["kind"], remedy=f"did you mean {near}?" if near else "")
        return kind(**value)

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        tables = (*MEASURED, "formulation")
        if not self.model_fields_set & {*tables}:
            raise refused("", f"must have at least one of {', '.join(tables)}", remedy="add, for example, [index]")
        if self.formulation:
            _check_formulation(self.formulation)
        return self

    def has(self, table: str) -> bool:
        """Whether the resin contains a table."""
        return table in self.model_fields_set

    @property
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings about the index, loss, working curve and stiffness."""
        return self.cautions(*MEASURED)

    def cautions(self, *tables: str) -> tuple[Caution, ...]:
        """Return warnings about the given tables: simulated data, and the warnings stored with each table."""
        simulated = [source.of for source in self.sources if source.simulated and source.of in tables]
        warnings = [prefixed(name, warning("from simulated data, not measured")) for name in dict.fromkeys(simulated)]
        stored = {name: table.warnings for name in tables if (table := getattr(self, name)) is not None}
        return (*warnings, *(prefixed(name, Caution(text)) for name, texts in stored.items() for text in texts))


def _check_formulation(parts: tuple[Part, ...]) -> None:
    """Raise unless the components of a formulation have different names and fractions that add up to 100 %."""
    twice = repeated(part.component for part in parts)
    if twice is not None:
        raise refused("formulation", "each component may occur once", value=twice, remedy="add up its fractions")
    total = sum(part.wt_percent for part in parts)
    if abs(total - TOTAL_PERCENT) > MAX_TOTAL_ERROR_PERCENT:
        limit = f"must add up to {TOTAL_PERCENT:g} % by weight, to within {MAX_TOTAL_ERROR_PERCENT:g} %"
        remedy = "correct the fractions of the components"
        raise refused("formulation", limit, value=f"{total:g} %", remedy=remedy)


@dataclass(frozen=True)
class Optical:
    """Optical constants of a material at one wavelength.

    Attributes
    ----------
    index, u_index
        Refractive index and its standard uncertainty (None if unknown).
    absorption_per_mm
        Absorption coefficient per mm, base e.
    source
        Source of the numbers, in words.
    dispersion
        Index against wavelength, for light with a spectrum; None if only one value is known.
    u_absorption_per_mm
        Standard uncertainty of the absorption coefficient; None if unknown.
    warnings
        Warnings about these numbers, one sentence each.
    """

    index: float
    u_index: float | None
    absorption_per_mm: float
    source: str
    dispersion: Dispersion | None = field(default=None, compare=False, repr=False, metadata=HIDDEN)
    u_absorption_per_mm: float | None = None
    warnings: tuple[Caution, ...] = ()

    @reported
    def mode(self) -> str | None:
        """How the index was determined; None if not specified."""
        return None if self.dispersion is None else self.dispersion.mode or None


def load_resin(path: Path | str) -> Resin:
    """Read a resin from a file.

    Raises
    ------
    DataError
        If the file cannot be read, is not TOML, has another schema, or is not a valid resin.
    """
    return _library().load(path)


def dumps_resin(resin: Resin, comment: str = "") -> str:
    """Return a resin as TOML text that `load_resin` can read, without defaults; ``comment`` is its first line."""
    tables: Document = {"schema": RESIN_SCHEMA}
    for key in Resin.model_fields:
        value = getattr(resin, key)
        if key not in resin.model_fields_set or value is None:
            continue
        if isinstance(value, tuple):
            tables[key] = [entry.model_dump(exclude_defaults=True) for entry in value]
        elif isinstance(value, Dispersion):
            tables[key] = {"kind": value.kind} | value.model_dump(exclude_defaults=True)
        else:
            tables[key] = value.model_dump(exclude_defaults=True) if isinstance(value, Strict) else value
    return "".join([f"# {comment}\n" if comment else "", tomli_w.dumps(tables)])


def _library() -> Library[Resin]:
    return Library(files("solen.material") / "library", "resin", Resin, RESIN_SCHEMA, RESIN_MIGRATIONS)


def library() -> tuple[str, ...]:
    """Return the sorted names of the resins in the library."""
    return _library().names()


def library_resin(name: str) -> Resin:
    """Return a resin of the library; raise `DataError` with the nearest name if the name is unknown."""
    return _library().shipped(name)


def optical(design: Design) -> Optical:
    """Return the optical constants of a design's material at the wavelength of the design's emitter.

    An absorption coefficient in the design overrides that of the resin.

    Raises
    ------
    DataError
        If the resin cannot be found or read, or its index is not known at that wavelength.
    """
    material = design.material
    if material.resin is None:
        assert material.index is not None  # noqa: S101  the table gives exactly one of the two
        return Optical(material.index, None, material.absorption_per_mm, "the design's material.index")
    resin = resin_of(material.resin, design.resin_file)
    wavelength_nm = light_of(design).wavelength_nm
    with error_context(f"resin {resin.name}"):
        index, u_index = resin.index.index(wavelength_nm), resin.index.u_index(wavelength_nm)
    overridden = material.sets_absorption
    return Optical(
        index,
        u_index,
        material.absorption_per_mm if overridden else resin.loss.absorption_per_mm,
        ": ".join(filter(None, (resin.name, resin.source))),
        resin.index,
        None if overridden else resin.loss.u_absorption_per_mm,
        (
            *resin.cautions("index", "loss"),
            *(_hidden_loss(material, resin) if overridden else distant_wavelength(resin.loss, wavelength_nm)),
        ),
    )


def _hidden_loss(material: Material, resin: Resin) -> list[Caution]:
    """Return a warning if a design's absorption of 0, perhaps left over from an example, hides the resin's loss."""
    if material.absorption_per_mm > 0.0 or not resin.loss.absorption_per_mm > 0.0:
        return []
    return [
        do_not_use(
            f"material.absorption_per_mm = 0 overrides the loss of {resin.name}, {resin.loss.absorption_per_mm:.3g} "
            "per mm, so the sensor is traced without loss; remove that line to use the resin's loss"
        )
    ]


def resin_of(name: str, path: Path | None) -> Resin:
    """Return the resin in a file or, without a path, the resin of the library with this name."""
    return library_resin(name) if path is None else load_resin(path)


def distant_wavelength(loss: Loss, wavelength_nm: float) -> list[Caution]:
    """Return a warning if the loss was measured more than `MAX_LOSS_DISTANCE_NM` from a wavelength."""
    if loss.wavelength_nm is None or abs(loss.wavelength_nm - wavelength_nm) <= MAX_LOSS_DISTANCE_NM:
        return []
    distance_nm = abs(loss.wavelength_nm - wavelength_nm)
    return [
        warning(
            f"the loss was measured at {loss.wavelength_nm:g} nm, {distance_nm:g} nm from the emitter's "
            f"{wavelength_nm:g} nm; absorption changes with wavelength"
        )
    ]
