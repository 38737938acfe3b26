"""Transmittance, and index where it is known, of layers against their exposure: from files of spectra to trends."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.cure.exposure import Sample, Trend, trend
from solen.material.index import Length, measured, reading
from solen.pipeline.outputs import check_figure, check_out, leave
from solen.pipeline.resin.index import plain
from solen.pipeline.resin.traces import kind_of
from solen.recording import Recording, Spectrum, read, spectra
from solen.units import factor

WAVELENGTHS_NM = (450.0, 500.0, 860.0)
"""Those of the paper's three designs."""
TIMES = ("exposure", "exposure time", "time", "t")
_TIME_IN_NAME = re.compile(r"(?<![\w.,])(\d+(?:[.,]\d+)?)\s*(?:s|sec|sek|seconds)(?![a-zA-Z])")
_FEW = 4
_REMEDY = "have columns exposure_s, wavelength_nm and T, or an instrument's traces of %T with names as 2 s"
_NEAR_NM = 10.0


def exposures(
    files: Sequence[Path],
    *,
    wavelengths_nm: Sequence[float] = (),
    irradiance_mW_per_cm2: float | None = None,
    thickness_um: float | None = None,
    sheet: str | None = None,
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Transmittance of layers at some wavelengths against their exposure, and their index where R was measured.

    Parameters
    ----------
    files
        Spectra whose traces, or else files, are named by their exposure (``2 s``), or tables with columns exposure_s,
        wavelength_nm and T, and R where it was measured.
    wavelengths_nm
        By default 450, 500 and 860 nm, as far as the spectra reach.
    irradiance_mW_per_cm2
        Makes doses of the exposures.
    thickness_um
        Of the layers; the index needs it.
    sheet
        Of a workbook.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    DataError, SpecError
        Where a file is damaged, an exposure is not told, or there are fewer than two.
    """
    check_figure(figure)
    check_out(out)
    for name, value in (("--irradiance-mW-per-cm2", irradiance_mW_per_cm2), ("--thickness-um", thickness_um)):
        if value is not None and not 0.0 < value < math.inf:
            raise SpecError(name, value=value, limit="must be above 0")
    recordings = [read(file, sheet=sheet) for file in files]
    samples = sorted((one for each in recordings for one in samples_of(each)), key=lambda one: one.exposure_s)
    seconds = np.array([one.exposure_s for one in samples])
    if len(set(seconds.tolist())) < 2:
        raise DataError("exposures", value=len(set(seconds.tolist())), limit="a trend needs two at least")
    at = _wavelengths(samples, wavelengths_nm)
    rows = [_at(nm, samples, seconds, thickness_um) for nm in at]
    data = {
        "samples": [one.name for one in samples],
        "exposure_s": seconds.tolist(),
        "dose_mJ_per_cm2": None if irradiance_mW_per_cm2 is None else (seconds * irradiance_mW_per_cm2).tolist(),
        "wavelengths": rows,
        "sources": [each.provenance.as_dict() for each in recordings],
        "warnings": [*(note for each in recordings for note in each.warnings), *_cautions(samples, rows, thickness_um)],
    }

    def draw() -> Any:
        from solen.report.resin.exposures import exposures_figure

        simulated = any(each.provenance.simulated for each in recordings)
        return exposures_figure(samples, at, simulated)

    return leave(data, "exposures", out, figure, draw)


def samples_of(recording: Recording) -> list[Sample]:
    """Layers of a recording, each with its exposure."""
    times = [recording.find(name) for name in TIMES]
    time = next((channel for channel in times if channel and factor(channel.unit or "1", "s")), None)
    every = [one for one in spectra(recording) if kind_of(one.channel) in {"T", "R"}]
    if time is not None:
        return _long(recording, every, time.to("s"))
    by_exposure: dict[float, dict[str, list[Spectrum]]] = {}
    for one in every:
        kinds = by_exposure.setdefault(_told(recording, one.channel.name), {"T": [], "R": []})
        kinds["T" if kind_of(one.channel) == "T" else "R"].append(one)
    found = [made for seconds, kinds in by_exposure.items() for made in _paired(seconds, kinds)]
    if not found:
        raise DataError(recording.provenance.file, limit="holds no transmittance", remedy=_REMEDY)
    return found


def _told(recording: Recording, name: str) -> float:
    """Exposure that the name of a trace, or else of its file, tells."""
    for text in (name, Path(recording.provenance.file).stem.replace("_", " ")):
        found = _TIME_IN_NAME.search(text)
        if found:
            return float(found[1].replace(",", "."))
    limit = "does not tell its exposure, as 2 s would"
    raise DataError(f"{recording.provenance.file}: trace {name}", limit=limit, remedy="put it into the name")


def _paired(seconds: float, kinds: dict[str, list[Spectrum]]) -> list[Sample]:
    """Samples of one exposure: each trace of T, with a trace of R where there are as many."""
    paired = len(kinds["R"]) == len(kinds["T"])
    found = []
    for number, one in enumerate(kinds["T"]):
        nm, t = _ascending(one.wavelength_nm, one.ratio())
        r = None
        if paired:
            r = np.interp(nm, *_ascending(kinds["R"][number].wavelength_nm, kinds["R"][number].ratio()))
        found.append(Sample(one.channel.name, seconds, nm, t, r))
    return found


def _long(recording: Recording, every: list[Spectrum], seconds: FloatArray) -> list[Sample]:
    """Samples of a table with a row for each exposure and wavelength."""
    by_kind = {kind_of(one.channel): one for one in every}
    if "T" not in by_kind:
        raise DataError(recording.provenance.file, limit="holds no transmittance", remedy="name its column T")
    names = recording.label("sample", "specimen", "name", "replicate") or ("",) * len(seconds)
    keys = list(zip(names, seconds.tolist(), strict=True))
    found = []
    for name, value in dict.fromkeys(keys):
        here = np.array([key == (name, value) for key in keys])
        nm, t = _ascending(by_kind["T"].wavelength_nm[here], by_kind["T"].ratio()[here])
        r = _ascending(by_kind["R"].wavelength_nm[here], by_kind["R"].ratio()[here])[1] if "R" in by_kind else None
        found.append(Sample(f"{name} {value:g} s".strip(), value, nm, t, r))
    return found


def _ascending(nm: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = np.isfinite(nm) & np.isfinite(values)
    order = np.argsort(nm[known])
    return nm[known][order], values[known][order]


def _wavelengths(samples: Sequence[Sample], wanted: Sequence[float]) -> list[float]:
    """Wavelengths that all samples were measured at; `DataError` for one that was asked for and is not."""
    for nm in wanted:
        far = [one.name for one in samples if not _reaches(one, nm)]
        if far:
            limit = f"{far[0]} was not measured within {_NEAR_NM:g} nm of it"
            raise DataError("--wavelength-nm", value=nm, limit=limit, remedy="take another wavelength")
    found = list(wanted) or [nm for nm in WAVELENGTHS_NM if all(_reaches(one, nm) for one in samples)]
    if not found:
        told = ", ".join(f"{nm:g}" for nm in WAVELENGTHS_NM)
        raise DataError("exposures", limit=f"not all samples were measured at {told} nm", remedy="add --wavelength-nm")
    return found


def _reaches(sample: Sample, nm: float) -> bool:
    """Whether a wavelength lies within a sample's, and near one of them."""
    own = sample.wavelength_nm
    return own.size > 0 and own[0] <= nm <= own[-1] and float(np.min(np.abs(own - nm))) <= _NEAR_NM


def _at(nm: float, samples: Sequence[Sample], seconds: FloatArray, thickness_um: float | None) -> dict[str, Any]:
    """Values of all samples at a wavelength, and their trends."""
    t = np.array([float(np.interp(nm, one.wavelength_nm, one.transmittance)) for one in samples])
    found: dict[str, Any] = {"wavelength_nm": nm, "T": t.tolist(), "trend_T_per_s": _trend(trend(seconds, t))}
    r = np.array(
        [
            math.nan if one.reflectance is None else float(np.interp(nm, one.wavelength_nm, one.reflectance))
            for one in samples
        ]
    )
    n = np.full(len(samples), np.nan)
    if thickness_um is not None:
        for number in np.flatnonzero(np.isfinite(r)):
            both = reading([t[number]], name="T"), reading([r[number]], name="R")
            n[number] = measured([nm], *both, Length(thickness_um)).n.value[0]
    return found | {"R": plain(r), "n": plain(n), "trend_n_per_s": _trend(trend(seconds, n))}


def _trend(found: Trend | None) -> dict[str, Any] | None:
    if found is None:
        return None
    ends = found.interval95
    return {
        "slope": found.slope,
        "u_slope": found.u_slope,
        "interval95": None if ends is None else list(ends),
        "p": found.p,
        "samples": found.samples,
        "exposures": found.exposures,
    }


def _cautions(samples: Sequence[Sample], rows: list[dict[str, Any]], thickness_um: float | None) -> list[str]:
    kinds = len({one.exposure_s for one in samples})
    told = []
    if len(samples) < _FEW:
        told.append(
            f"{len(samples)} samples leave {max(len(samples) - 2, 0)} to judge a trend by: its interval is as wide as "
            "that makes it; measure several layers of each exposure"
        )
    if kinds == 2:
        told.append("two exposures: whether the change is along a straight line cannot be told")
    unclear = [
        f"{row['wavelength_nm']:g} nm"
        for row in rows
        if (found := row["trend_T_per_s"])["interval95"] is None or found["p"] > 0.05
    ]
    if unclear:
        told.append(f"no trend of T with exposure is resolved at {', '.join(unclear)}")
    told.append(
        "a layer that was exposed longer may be thicker too, unless a gap held it: measure each layer's thickness "
        "before the resin is blamed"
    )
    has_r = [one.reflectance is not None for one in samples]
    if not any(has_r):
        told.append("no reflectance: transmittance alone does not say how the index changes")
    elif thickness_um is None:
        told.append("the index needs --thickness-um")
    return told
