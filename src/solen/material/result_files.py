"""Result files of `solen resin`, and the tables of a resin file that are made from them.

The result of `solen resin index`, `cutback`, `cure` or `stiffness` is a JSON file with all data, including arrays. A
resin file contains only the values that a design uses, with their uncertainties, mode and warnings. The values of a
result that a resin needs must be present and valid; all others are ignored.

`result_of` reads a result with one of the `READERS`; `as_table` returns the table for the resin file, and
`measured_files` the sources.
"""

import math
from typing import Any, ClassVar, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from solen.errors import DataError, SolenError
from solen.material.cross_checks import Row
from solen.material.dispersion import KINDS, Dispersion, Tabulated
from solen.material.index_table import gaps, missing_u, thinned
from solen.material.resin import Cure, Interval, Loss, OrientationLoss, Source, Stiffness
from solen.material.warning_prefixes import BY_ORIENTATION, NOT_STORED
from solen.ranks import Caution, unranked, warning
from solen.spec.objects import parse_json
from solen.spec.strict import NotNegative, Number, Options, Positive, Strict, Text, Wavelength, refused

PER_MM_OF_DB_PER_CM = math.log(10.0) / 100.0
LOSS_TOLERANCE = 1e-6
"""Tolerance, relative and in 1/mm, between an absorption coefficient and the loss in dB/cm stored with it."""


class Selection(Options):
    """Selection of the results to use, and wavelengths that they do not contain."""

    orientation: str = ""
    """Use the loss of guides that were built in this orientation."""
    loss_wavelength_nm: Wavelength | None = None
    """Wavelength at which the loss was measured."""
    cure_wavelength_nm: Wavelength | None = None
    """Wavelength of the exposure for the working curve."""
    label: str = ""
    """Use the stiffness of the material with this label."""


_NO_SELECTION = Selection()


class _Result(Strict):
    """Result of a command; values that a resin file does not contain are ignored."""

    model_config = ConfigDict(extra="ignore")
    error: ClassVar[type[SolenError]] = DataError

    of: ClassVar[str]
    warnings: tuple[Text, ...] = ()
    sources: tuple[dict[str, Any], ...] = ()

    @field_validator("warnings", mode="before")
    @classmethod
    def _single_lines(cls, value: Any) -> Any:
        """Join the lines of each warning."""
        strings = isinstance(value, list) and all(isinstance(text, str) for text in value)
        return [" ".join(text.split()) for text in value] if strings else value

    @property
    def stored_warnings(self) -> tuple[str, ...]:
        """Warnings about the values that a resin file contains."""
        return tuple(text for text in self.warnings if not unranked(text).startswith(NOT_STORED))

    def as_table(self, selection: Selection = _NO_SELECTION) -> Any:
        """Return the table for the resin."""
        raise NotImplementedError  # implemented for each kind of file

    def measured_files(self, selection: Selection = _NO_SELECTION) -> tuple[Source, ...]:  # noqa: ARG002  only the stiffness of several materials needs a selection
        """Return the measured files."""
        keys = Source.model_fields.keys() - {"of"}
        return tuple(
            Source(of=self.of, **{key: value for key, value in source.items() if key in keys and value is not None})
            for source in self.sources
        )


class IndexResult(_Result):
    """Result of `solen resin index` or `solen resin refractometer`."""

    kinds: ClassVar[tuple[str, ...]] = ("index", "refractometer")
    of: ClassVar[str] = "index"

    mode: Text = Field(description="how the index was determined.")
    wavelength_nm: tuple[Positive, ...] = ()
    n: tuple[Number | None, ...] = ()
    u_n: tuple[NotNegative | None, ...] = ()
    k: tuple[Number | None, ...] = ()
    u_k: tuple[NotNegative | None, ...] = ()
    interval95_k: tuple[tuple[Number | None, Number | None], ...] = ()
    fit: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _arrays_match(self) -> Self:
        for key in ("n", "u_n"):
            if len(getattr(self, key)) != len(self.wavelength_nm):
                limit = f"must have {len(self.wavelength_nm)} entries, one per wavelength"
                raise refused(key, limit, value=len(getattr(self, key)))
        return self

    def as_table(self, selection: Selection = _NO_SELECTION) -> Dispersion:  # noqa: ARG002  a file with one index needs no selection
        """Return the index for the resin: the fitted formula or, without one, a table of the measured indices."""
        if self.fit is None:
            return self._tabulated()
        formula = self.fit.get("model", self.fit)
        if not isinstance(formula, dict) or self.fit.get("kind") not in {"cauchy", "sellmeier"}:
            raise DataError("fit", value=self.fit.get("kind"), limit="must be a cauchy or a sellmeier formula")
        kind = KINDS[self.fit["kind"]]
        values = {key: value for key, value in formula.items() if key in kind.model_fields and value is not None}
        return kind(**values | {"kind": self.fit["kind"], "mode": self.mode, "warnings": self.stored_warnings})

    @property
    def extinction(self) -> list[Row]:
        """Extinction coefficient, its uncertainty and upper bound at each wavelength; empty for a refractometer."""
        upper = [high for _, high in self.interval95_k]
        return list(zip(self.wavelength_nm, self.k, self.u_k, upper, strict=False))

    def _tabulated(self) -> Tabulated:
        rows = zip(self.wavelength_nm, self.n, self.u_n, strict=True)
        known = sorted(((nm, n, u) for nm, n, u in rows if n is not None), key=lambda row: row[0])
        if len({nm for nm, _, _ in known}) < 2:
            limit = f"must be known at 2 or more wavelengths, not at {len(known)}"
            raise DataError("n", limit=limit, remedy="see the reasons for the missing values under reason in the file")
        wavelengths, indices, uncertainties = zip(*thinned(known), strict=True)
        u_n = tuple(u for u in uncertainties if u is not None)
        without_u = [nm for nm, _, u in known if u is None]
        return Tabulated(
            wavelength_nm=wavelengths,
            n=indices,
            u_n=u_n if len(u_n) == len(indices) else None,
            mode=self.mode,
            warnings=(
                *self.stored_warnings,
                *gaps([nm for nm, _, _ in known]),
                *missing_u(without_u, len(known)),
            ),
        )


