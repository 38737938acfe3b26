"""What `solen print calibrate` does: from files of measured features to a process file.

A file of features is JSON: ``{"coupon": …, "simulated": …, "features": [{"kind": "pillar" | "hole" | "gap" | "step",
"nominal_mm": …, "measured_mm": …, "u_mm": …, "resolved": …}, …]}``; a gap may state ``diameter_mm`` of its pillars.
Other keys, such as those that `solen print fidelity --out` adds, are left alone.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solen import __version__, files
from solen.errors import DataError, OutputError
from solen.fabricate.process import Feature, Fit, calibrated, default_process, process_text, read_process
from solen.fabricate.process.coupons import GAP_PILLAR_MM, KINDS
from solen.pipeline.outputs import check_figure
from solen.recording import Provenance
from solen.recording.source import load
from solen.spec.objects import parsed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LARGEST_MM = 100.0


def calibrate_printer(
    paths: Sequence[Path], process: Path | None = None, out: Path | None = None, figure: Path | None = None
) -> dict[str, Any]:
    """Find a process's blur, edge and shrinkage from measured coupons.

    Parameters
    ----------
    paths
        Files of features; all were printed by one process.
    process
        What the process was taken to be before, with the settings that the coupons were printed with; None for the
        default.
    out
        Write the process here.
    figure
        Draw printed beside measured sizes into this file.

    Raises
    ------
    SolenError
        Where a file cannot be read, or its features tell too little; nothing is written then.
    """
    check_figure(figure)
    if out is not None and out.suffix.lower() != ".toml":
        raise OutputError(str(out), limit="a process ends in .toml", remedy="rename it")
    if not paths:
        raise DataError("coupons", limit="no file of features", remedy="name one or more")
    before = default_process() if process is None else read_process(process)
    read = [read_features(path) for path in paths]
    features = [feature for found, _ in read for feature in found]
    simulated = any(source["simulated"] for _, source in read)
    name = ", ".join(dict.fromkeys(path.name for path in paths))
    fit = calibrated(before, features, name, simulated=simulated)
    told = _told(fit, features, simulated) | {"sources": [source for _, source in read]}
    contents: dict[Path, files.Content] = {}
    if out is not None:
        comment = f"# Written by solen {__version__} calibrate-printer.\n"
        contents[out] = (comment + process_text(fit.process)).encode()
    if figure is not None:
        from solen.report import canvas

        contents[figure] = canvas.encoded(_drawn(fit, simulated), figure.suffix.lower(), "calibration")
    files.write_all(contents)
    return told | {key: str(path) for key, path in (("out", out), ("figure", figure)) if path is not None}


def _told(fit: Fit, features: Sequence[Feature], simulated: bool) -> dict[str, Any]:
    scale = fit.u[:, None] * fit.u
    warnings = [*fit.warnings]
    if simulated:
        warnings.insert(0, "the features are simulated, not measured")
    return {
        "name": fit.process.name,
        "simulated": simulated,
        "found": {
            key: {"value": float(value), "u": float(u), "u_before": float(before)}
            for key, value, u, before in zip(fit.keys, fit.value, fit.u, fit.u_before, strict=True)
        },
        "Ec_mJ_per_cm2": {"value": fit.Ec[0], "u": fit.Ec[1]},
        "correlation": (fit.covariance / scale).tolist(),
        "features": {"given": len(features), "used": len(fit.features)},
        "rms_um": fit.rms_um,
        "chi2": fit.chi2,
        "df": fit.df,
        "widened_by": fit.scale,
        "residuals": [
            {
                "kind": one.kind,
                "nominal_mm": one.nominal_mm,
                "measured_mm": one.measured_mm,
                "printed_mm": _number(size),
            }
            for one, size in zip(fit.features, fit.printed_mm.tolist(), strict=True)
        ],
        "disagree": [
            {"kind": one.kind, "nominal_mm": one.nominal_mm, "resolved": one.resolved} for one in fit.disagree
        ],
        "settings": fit.process.process.model_dump(),
        "warnings": warnings,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def read_features(path: Path) -> tuple[list[Feature], dict[str, Any]]:
    """Features of a file, and its provenance; `DataError` where it holds none, or one that is not possible."""
    source = load(path)
    data = parsed(source.text(), str(path))
    if not isinstance(data, dict) or not isinstance(data.get("features"), list):
        raise DataError(str(path), limit='not a file of features: it has no list "features"')
    simulated = data.get("simulated", False)
    if not isinstance(simulated, bool):
        raise DataError(f"{path}: simulated", value=simulated, limit="must be true or false")
    found = [_feature(one, f"{path}: features[{i}]") for i, one in enumerate(data["features"])]
    coupon = {"coupon": str(data.get("coupon", ""))}
    provenance = Provenance(source.name, source.sha256, "solen-features", metadata=coupon, simulated=simulated)
    return found, provenance.as_dict()


def _feature(data: Any, where: str) -> Feature:
    if not isinstance(data, dict):
        raise DataError(where, value=data, limit="must be an object")
    kind = data.get("kind")
    if kind not in KINDS:
        raise DataError(f"{where}: kind", value=kind, limit=f"must be one of {', '.join(KINDS)}")
    resolved = data.get("resolved")
    if not isinstance(resolved, bool):
        raise DataError(f"{where}: resolved", value=resolved, limit="must be true or false")
    # of what is not resolved a picture may still tell a size, such as a step of no height: it is not used
    sizes = (data.get("measured_mm"), data.get("u_mm")) if resolved else (None, None)
    measured, u = (_length(size, f"{where}: {key}") for key, size in zip(("measured_mm", "u_mm"), sizes, strict=True))
    if resolved and measured is not None and u is None:
        limit = "missing: a measured size without its uncertainty cannot be weighed"
        raise DataError(f"{where}: u_mm", limit=limit, remedy="state it")
    nominal = _length(data.get("nominal_mm"), f"{where}: nominal_mm")
    if nominal is None:
        raise DataError(f"{where}: nominal_mm", limit="missing")
    beside = _length(data.get("diameter_mm"), f"{where}: diameter_mm") or GAP_PILLAR_MM
    return Feature(kind, nominal, measured, u, resolved, beside, where)


def _length(value: Any, where: str) -> float | None:
    """A length above 0, or None for null."""
    if value is None:
        return None
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and 0.0 < value <= LARGEST_MM):
        raise DataError(where, value=value, limit=f"must be a number above 0, at most {LARGEST_MM:g} mm, or null")
    return float(value)


def _drawn(fit: Fit, simulated: bool) -> "Figure":
    from solen.report.print.calibrate import calibration_figure

    return calibration_figure(fit, simulated=simulated)
