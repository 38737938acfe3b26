"""A resin from the result files of other commands (`solen.material.result_files`).

`build_resin` makes a `Resin` from result files and `BuildOptions`; `spectral_fit` fits the spectral cure law to discs.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from solen.errors import DataError, SpecError
from solen.files import read_text
from solen.material.cross_checks import index_disagreement, loss_disagreement, penetration_disagreement
from solen.material.cure.discs import MeasuredCurve
from solen.material.cure.spectral import SpectralFit, fit_spectral_law
from solen.material.cure.working_curve_fit import WorkingCurve
from solen.material.mix import named_number
from solen.material.resin import Part, Resin, Source
from solen.material.result_files import READERS, IndexResult, PenetrationResult, Reader, Selection, result_of
from solen.ranks import Caution
from solen.spec.strict import error_context

_REQUIRED_RESULTS = {
    "orientation": "cutback",
    "loss_wavelength_nm": "cutback",
    "cure_wavelength_nm": "cure",
    "label": "stiffness",
}
_MAX_LAMP_DIFFERENCE_NM = 15.0  # largest difference between an LED's nominal and its mean wavelength


class BuildOptions(Selection):
    """Options for building a resin from results."""

    name: str
    """Name of the resin."""
    formulation: str = ""
    """Components with their mass fractions in per cent, "RA-139:75,lauryl acrylate:25"."""
    source: str = ""
    """Source of the numbers, in words."""
    note: str = ""
    """Further notes on the resin."""


def build_resin(results: Mapping[str, Path], options: BuildOptions) -> Resin:
    """Build a resin from the results of commands.

    Parameters
    ----------
    results
        Result files, keyed by the option that names them, one of `READERS`.
    options
        Name of the resin, and selection of the results.

    Raises
    ------
    DataError, SpecError
        If a result cannot be read, is of another kind or invalid, or if there is nothing to write.
    """
    for name, option in _REQUIRED_RESULTS.items():
        if (value := getattr(options, name)) and option not in results:
            limit = f"requires --{option}"
            raise SpecError(f"--{name.replace('_', '-')}", value=value, limit=limit, remedy=f"add --{option}")
    if not (results or options.formulation):
        remedy = f"add {', '.join(f'--{option}' for option in READERS if option != 'penetration')} or --formulation"
        raise SpecError("solen resin build", limit="has no data to write", remedy=remedy)
    if "penetration" in results and "cure" not in results:
        raise SpecError("--penetration", limit="requires a working curve for comparison", remedy="add --cure")
    tables: dict[str, Any] = {"name": options.name}
    tables |= {key: text for key, text in (("source", options.source), ("notes", options.note)) if text}
    sources: list[Source] = []
    readers: dict[str, Reader] = {}
    for option, path in results.items():
        text = read_text(path, DataError)
        with error_context(str(path)):
            result = readers[option] = result_of(text, option)
            table = result.as_table(options)
        if table is not None:
            tables.setdefault(result.of, table)
        sources += result.measured_files(options)
    for key, warnings in _disagreements(readers, tables).items():
        tables[key] = tables[key].model_copy(update={"warnings": (*warnings, *tables[key].warnings)})
    if options.formulation:
        parts = [named_number(part, "--formulation") for part in options.formulation.split(",")]
        with error_context("--formulation"):
            tables["formulation"] = tuple(Part(component=name, wt_percent=percent) for name, percent in parts)
    if sources:
        tables["sources"] = tuple(sources)
    return Resin(**tables)


def spectral_fit(path: Path, curve: WorkingCurve) -> SpectralFit:
    """Fit the spectral cure law, with the lamp of a result of `solen resin penetration`, to the discs of a curve.

    Raises
    ------
    DataError
        If the file is not such a result or contains no lamp.
    """
    text = read_text(path, DataError)
    with error_context(str(path)):
        liquid = result_of(text, "penetration")
    if not isinstance(liquid, PenetrationResult) or liquid.lamp_lines is None or liquid.Dp_um is None:
        remedy = "run solen resin penetration with --led-nm and --led-fwhm-nm, or --led"
        raise DataError(
            str(path), limit="contains no lamp, but the cure law for a lamp's spectrum requires one", remedy=remedy
        )
    discs_nm = curve.wavelength_nm if isinstance(curve, MeasuredCurve) else None
    if discs_nm is not None and liquid.lamp_nm is not None and abs(discs_nm - liquid.lamp_nm) > _MAX_LAMP_DIFFERENCE_NM:
        limit = f"the lamp of {path.name} has a mean wavelength of {liquid.lamp_nm:.4g} nm"
        remedy = "correct one of the two"
        raise DataError("wavelength of the discs' lamp", value=f"{discs_nm:g} nm", limit=limit, remedy=remedy)
    return fit_spectral_law(curve, liquid.lamp_lines, liquid.Dp_um, liquid.lamp or path.name)


def _disagreements(readers: Mapping[str, Reader], tables: Mapping[str, Any]) -> dict[str, list[Caution]]:
    """Return warnings about results that disagree, keyed by the table of the resin."""
    warnings: dict[str, list[Caution]] = {}
    layer, other, liquid = (readers.get(option) for option in ("index", "refractometer", "penetration"))
    if isinstance(layer, IndexResult) and "loss" in tables:
        warnings["loss"] = loss_disagreement(layer.extinction, tables["loss"])
    if isinstance(layer, IndexResult) and isinstance(other, IndexResult):
        warnings["index"] = index_disagreement(tables["index"], other.as_table(), layer.wavelength_nm)
    Dp_um = (liquid.between_Dp_um or liquid.Dp_um) if isinstance(liquid, PenetrationResult) else None
    if isinstance(liquid, PenetrationResult) and Dp_um is not None:
        warnings["cure"] = penetration_disagreement(tables["cure"], Dp_um, liquid.u_Dp_um)
    return warnings