class _Line(_Result):
    """Loss of guides from `solen resin cutback`; without an absorption coefficient if the loss is negative."""

    of: ClassVar[str] = "loss"

    orientation: str = ""
    loss_dB_per_cm: Number = Field(description="loss of power in dB/cm.")
    interval95_loss_dB_per_cm: Interval | None = None
    absorption_per_mm: Number | None = None
    u_absorption_per_mm: NotNegative | None = None

    @model_validator(mode="after")
    def _check_absorption(self) -> Self:
        if self.absorption_per_mm is None:
            return self
        per_mm = self.loss_dB_per_cm * PER_MM_OF_DB_PER_CM
        if not math.isclose(self.absorption_per_mm, per_mm, rel_tol=LOSS_TOLERANCE, abs_tol=LOSS_TOLERANCE):
            limit = f"must be {per_mm:.6g} per mm for a loss of {self.loss_dB_per_cm:g} dB/cm"
            raise refused(
                "absorption_per_mm", limit, value=self.absorption_per_mm, remedy="run solen resin cutback again"
            )
        return self

    def numbers(self) -> tuple[dict[str, Any], list[Caution]]:
        """Return the absorption coefficient for the resin with its uncertainty and interval, and warnings about it.

        A negative loss is impossible: if its interval includes 0, the result is 0 with a warning.
        """
        ends = self.interval95_loss_dB_per_cm
        interval = None if ends is None else tuple(end * PER_MM_OF_DB_PER_CM for end in ends)
        numbers = {
            "absorption_per_mm": self.loss_dB_per_cm * PER_MM_OF_DB_PER_CM,
            "u_absorption_per_mm": self.u_absorption_per_mm,
            "interval95_per_mm": interval,
        }
        if self.loss_dB_per_cm >= 0.0:
            return numbers, []
        if interval is None or interval[1] < 0.0:
            limit = "must be at least 0 within its uncertainty, because a guide cannot amplify"
            remedy = "check the lengths and the readings"
            raise DataError("loss_dB_per_cm", value=self.loss_dB_per_cm, limit=limit, remedy=remedy)
        text = (
            f"the measured loss is negative, {self.loss_dB_per_cm:.2g} dB/cm: 0 is used, but up to {interval[1]:.2g} "
            "per mm is possible"
        )
        return numbers | {"absorption_per_mm": 0.0}, [warning(text)]


class CutbackResult(_Line):
    """Result of `solen resin cutback`."""

    kinds: ClassVar[tuple[str, ...]] = ("cutback",)

    wavelength_nm: Positive | None = None
    by_orientation: tuple[_Line, ...] = ()

    def as_table(self, selection: Selection = _NO_SELECTION) -> Loss:
        """Return the loss for the resin, of all guides or of the selected orientation."""
        orientation, wavelength_nm = selection.orientation, selection.loss_wavelength_nm or self.wavelength_nm
        lines = {line.orientation: line for line in self.by_orientation}
        if orientation and orientation not in lines:
            limit = (
                f"is not in the result, whose orientations are {', '.join(lines)}"
                if lines
                else "is not in the result, which contains no loss of a single orientation"
            )
            raise DataError("--orientation", value=orientation, limit=limit)
        numbers, warnings = (lines[orientation] if orientation else self).numbers()
        stored = [
            text for text in self.stored_warnings if not (orientation and unranked(text).startswith(BY_ORIENTATION))
        ]
        if wavelength_nm is None:
            warnings.append(warning("the wavelength of the measurement is not specified"))
        return Loss(
            **numbers,
            wavelength_nm=wavelength_nm,
            orientation=orientation,
            by_orientation=tuple(
                OrientationLoss(orientation=name, **line.numbers()[0]) for name, line in lines.items()
            ),
            warnings=(*stored, *warnings),
        )


