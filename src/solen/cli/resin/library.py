"""The commands of resins: gather a file from results, list and show them, weigh in a mixture."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, listing, short, text
from solen.cli.app import show as answer

Repeatable = Annotated[list[str] | None, Parameter(negative=())]


def build(
    out: Path,
    /,
    *,
    name: str,
    index: Path | None = None,
    cutback: Path | None = None,
    cure: Path | None = None,
    stiffness: Path | None = None,
    formulation: str = "",
    source: str = "",
    note: str = "",
    orientation: str = "",
    loss_wavelength_nm: float | None = None,
    cure_wavelength_nm: float | None = None,
    label: str = "",
    force: Annotated[bool, Parameter(negative=())] = False,
    as_json: Json = False,
) -> None:
    """Write a resin file from what other commands found and left with --out.

    Parameters
    ----------
    out
        The resin file, a .toml.
    name
        The resin's name.
    index
        Result of solen resin index or solen resin refractometer.
    cutback
        Result of solen resin cutback.
    cure
        Result of solen resin cure.
    stiffness
        Result of solen resin stiffness.
    formulation
        Components with their shares of the whole by weight, "RA-139:75,lauryl acrylate:25".
    source
        Where the numbers come from, in words.
    note
        Anything worth knowing.
    orientation
        Take the loss of guides that were built in this orientation.
    loss_wavelength_nm
        Wavelength that the loss was measured at.
    cure_wavelength_nm
        Wavelength of the exposure that the working curve is of.
    label
        Take the stiffness of the material that solen resin stiffness calls so.
    force
        Replace a file that exists.
    """
    from solen.pipeline.resin import library as pipeline

    given = {"index": index, "cutback": cutback, "cure": cure, "stiffness": stiffness}
    results = {option: path for option, path in given.items() if path is not None}
    asked = pipeline.Gathering(
        name,
        results,
        formulation,
        source,
        note,
        orientation,
        loss_wavelength_nm,
        cure_wavelength_nm,
        label,
    )
    found = pipeline.build(out, asked, force=force)
    answer(found, as_json, lambda: [f"wrote {found['resin']}", *_resin_lines(found)])


def list_(*, as_json: Json = False) -> None:
    """List the resins that solen ships, with their index."""
    from solen.pipeline.resin import library as pipeline

    found = pipeline.listed()
    answer(found, as_json, lambda: _list_lines(found["resins"]))


def show(
    name: str,
    /,
    *,
    at_nm: Annotated[list[float] | None, Parameter(negative=())] = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Show everything that a resin says, and its index at wavelengths.

    Parameters
    ----------
    name
        A resin of the library, or a resin file (ends in .toml or holds a / or a backslash).
    at_nm
        A wavelength in nm; repeatable.
    """
    from solen.pipeline.resin import library as pipeline

    found = pipeline.shown(name, at_nm or (), figure=figure)
    figures = [f"figure: {found['figure']}"] if "figure" in found else []
    answer(found, as_json, lambda: [*_resin_lines(found), *figures])


def mix(
    *components: str,
    total_g: float | None = None,
    base_g: float | None = None,
    density: Repeatable = None,
    index: Repeatable = None,
    resolution_g: float = 0.01,
    as_json: Json = False,
) -> None:
    """Say what to weigh in for a mixture, in both readings of its percentages.

    Parameters
    ----------
    components
        Names with their shares of the whole in per cent by weight, the base first: "RA-139:75" "lauryl acrylate:25".
    total_g
        Mass of the whole in g; 100 by default.
    base_g
        Mass of the base that is there already, in place of that.
    density
        Density in g/mL by component, "lauryl acrylate:0.884"; repeatable.
    index
        Index of a liquid component, as the densities; with both of all components that of the mixture is estimated.
    resolution_g
        Step of the balance in g.
    """
    from solen.pipeline.resin import library as pipeline

    found = pipeline.mix(
        components,
        total_g=total_g,
        base_g=base_g,
        densities=density or (),
        indices=index or (),
        resolution_g=resolution_g,
    )
    answer(found, as_json, lambda: _mix_lines(found))


