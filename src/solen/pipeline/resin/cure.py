"""The working curve of a resin and what it means for a print, from a table of discs to plain data and a figure."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.cure.cautions import cautions
from solen.material.cure.curve import SCATTERS, Scatter, WorkingCurve, working_curve
from solen.material.cure.layers import StackDose, dose_below, stack_dose, stack_print_through_um
from solen.pipeline.outputs import check_choice, check_figure, check_out, check_wavelength, leave
from solen.recording import Channel, Recording, read
from solen.units import factor

THICKNESSES = ("thickness", "cure depth", "cured depth", "depth", "Dc", "cured thickness")
DOSES = ("dose", "energy", "exposure", "exposure dose", "fluence", "E")
TIMES = ("time", "exposure time", "exposure", "cure time", "t")
DISCS, REPLICATES = ("disc", "disk", "sample", "specimen", "id"), ("replicate", "repeat", "wiederholung")
DOSE = "mJ/cm2"
MOST_LAYERS = 100_000
"""More than any printer prints: a metre of layers of 10 µm."""
USUAL_DP_UM = (1.0, 1e4)
"""Far beyond both ends of printable resins' penetration depths: outside, a unit is wrong."""


@dataclass(frozen=True)
class Print:
    """How a part is printed.

    Attributes
    ----------
    irradiance_mW_per_cm2
        At the window.
    layer_um, exposure_s
        Of each layer.
    overcure
        Cure depth that is asked for, in thicknesses of a layer.
    layers, burn_in_layers, burn_in_s
        How many layers there are, and how many of them, first, are exposed for another time.
    """

    irradiance_mW_per_cm2: float | None = None
    layer_um: float | None = None
    exposure_s: float | None = None
    overcure: float = 2.0
    layers: int | None = None
    burn_in_layers: int = 0
    burn_in_s: float | None = None

    def check(self) -> None:
        """`SpecError` where a number is not above 0, or one is there without another that it needs."""
        numbers = {
            "--irradiance-mW-per-cm2": self.irradiance_mW_per_cm2,
            "--layer-um": self.layer_um,
            "--exposure-s": self.exposure_s,
            "--overcure": self.overcure,
            "--layers": self.layers,
            "--burn-in-s": self.burn_in_s,
        }
        for name, value in numbers.items():
            if value is not None and not 0.0 < value < math.inf:
                raise SpecError(name, value=value, limit="must be above 0")
        self._check_together()

    def _check_together(self) -> None:
        if self.exposure_s is not None and self.layer_um is None:
            raise SpecError("--exposure-s", limit="needs the layer it cures", remedy="add --layer-um")
        if self.exposure_s is not None and self.irradiance_mW_per_cm2 is None:
            raise SpecError("--exposure-s", limit="is no dose without --irradiance-mW-per-cm2", remedy="add it")
        if (self.layers is not None or self.burn_in_layers) and self.exposure_s is None:
            name = "--layers" if self.layers is not None else "--burn-in-layers"
            raise SpecError(name, limit="needs --exposure-s", remedy="add it")
        if (self.layers or 0) > MOST_LAYERS:
            raise SpecError("--layers", value=self.layers, limit=f"must be at most {MOST_LAYERS}")
        if self.burn_in_layers < 0 or (self.burn_in_layers > 0) != (self.burn_in_s is not None):
            raise SpecError("--burn-in-layers", value=self.burn_in_layers, limit="goes with --burn-in-s, both above 0")
        if self.layers is not None and self.burn_in_layers > self.layers:
            raise SpecError("--burn-in-layers", value=self.burn_in_layers, limit=f"of {self.layers} layers")