class CureResult(_Result, Cure):
    """Result of `solen resin cure`."""

    model_config = ConfigDict(extra="ignore")

    kinds: ClassVar[tuple[str, ...]] = ("cure",)
    of: ClassVar[str] = "cure"

    def as_table(self, selection: Selection = _NO_SELECTION) -> Cure:
        """Return the working curve for the resin."""
        values = {name: getattr(self, name) for name in Cure.model_fields}
        wavelength_nm = selection.cure_wavelength_nm or self.wavelength_nm
        return Cure(**values | {"wavelength_nm": wavelength_nm, "warnings": self.stored_warnings})


class PenetrationResult(_Result):
    """Result of `solen resin penetration`, for comparison with a working curve."""

    kinds: ClassVar[tuple[str, ...]] = ("penetration",)
    of: ClassVar[str] = "penetration"

    Dp_um: Positive | None = None
    between_Dp_um: Positive | None = None
    u_Dp_um: NotNegative | None = None
    lamp: str | None = None
    lamp_nm: Positive | None = None
    lamp_lines: tuple[tuple[Positive, Positive], ...] | None = None

    def as_table(self, selection: Selection = _NO_SELECTION) -> None:
        """Return None: a resin file contains only the Dp of the working curve."""


class _Model(_Result):
    """Hyperelastic model of a material."""

    kind: Text
    parameters: dict[str, Number]
    u_parameters: dict[str, NotNegative] | None = None


class _Specimen(_Result):
    """File with the measurement of a specimen."""

    file: str = ""


class _Modulus(_Result):
    """Stiffness of one material."""

    of: ClassVar[str] = "stiffness"

    label: str | None = None
    modulus_MPa: Positive = Field(description="modulus in MPa.")
    u_modulus_MPa: NotNegative | None = None
    interval95_modulus_MPa: Interval | None = None
    strain_range: Interval | None = None
    mode: str = ""
    model: _Model | None = None
    specimens: tuple[_Specimen, ...] = ()


class StiffnessResult(_Modulus):
    """Result of `solen resin stiffness`, for one material or several."""

    kinds: ClassVar[tuple[str, ...]] = ("stiffness",)
    groups: tuple[_Modulus, ...] = ()

    def as_table(self, selection: Selection = _NO_SELECTION) -> Stiffness:
        """Return the stiffness for the resin: of the only material, or of the material with the selected label."""
        material = self._material(selection.label)
        model = material.model
        return Stiffness(
            modulus_MPa=material.modulus_MPa,
            u_modulus_MPa=material.u_modulus_MPa,
            interval95_MPa=material.interval95_modulus_MPa,
            strain_range=material.strain_range,
            test=material.mode,
            model=model.kind if model else "",
            parameters=model.parameters if model else {},
            u_parameters=(model.u_parameters or {}) if model else {},
            warnings=material.stored_warnings,
        )

    def measured_files(self, selection: Selection = _NO_SELECTION) -> tuple[Source, ...]:
        """Return the measured files; if there are several materials, those of the selected one."""
        files = {specimen.file for specimen in self._material(selection.label).specimens}
        return tuple(source for source in super().measured_files() if not files or source.file in files)

    def _material(self, label: str) -> _Modulus:
        materials = {group.label or "": group for group in self.groups or (self,)}
        if not label and len(materials) == 1:
            return next(iter(materials.values()))
        if label not in materials:
            names = ", ".join(name or "(without a label)" for name in materials)
            if not label:
                limit, remedy = f"is required: the materials of the result are {names}", "specify one of them"
                raise DataError("--label", limit=limit, remedy=remedy)
            raise DataError("--label", value=label, limit=f"is not in the result, whose materials are {names}")
        return materials[label]


Reader = IndexResult | CutbackResult | CureResult | StiffnessResult | PenetrationResult
READERS: dict[str, type[Reader]] = {
    "index": IndexResult,
    "cutback": CutbackResult,
    "cure": CureResult,
    "stiffness": StiffnessResult,
    "refractometer": IndexResult,
    "penetration": PenetrationResult,
}
"""Readers, keyed by the `solen resin build` option that names the result file."""


def result_of(text: str, option: str) -> Reader:
    """Return a command's result from the text of its file; it must be of the kind that the option requires."""
    data = parse_json(text, "JSON", remedy="write it with --out")
    if not isinstance(data, dict) or not isinstance(data.get("kind"), str):
        remedy = f"write it with solen resin {option} --out"
        raise DataError("kind", limit="is missing: the file is not a result of solen", remedy=remedy)
    kind, reader = data.pop("kind"), READERS[option]
    if kind not in reader.kinds:
        matching = next((name for name, other in READERS.items() if kind in other.kinds), None)
        remedy = f"use the file with --{matching}" if matching else ""
        raise DataError("kind", value=kind, limit=f"must be {' or '.join(reader.kinds)} for --{option}", remedy=remedy)
    return reader(**data)
