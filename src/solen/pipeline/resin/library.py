"""What the commands of resins do: gather a resin file from results, list and show resins, weigh in a mixture."""

import contextlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from solen import __version__, files
from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.files import read_text
from solen.material import mix as mixing
from solen.material import resin as resins
from solen.material.gather import RESULTS, CureResult, CutbackResult, IndexResult, StiffnessResult
from solen.pipeline.outputs import check_figure, check_wavelength
from solen.spec.design import names_file
from solen.spec.strict import told_of

LISTED_NM = (589.3, 860.0)
"""Wavelengths that resins are listed at: sodium's yellow, where refractometers measure, and the paper's emitter."""
OPTIONS = {"index": ("index", "refractometer"), "cutback": ("cutback",), "cure": ("cure",), "stiffness": ("stiffness",)}
"""Options of `solen resin build` that name a result, and the kinds that each takes."""

Result = IndexResult | CutbackResult | CureResult | StiffnessResult


@dataclass(frozen=True)
class Gathering:
    """What a resin is gathered from, as it was said; paths by the name of their option."""

    name: str
    results: dict[str, Path]
    formulation: str = ""
    source: str = ""
    note: str = ""
    orientation: str = ""
    loss_wavelength_nm: float | None = None
    cure_wavelength_nm: float | None = None
    label: str = ""


def build(out: Path, asked: Gathering, *, force: bool = False) -> dict[str, Any]:
    """Write a resin file from the results of other commands.

    Raises
    ------
    DataError, SpecError
        Where a result cannot be read, is of another kind or not what it should be, or where there is nothing to write.
    OutputError
        Where the file is there already and not to be replaced, or cannot be written.
    """
    _check_target(out, force)
    resin = gathered(asked)
    text = resins.dumps_resin(resin, f"Written by solen {__version__}.")
    files.write_text(out, text)
    return {"resin": str(out), **described(resin)}


def gathered(asked: Gathering) -> resins.Resin:
    """Resin of what was asked to be gathered."""
    _check_together(asked)
    if not (asked.results or asked.formulation):
        remedy = f"add {', '.join(f'--{option}' for option in OPTIONS)} or --formulation"
        raise SpecError("solen resin build", limit="has nothing to write", remedy=remedy)
    tables: dict[str, Any] = {"name": asked.name}
    tables |= {key: text for key, text in (("source", asked.source), ("notes", asked.note)) if text}
    sources: list[resins.Source] = []
    for option, path in asked.results.items():
        text = read_text(path, DataError)
        with told_of(str(path)):
            found = result_of(text, option)
            name, table = _table(found, asked)
        tables[name] = table
        sources += found.found_from(asked.label) if isinstance(found, StiffnessResult) else found.found_from()
    if asked.formulation:
        tables["formulation"] = _formulation(asked.formulation)
    if sources:
        tables["sources"] = tuple(sources)
    return resins.Resin(**tables)


def _check_together(asked: Gathering) -> None:
    """Raise for an option of a result that is not given, or a wavelength that is none."""
    options = {
        "--orientation": (asked.orientation, "cutback"),
        "--loss-wavelength-nm": (asked.loss_wavelength_nm, "cutback"),
        "--cure-wavelength-nm": (asked.cure_wavelength_nm, "cure"),
        "--label": (asked.label, "stiffness"),
    }
    for option, (value, result) in options.items():
        if value and result not in asked.results:
            raise SpecError(option, value=value, limit=f"is of --{result}", remedy="add that")
        if isinstance(value, float):
            check_wavelength(value, option)


def result_of(text: str, option: str) -> Result:
    """Result of a command from the text of its file, of a kind that an option takes."""
    try:
        data = json.loads(text, parse_constant=_no_number)
    except ValueError as bad:
        raise DataError("JSON", limit=f"cannot be read: {bad}", remedy="write it with --out") from None
    except RecursionError:
        raise DataError("JSON", limit="is nested too deeply", remedy="write it with --out") from None
    if not isinstance(data, dict) or not isinstance(data.get("kind"), str):
        remedy = f"write it with solen resin {option} --out"
        raise DataError("kind", limit="missing: this is no result of solen", remedy=remedy)
    kind = data["kind"]
    if kind not in OPTIONS[option]:
        right = next((other for other, kinds in OPTIONS.items() if kind in kinds), None)
        remedy = f"it is for --{right}" if right else ""
        raise DataError("kind", value=kind, limit=f"--{option} takes {' or '.join(OPTIONS[option])}", remedy=remedy)
    return RESULTS[kind](**{key: value for key, value in data.items() if key != "kind"})


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant} is no number of JSON")


def _table(found: Result, asked: Gathering) -> tuple[str, Any]:
    """Name and table of the resin that a result makes."""
    if isinstance(found, CutbackResult):
        return found.of, found.as_table(asked.orientation, asked.loss_wavelength_nm)
    if isinstance(found, CureResult):
        return found.of, found.as_table(asked.cure_wavelength_nm)
    if isinstance(found, StiffnessResult):
        return found.of, found.as_table(asked.label)
    return found.of, found.as_table()


