"""The content of a resin file as a typed result: its tables, its index at some wavelengths, and its warnings.

`facts_of` returns the content of a resin, and `listed` the resins of the library.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field

from solen.errors import SolenError
from solen.material.dispersion import Dispersion
from solen.material.resin import Cure, Loss, Part, Resin, Source, Stiffness, library, library_resin
from solen.ranks import Caution
from solen.results import HIDDEN, Result, reported
from solen.spec.strict import Options, Wavelength, error_context

LISTED_NM = (589.3, 860.0)
"""Wavelengths at which indices are listed: the sodium D line of refractometers, and that of the paper's emitter."""


class ShowOptions(Options):
    """Options for showing a resin."""

    at_nm: tuple[Wavelength, ...] = ()
    """A wavelength in nm at which to show the index; repeatable; default: 589.3 and 860 nm."""


@dataclass(frozen=True)
class IndexAt:
    """Index and its standard uncertainty at a wavelength; each is None if not known."""

    wavelength_nm: float
    n: float | None
    u_n: float | None


class ResinFacts(Result):
    """Complete content of a resin file.

    Attributes
    ----------
    resin
        Name in the library, or path of the file.
    at
        Index at the requested wavelengths.
    contents
        The resin itself.
    """

    resin: str
    at: tuple[IndexAt, ...]
    contents: Resin = field(metadata=HIDDEN)

    @reported
    def name(self) -> str:
        """Name of the resin."""
        return self.contents.name

    @reported
    def source(self) -> str:
        """Source of the numbers."""
        return self.contents.source

    @reported
    def notes(self) -> str:
        """Notes on the resin."""
        return self.contents.notes

    @reported
    def index(self) -> Dispersion | None:
        """Formula or table of the index; None if the index is not known."""
        return self.contents.index if self.contents.has("index") else None

    @reported
    def loss(self) -> Loss | None:
        """Loss; None if the loss is not known."""
        return self.contents.loss if self.contents.has("loss") else None

    @reported
    def cure(self) -> Cure | None:
        """Working curve; None if it was not measured."""
        return self.contents.cure

    @reported
    def stiffness(self) -> Stiffness | None:
        """Modulus and hyperelastic model; None if they were not measured."""
        return self.contents.stiffness

    @reported
    def formulation(self) -> tuple[Part, ...]:
        """Components of the mixture."""
        return self.contents.formulation

    @reported
    def sources(self) -> tuple[Source, ...]:
        """Measured files from which the tables were determined."""
        return self.contents.sources

    @reported
    def simulated(self) -> bool:
        """Whether any table was determined from simulated data."""
        return any(source.simulated for source in self.sources)

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings about the tables."""
        return self.contents.warnings


class ResinList(Result):
    """The resins of the library."""

    resins: tuple[ResinFacts, ...]


def facts_of(resin: Resin, name: str, at_nm: Sequence[float] = ()) -> ResinFacts:
    """Return the content of a resin, with its index at the given wavelengths, by default at `LISTED_NM`.

    Raises
    ------
    DataError
        If the index is not known at a requested wavelength.
    """
    with error_context(f"resin {resin.name}"):
        for nm in at_nm:
            resin.index.index(nm)
    return ResinFacts(name, tuple(_at(resin, nm) for nm in at_nm or LISTED_NM), resin)


def listed() -> ResinList:
    """Return the resins of the library with their indices."""
    return ResinList(tuple(facts_of(library_resin(name), name) for name in library()))


def _at(resin: Resin, wavelength_nm: float) -> IndexAt:
    """Return the index at a wavelength, with None for an unknown index."""
    with contextlib.suppress(SolenError):
        return IndexAt(wavelength_nm, resin.index.index(wavelength_nm), resin.index.u_index(wavelength_nm))
    return IndexAt(wavelength_nm, None, None)
