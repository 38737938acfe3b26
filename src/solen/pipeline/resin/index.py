"""What `solen resin index` does: spectra of a printed layer in, its index against wavelength out.

The idea: a result says in every form what it is and what it is not. What is masked is null, with its reason beside it;
what was not stated, of the instrument and of the layer, is told as a warning.
"""

from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.material.index import Estimate, IndexSpectrum
from solen.material.index.fit import Fit
from solen.material.index.fringes import fringe_warnings
from solen.material.index.light import Evaluated, index_in, lines
from solen.material.index.routes import lossless_index
from solen.pipeline.design.light import light_named
from solen.pipeline.outputs import check_figure, check_out, leave
from solen.pipeline.resin.indexfit import described, fitted, literature, unfit
from solen.pipeline.resin.indexroute import IndexOptions, absorbance_warnings, spectrum
from solen.pipeline.resin.traces import OPTIONS, Spectra, spectra_of
from solen.recording import Recording, read

_ABOVE = 0.02  # share of the wavelengths with T > 1 from which on a baseline on a substrate is suspected


def index(
    path: Path, options: IndexOptions | None = None, *, out: Path | None = None, figure: Path | None = None
) -> dict[str, Any]:
    """Index of a layer from the spectra in a file.

    Raises
    ------
    DataError, SpecError
        Where the file cannot be read, traces must be chosen, something must be stated, or no index follows.
    """
    options = options or IndexOptions()
    options.check()
    check_figure(figure)
    check_out(out)
    recording = read(path, sheet=options.sheet)
    spectra = spectra_of(recording, {kind: options.chosen.get(kind, ()) for kind in OPTIONS})
    found = spectrum(spectra, options)
    bandwidth_nm = options.bandwidth_nm or stated_bandwidth_nm(recording)
    model = fitted(options.fit, found, options.terms)
    known, remarks = literature(found, options.polymers, options.literature)
    at = [lines([nm], [1.0]) for nm in options.at_nm]
    light = None if options.led is None else light_named(options.led)
    result = {
        "file": recording.provenance.file,
        "mode": found.mode,
        "measurement": found.measurement,
        "baseline": options.baseline or "air",
        "substrate": _substrate(options),
        "thickness_um": options.thickness_um,
        "u_thickness_um": options.u_thickness_um,
        "bandwidth_nm": bandwidth_nm,
        **arrays(found),
        "fit": described(model, found, at, None if light is None else light[0]) if isinstance(model, Fit) else None,
        "literature": known,
        "at": [_evaluated(index_in(found, one)) for one in at],
        "led": None if light is None else {"source": light[1], **_evaluated(index_in(found, light[0]))},
        "traces": {kind: list(names) for kind, names in spectra.names.items()},
        "repeats": _repeats(spectra),
        "sources": [recording.provenance.as_dict()],
        "warnings": [*_warnings(found, spectra, options, bandwidth_nm), *remarks, *unfit(model)],
    }

    def draw() -> Any:
        from solen.report.resin.index import index_figure

        return index_figure(result)

    return leave(result, "index", out, figure, draw)


def arrays(found: IndexSpectrum) -> dict[str, Any]:
    """Index and extinction along the wavelengths as lists, null where masked or not known."""
    return {
        "wavelength_nm": plain(found.wavelength_nm),
        **_of(found.n, "n", ("u", "u_random", "u_common", "u95")),
        **_of(found.k, "k", ("u",)),
        "k_low95": plain(found.k_low95),
        "k_high95": plain(found.k_high95),
        "correlation_nk": plain(found.correlation),
        "reason": list(found.reason),
        "masked": {"n": int((~found.n.known).sum()), "k": int((~found.k.known).sum())},
        "lossless": _of(found.lossless, "n", ("u",)),
        "T": plain(found.transmittance),
        "R": plain(found.reflectance),
    }


def plain(values: FloatArray) -> list[float | None]:
    """Numbers of an array, None for what is none."""
    return [value if np.isfinite(value) else None for value in np.asarray(values, dtype=float).tolist()]


def stated_bandwidth_nm(recording: Recording) -> float | None:
    """Spectral bandwidth that an instrument wrote into its file."""
    for name, text in recording.provenance.metadata.items():
        if "sbw" in name.lower():
            try:
                value = float(text)
            except ValueError:
                continue
            if 0.0 < value < np.inf:
                return value
    return None


def _of(one: Estimate, name: str, fields: tuple[str, ...]) -> dict[str, Any]:
    parts = {f"u_{name}{part.removeprefix('u')}" if part != "u95" else f"u95_{name}": part for part in fields}
    return {name: plain(one.value)} | {key: plain(getattr(one, part)) for key, part in parts.items()}


def _evaluated(one: Evaluated) -> dict[str, Any]:
    return dict(vars(one))


def _substrate(options: IndexOptions) -> dict[str, Any] | None:
    if options.substrate is None:
        return None
    return {
        "name": options.substrate,
        "thickness_um": options.substrate_thickness_um,
        "u_n": options.u_substrate_n,
        "side": options.side or "layer",
        "r_baseline": options.r_baseline or "air",
    }


def _repeats(spectra: Spectra) -> dict[str, Any] | None:
    """Lossless index of each repeat of T, at the longest wavelength that all have it at."""
    rows = spectra.rows.get("T")
    if rows is None or len(rows) < 2:
        return None
    n = lossless_index(rows)
    (at,) = np.nonzero(np.isfinite(n).all(axis=0))
    if not at.size:
        return None
    return {
        "traces": list(spectra.names["T"]),
        "wavelength_nm": float(spectra.wavelength_nm[at[-1]]),
        "lossless_n": n[:, at[-1]].tolist(),
    }


def _warnings(found: IndexSpectrum, spectra: Spectra, options: IndexOptions, bandwidth_nm: float | None) -> list[str]:
    told = [*found.warnings, *spectra.warnings, *absorbance_warnings(spectra, options), *_of_repeats(spectra)]
    if options.baseline is None:
        told.append("the baseline is not stated and taken as air, of a layer that stands free: say --baseline")
    if options.substrate is None:
        told += _too_bright(spectra)
    if options.thickness_um is not None:
        told += fringe_warnings(found.wavelength_nm, found.lossless.value, options.thickness_um, bandwidth_nm)
        if options.u_thickness_um is None and found.k.known.any():
            told.append("the uncertainty of the thickness is not stated and not in u_k: k goes with 1/thickness")
    if spectra.unused and len(spectra.unused) < 4:
        told.append(f"not used: {', '.join(spectra.unused)}")
    return told


def _of_repeats(spectra: Spectra) -> list[str]:
    repeats = _repeats(spectra)
    if repeats is None:
        return []
    first, *_, last = repeats["lossless_n"]
    return [
        f"lossless n({repeats['wavelength_nm']:g} nm) of the {len(repeats['traces'])} repeats, in their order: "
        f"{first:.3f} … {last:.3f}"
    ]


def _too_bright(spectra: Spectra) -> list[str]:
    """Whether T looks as if its 100 % had been taken on a substrate."""
    if "T" not in spectra.rows:
        return []
    t = spectra.rows["T"].mean(axis=0)
    above = float(np.mean(t > 1.0))
    if above < _ABOVE:
        return []
    return [
        f"T exceeds 1 at {above:.0%} of the wavelengths, up to {np.nanmax(t):.4f}: a free-standing layer cannot, one "
        "measured against its bare substrate does; then say --baseline substrate"
    ]