def _formulation(text: str) -> tuple[resins.Part, ...]:
    parts = [_named_number(one, "--formulation") for one in text.split(",")]
    with told_of("--formulation"):
        return tuple(resins.Part(component=name, wt_percent=percent) for name, percent in parts)


def _check_target(out: Path, force: bool) -> None:
    if out.suffix.lower() != ".toml":
        raise OutputError(str(out), limit="a resin file ends in .toml", remedy="rename it")
    if out.exists() and not force:
        raise OutputError(str(out), limit="exists already", remedy="name another file, or add --force")


def described(resin: resins.Resin) -> dict[str, Any]:
    """Everything a resin says, as plain data."""
    return {
        "name": resin.name,
        "source": resin.source,
        "notes": resin.notes,
        "index": _plain(resin.index) if resin.has("index") else None,
        "loss": _plain(resin.loss) if resin.has("loss") else None,
        "cure": _plain(resin.cure),
        "stiffness": _plain(resin.stiffness),
        "formulation": [_plain(part) for part in resin.formulation],
        "sources": [_plain(one) for one in resin.sources],
        "at": [_at(resin, nm) for nm in LISTED_NM],
        "warnings": list(resin.warnings),
    }


def _plain(table: Any) -> dict[str, Any] | None:
    return None if table is None else table.model_dump(mode="json")


def _at(resin: resins.Resin, wavelength_nm: float) -> dict[str, float | None]:
    """Index at a wavelength; None outside what is known."""
    n: float | None = None
    u_n: float | None = None
    with contextlib.suppress(SolenError):
        n, u_n = resin.index.index(wavelength_nm), resin.index.u_index(wavelength_nm)
    return {"wavelength_nm": wavelength_nm, "n": n, "u_n": u_n}


def listed() -> dict[str, Any]:
    """The library's resins with their index."""
    found = {name: resins.library_resin(name) for name in resins.library()}
    return {
        "resins": [
            {
                "resin": name,
                "name": resin.name,
                "at": [_at(resin, nm) for nm in LISTED_NM],
                "mode": resin.index.mode or None,
                "source": resin.source,
                "warnings": list(resin.warnings),
            }
            for name, resin in found.items()
        ]
    }


def shown(name: str, at_nm: Sequence[float] = (), *, figure: Path | None = None) -> dict[str, Any]:
    """Everything that a resin of the library or a file says, and its index at wavelengths.

    Raises
    ------
    DataError
        Where there is no such resin, or where its index is not known at a wavelength.
    """
    check_figure(figure)
    resin = resins.resin_of(name, Path(name) if names_file(name) else None)
    for nm in at_nm:
        check_wavelength(nm, "--at-nm")
    with told_of(f"resin {resin.name}"):
        for nm in at_nm:
            resin.index.index(nm)
    found = {"resin": name, **described(resin)}
    if at_nm:
        found["at"] = [_at(resin, nm) for nm in at_nm]
    if figure is not None:
        from solen.report import canvas
        from solen.report.resin.library import index_figure

        with told_of(f"resin {resin.name}"):
            drawn = index_figure(resin, at_nm)
        files.write_bytes(figure, canvas.encoded(drawn, figure.suffix.lower(), "resin"))
        found["figure"] = str(figure)
    return found


def mix(
    components: Sequence[str],
    *,
    total_g: float | None = None,
    base_g: float | None = None,
    densities: Sequence[str] = (),
    indices: Sequence[str] = (),
    resolution_g: float = 0.01,
) -> dict[str, Any]:
    """Masses of a mixture in both readings of its percentages.

    Raises
    ------
    SpecError
        Where a component is not a name and a share, the shares are not a whole, or a number cannot be.
    """
    parts = [mixing.Component(*_named_number(text, "component")) for text in components]
    mixing.check_components(parts)
    known = {
        option: dict(_named_number(text, option) for text in texts)
        for option, texts in (("--density", densities), ("--index", indices))
    }
    parts = list(mixing.with_known(parts, known["--density"], known["--index"]))
    mixing.check_components(parts)
    if total_g is None and base_g is None:
        total_g = mixing.WHOLE
    whole, base = mixing.of_whole(parts), mixing.on_base(parts)
    readings = {
        reading: mixing.weighed(shares, reading, total_g=total_g, base_g=base_g, resolution_g=resolution_g)
        for reading, shares in (("of_whole", whole), ("on_base", base))
    }
    return {
        **{reading: _mixture(one) for reading, one in readings.items()},
        "base": parts[0].name,
        "total_g": total_g,
        "base_g": base_g,
        "resolution_g": resolution_g,
    }


def _mixture(found: mixing.Mixture) -> dict[str, Any]:
    components = [asdict(one) | {"error_wt_percent": one.error_wt_percent} for one in found.components]
    return {"components": components, "total_g": found.total_g, "index_estimate": found.index_estimate}


def _named_number(text: str, what: str) -> tuple[str, float]:
    """Name and number of ``name:number``; a per cent sign may follow."""
    name, colon, number = text.rpartition(":")
    try:
        value = float(number.strip().removesuffix("%"))
    except ValueError:
        value = math.nan
    if not (colon and name.strip() and math.isfinite(value)):
        raise SpecError(what, value=text, limit="is not of the form name:number", remedy='as in "lauryl acrylate:25"')
    return name.strip(), value