def _resin_lines(found: dict[str, Any]) -> list[str]:
    lines = [found["name"], *(f"  {key}: {found[key]}" for key in ("source", "notes") if found[key])]
    lines += [f"  n at {one['wavelength_nm']:g} nm: {_index(one)}" for one in found["at"]]
    if found["index"] is not None:
        kind, mode = found["index"]["kind"], found["index"]["mode"]
        lines.append(f"  index: {kind}{f', {mode}' if mode else ''}")
    for name in ("loss", "cure", "stiffness"):
        if found[name] is not None:
            plain = {key: value for key, value in found[name].items() if value is not None and value != ""}
            lines += [f"  {name}:", *(f"  {line}" for line in listing(_ranges(plain)))]
    parts = [f"{part['component']} {part['wt_percent']:g} wt%" for part in found["formulation"]]
    lines += [f"  formulation: {', '.join(parts)}"] if parts else []
    lines += [_source(one) for one in found["sources"]]
    others = [f"{name}: {one}" for name in ("cure", "stiffness") for one in (found[name] or {}).get("warnings", ())]
    return lines + [f"warning: {told}" for told in (*found["warnings"], *others)]


def _ranges(table: dict[str, Any]) -> dict[str, Any]:
    """The table with its pairs of numbers as text, which a listing shows."""
    return {key: f"{text(value[0])} to {text(value[1])}" if _is_pair(value) else value for key, value in table.items()}


def _is_pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(isinstance(one, float) for one in value)


def _index(one: dict[str, Any]) -> str:
    if one["n"] is None:
        return "not known"
    return f"{one['n']:.5g}" + ("" if one["u_n"] is None else f" ± {short(one['u_n'])}")


def _source(one: dict[str, Any]) -> str:
    told = [one[key] for key in ("file", "instrument", "date") if one[key]]
    checksum = f"sha256 {one['sha256'][:12]}…" if one["sha256"] else ""
    return f"  source of {one['of']}: {', '.join(filter(None, (*told, checksum, 'simulated' * one['simulated'])))}"


def _list_lines(resins: list[dict[str, Any]]) -> list[str]:
    width = max(len(one["resin"]) for one in resins)
    wavelengths = [f"{at['wavelength_nm']:g} nm" for at in resins[0]["at"]]
    lines = [f"  {'':{width}}  {'  '.join(f'{name:>9}' for name in wavelengths)}  how found"]
    for one in resins:
        values = "  ".join(f"{'–' if at['n'] is None else format(at['n'], '.4f'):>9}" for at in one["at"])
        warned = " (see its warning)" if one["warnings"] else ""
        lines.append(f"  {one['resin']:{width}}  {values}  {one['mode'] or 'not stated'}{warned}")
    return lines


READINGS = {
    "of_whole": "read as shares of the whole mixture",
    "on_base": "read as grams for 100 g of the base",
}


def _mix_lines(found: dict[str, Any]) -> list[str]:
    lines = []
    for reading, told in READINGS.items():
        one = found[reading]
        lines.append(f"{told}: {one['total_g']:g} g in all")
        width = max(len(part["name"]) for part in one["components"])
        lines += [f"  {part['name']:{width}}  {_part(part)}" for part in one["components"]]
        if one["index_estimate"] is not None:
            index = f"{one['index_estimate']:.4f}"
            lines.append(f"  index of the liquid, an estimate (Lorentz-Lorenz, volumes that add up): {index}")
    return lines


def _part(part: dict[str, Any]) -> str:
    volume = "" if part["volume_mL"] is None else f"  {part['volume_mL']:.4g} mL"
    share = f"{part['wt_percent']:.3f} wt%, weighed {part['error_wt_percent']:+.3f} ± {part['worst_wt_percent']:.3f}"
    return f"{part['weighed_g']:10g} g{volume}  {share}  {part['phr']:.2f} phr"