def cure(
    file: Path,
    *,
    how: Print | None = None,
    sheet: str | None = None,
    scatter: str = "auto",
    min_thickness_um: float | None = None,
    keep_all: bool = False,
    wavelength_nm: float | None = None,
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Penetration depth and critical dose with their intervals; with a layer, what they mean for it.

    Parameters
    ----------
    file
        Any file that `solen.recording.read` takes, with a column of thicknesses and one of doses or times.
    how
        How a part is printed; the irradiance there makes doses of times.
    sheet
        Of a workbook.
    scatter, min_thickness_um, keep_all
        As in `solen.material.cure.curve.working_curve`.
    wavelength_nm
        Of the lamp, which the result states.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    DataError, SpecError
        Where the file is damaged, a number is missing, or no curve follows.
    """
    check_figure(figure)
    check_out(out)
    check_choice("--scatter", scatter, SCATTERS)
    how = how or Print()
    how.check()
    check_wavelength(wavelength_nm)
    if min_thickness_um is not None and not 0.0 <= min_thickness_um < math.inf:
        raise SpecError("--min-thickness-um", value=min_thickness_um, limit="must be at least 0")
    recording = read(file, sheet=sheet)
    table = discs(recording, how.irradiance_mW_per_cm2)
    law: Scatter = next(one for one in SCATTERS if one == scatter)
    found = working_curve(
        table.dose,
        table.thickness_um,
        scatter=law,
        min_thickness_um=min_thickness_um,
        keep_all=keep_all,
        rows=table.rows,
    )
    stack = stack_of(found.Dp_um, how)
    data = (
        curve_told(found)
        | {"irradiance_mW_per_cm2": how.irradiance_mW_per_cm2, "wavelength_nm": wavelength_nm}
        | {"layer": _layer(found, how), "stack": None if stack is None else _stack(found, stack, how)}
        | {
            "sources": [recording.provenance.as_dict()],
            "warnings": [
                *recording.warnings,
                *table.warnings,
                *cautions(found),
                *_unusual(found),
                *_outside(found, how),
            ],
        }
    )

    def draw() -> Any:
        from solen.report.resin.cure import cure_figure

        return cure_figure(found, how.irradiance_mW_per_cm2, how.layer_um, how.exposure_s, stack, recording.provenance)

    return leave(data, "cure", out, figure, draw)


@dataclass(frozen=True)
class Table:
    """Discs of a table: dose in mJ/cm², thickness in µm, first row of each, and what must be said of them."""

    dose: FloatArray
    thickness_um: FloatArray
    rows: list[int]
    warnings: list[str]


def discs(recording: Recording, irradiance_mW_per_cm2: float | None) -> Table:
    """Discs of a table. Rows of one dose and one disc are readings of it, and averaged."""
    thickness_um = recording.need(*THICKNESSES).to("um")
    dose = _doses(recording, irradiance_mW_per_cm2)
    columns = [texts for name in DISCS if (texts := recording.label(name)) is not None and len(set(texts)) > 1]
    if not columns:
        return Table(dose, thickness_um, list(range(1, len(dose) + 1)), [])
    columns += [texts for name in REPLICATES if (texts := recording.label(name)) is not None]
    names = [" ".join(texts) for texts in zip(*columns, strict=True)]
    keys = [
        (value, name.strip() or f"row {row}")
        for row, (value, name) in enumerate(zip(dose.tolist(), names, strict=True))
    ]
    order = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    of = np.array([order[key] for key in keys], np.intp)
    means = np.bincount(of, weights=thickness_um) / np.bincount(of)
    first = [keys.index(key) + 1 for key in order]
    averaged = len(keys) - len(order)
    told = [f"{len(keys)} rows are readings of {len(order)} discs: those of one disc are averaged"] if averaged else []
    return Table(np.array([value for value, _ in order]), means, first, told)


def _doses(recording: Recording, irradiance_mW_per_cm2: float | None) -> FloatArray:
    """Doses in mJ/cm², as stated or from times."""
    if (dose := _with_unit(recording, DOSES, DOSE)) is not None:
        return dose.to(DOSE)
    time = _with_unit(recording, TIMES, "s")
    if time is None:
        unknown = recording.find(*DOSES, *TIMES) or recording.need("dose", "energy", "time")
        return unknown.to(DOSE)  # refuses, with the remedy
    if (rate := _with_unit(recording, ("irradiance", "intensity"), "mW/cm2")) is not None:
        return time.to("s") * rate.to("mW/cm2")
    if irradiance_mW_per_cm2 is not None:
        return time.to("s") * irradiance_mW_per_cm2
    limit = "states exposure times, and the curve is of dose"
    raise DataError(recording.provenance.file, value=time.name, limit=limit, remedy="add --irradiance-mW-per-cm2")


def _with_unit(recording: Recording, names: tuple[str, ...], unit: str) -> Channel | None:
    """First channel of these names that can be taken to a unit."""
    for name in names:
        found = recording.find(name)
        if found is not None and found.unit and factor(found.unit, unit) is not None:
            return found
    return None


def _unusual(found: WorkingCurve) -> list[str]:
    """What a wrong unit looks like."""
    low, high = USUAL_DP_UM
    if low <= found.Dp_um <= high:
        return []
    return [
        f"Dp = {found.Dp_um:.3g} µm is that of no printable resin (tens to hundreds of µm): check the unit of the "
        "thickness in the table's header"
    ]


def curve_told(found: WorkingCurve) -> dict[str, Any]:
    """A working curve as plain data."""
    lack, at = found.lack_of_fit, found.scatter_at_um
    doses = [disc.dose_mJ_per_cm2 for disc in found.used]
    ec = found.Ec_interval95
    return {
        "Dp_um": found.Dp_um,
        "u_Dp_um": found.u_Dp_um,
        "Ec_mJ_per_cm2": found.Ec_mJ_per_cm2,
        "u_ln_Ec": found.u_ln_Ec,
        "interval95": {"Dp_um": list(found.Dp_interval95), "Ec_mJ_per_cm2": None if ec is None else list(ec)},
        "covariance": found.covariance.tolist(),
        "covariance_of": ["Dp_um", "Ec_mJ_per_cm2"],
        "covariance_ln": found.covariance_ln.tolist(),
        "covariance_ln_of": ["Dp_um", "ln Ec_mJ_per_cm2"],
        "discs": len(found.used),
        "doses": len(set(doses)),
        "dose_range_mJ_per_cm2": [min(doses), max(doses)],
        "scatter": {"grows_with_power": found.scatter_exponent, "um": found.scatter_um, "at_um": at},
        "lack_of_fit": None if lack is None else {"F": lack.ratio, "df": list(lack.df), "p": lack.p},
        "counted_by": "dose" if found.by_dose else "disc",
        "left_out": [
            {
                "row": one.disc.row,
                "dose_mJ_per_cm2": one.disc.dose_mJ_per_cm2,
                "thickness_um": None if math.isnan(one.disc.thickness_um) else one.disc.thickness_um,
                "reason": one.reason,
                "t": one.t,
            }
            for one in found.left_out
        ],
    }


def _layer(found: WorkingCurve, how: Print) -> dict[str, Any] | None:
    """What a layer needs, and what an exposure does to it."""
    if how.layer_um is None:
        return None
    depth_um = how.overcure * how.layer_um
    needed, ends = found.dose_mJ_per_cm2(depth_um), found.dose_interval95(depth_um)
    told: dict[str, Any] = {
        "layer_um": how.layer_um,
        "overcure": how.overcure,
        "needed_mJ_per_cm2": needed if math.isfinite(needed) else None,
        "needed_interval95_mJ_per_cm2": None if ends is None else list(ends),
    }
    if how.irradiance_mW_per_cm2 is not None and math.isfinite(needed):
        told["needed_s"] = needed / how.irradiance_mW_per_cm2
        told["needed_interval95_s"] = None if ends is None else [end / how.irradiance_mW_per_cm2 for end in ends]
    return told | _exposed(found, how)


def _exposed(found: WorkingCurve, how: Print) -> dict[str, Any]:
    if how.layer_um is None or how.exposure_s is None or how.irradiance_mW_per_cm2 is None:
        return {}
    dose = how.exposure_s * how.irradiance_mW_per_cm2
    depth, half = float(found.depth_um(dose)), float(found.half_width_um(dose))
    below = float(dose_below(dose, how.layer_um, found.Dp_um))
    through = stack_print_through_um(dose, how.layer_um, found.Dp_um, found.Ec_mJ_per_cm2)
    return {
        "exposure_s": how.exposure_s,
        "dose_mJ_per_cm2": dose,
        "cure_depth_um": depth,
        "cure_depth_interval95_um": [depth - half, depth + half],
        "cure_depth_in_layers": depth / how.layer_um,
        "dose_below_mJ_per_cm2": below,
        "dose_below_over_Ec": below / found.Ec_mJ_per_cm2,
        "print_through_um": max(depth - how.layer_um, 0.0),
        "print_through_many_layers_um": max(through, 0.0),
    }


def stack_of(Dp_um: float, how: Print) -> StackDose | None:
    """Dose inside a part of these layers; by default of enough of them to have an inside."""
    if how.layer_um is None or how.exposure_s is None or how.irradiance_mW_per_cm2 is None:
        return None
    settled = stack_dose(Dp_um, how.layer_um, [1.0]).layers_to_settle
    layers = how.layers or how.burn_in_layers + max(3 * settled, 20)
    seconds = np.full(layers, how.exposure_s)
    if how.burn_in_s is not None:
        seconds[: how.burn_in_layers] = how.burn_in_s
    return stack_dose(Dp_um, how.layer_um, seconds * how.irradiance_mW_per_cm2)


def _stack(found: WorkingCurve, stack: StackDose, how: Print) -> dict[str, Any]:
    """Doses inside a part as plain data; the uncertainty is that of the penetration depth."""
    mean = stack.layer_mean
    return {
        "layers": len(stack.exposures),
        "burn_in_layers": how.burn_in_layers,
        "incident_mJ_per_cm2": float(stack.exposures[-1]),
        "single_layer_mean_mJ_per_cm2": stack.single_layer_mean,
        "interior_mean_mJ_per_cm2": stack.interior_mean,
        "u_interior_mean_mJ_per_cm2": stack.interior_mean * found.u_Dp_um / found.Dp_um,
        "interior_range_mJ_per_cm2": list(stack.interior_range),
        "interior_over_single_layer": stack.ratio,
        "interior_over_incident": stack.interior_mean / float(stack.exposures[-1]),
        "layers_to_99_percent": stack.layers_to_settle,
        "layer_mean_mJ_per_cm2": mean.tolist(),
    }


def _outside(found: WorkingCurve, how: Print) -> list[str]:
    """Warning where a layer's exposure lies outside the doses of the discs."""
    if how.exposure_s is None or how.irradiance_mW_per_cm2 is None or how.layer_um is None:
        return []
    dose, doses = how.exposure_s * how.irradiance_mW_per_cm2, [disc.dose_mJ_per_cm2 for disc in found.used]
    told = []
    if not min(doses) <= dose <= max(doses):
        told.append(
            f"an exposure of {dose:.3g} mJ/cm² lies outside the discs' {min(doses):.3g} to {max(doses):.3g} mJ/cm²: "
            "its cure depth is an extrapolation"
        )
    depth, half = float(found.depth_um(dose)), float(found.half_width_um(dose))
    if depth - half < how.layer_um:
        told.append(
            f"{how.exposure_s:g} s cure {depth:.3g} ± {half:.2g} µm: a layer of {how.layer_um:g} µm may not reach the "
            "one before"
        )
    return told
