"""What `solen resin refractometer` does: an index at one wavelength or a few in, n against wavelength out.

The idea: the result has the arrays of `solen resin index`, so that whatever takes the one takes the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solen.errors import SpecError
from solen.material.index.light import formula_in, lines
from solen.material.index.literature import LINE_D, POLYMERS, RESINS, band, check_index
from solen.material.index.prior import DN_DT_PER_K, VALID_NM, Refractometer, prior_of, stated_prior
from solen.material.index.prior import refractometer as fitted
from solen.pipeline.design.light import light_named
from solen.pipeline.outputs import check_choice, check_figure, check_out, check_wavelength, leave
from solen.recording import Provenance

STEP_NM = 5.0
"""Distance of the wavelengths of a result."""

_NO_K = "k: a refractometer does not measure it"
_WIDE = 1.959963984540054  # half of 95 % of a normal distribution, in standard deviations


@dataclass(frozen=True)
class RefractometerOptions:
    """What was measured and what is known of the material; None and empty is what was not said.

    Attributes
    ----------
    n, u, wavelength_nm
        Indices, their standard uncertainties, their wavelengths.
    u_shared, u_temperature_k, dn_dt_per_k
        Uncertainties that all values share: of the calibration, and of the temperature by its coefficient.
    polymers
        Classes of `solen.material.index.literature.POLYMERS` that the material is like.
    abbe, u_abbe
        Its Abbe number, in place of theirs.
    at_nm, led
        Wavelengths, and an emitter, at which n is told.
    """

    n: Sequence[float]
    u: Sequence[float]
    wavelength_nm: Sequence[float] = ()
    u_shared: float = 0.0
    u_temperature_k: float = 0.0
    dn_dt_per_k: float | None = None
    polymers: Sequence[str] = ()
    abbe: float | None = None
    u_abbe: float | None = None
    at_nm: Sequence[float] = ()
    led: str | None = None

    def check(self) -> None:
        """`SpecError` for what cannot be."""
        for name in self.polymers:
            check_choice("--polymer", name, POLYMERS)
        if len(self.n) > 1 and not self.wavelength_nm:
            raise SpecError("--wavelength-nm", limit="is missing", remedy="say it once for each index, in their order")
        if (self.abbe is None) != (self.u_abbe is None):
            missing, there = ("--abbe", "--u-abbe") if self.abbe is None else ("--u-abbe", "--abbe")
            raise SpecError(missing, limit=f"is missing beside {there}", remedy="state both")
        if self.abbe is not None and self.polymers:
            raise SpecError("--polymer", limit="cannot go with --abbe", remedy="state one of the two")
        low, high = VALID_NM
        for nm in self.at_nm:
            if not low <= nm <= high:
                check_wavelength(nm, "--at-nm")
                raise SpecError("--at-nm", value=nm, limit=f"must be from {low:g} to {high:g}")


def refractometer(
    options: RefractometerOptions, *, out: Path | None = None, figure: Path | None = None
) -> dict[str, Any]:
    """Index against wavelength from measured values and the dispersion that polymers have.

    Raises
    ------
    DataError, SpecError
        Where a value is none, options contradict each other, or no polymer has such a dispersion.
    """
    options.check()
    check_figure(figure)
    check_out(out)
    stated = options.abbe is not None and options.u_abbe is not None
    prior = stated_prior(options.abbe, options.u_abbe) if stated else prior_of(options.polymers or RESINS)  # type: ignore[arg-type]
    dn_dt_per_k = DN_DT_PER_K if options.dn_dt_per_k is None else options.dn_dt_per_k
    found = fitted(
        options.n,
        options.u,
        options.wavelength_nm or LINE_D,
        u_shared=options.u_shared,
        u_temperature_k=options.u_temperature_k,
        dn_dt_per_k=dn_dt_per_k,
        prior=prior,
    )
    result = _result(found, options, dn_dt_per_k)

    def draw() -> Any:
        from solen.report.resin.refractometer import refractometer_figure

        known = band(result["wavelength_nm"], options.polymers or RESINS, package=False)
        return refractometer_figure(result, known.low, known.high, options.polymers or RESINS)

    return leave(result, "refractometer", out, figure, draw)


def _result(found: Refractometer, options: RefractometerOptions, dn_dt_per_k: float) -> dict[str, Any]:
    nm = np.arange(VALID_NM[0], VALID_NM[1] + STEP_NM / 2, STEP_NM)
    n, u_n = found.index(nm)
    values = {
        "wavelength_nm": found.values.wavelength_nm.tolist(),
        "n": found.values.n.tolist(),
        "u_n": np.sqrt(np.diag(found.values.covariance)).tolist(),
    }
    return {
        "mode": "refractometer",
        "measurement": True,
        "wavelength_nm": nm.tolist(),
        "n": n.tolist(),
        "u_n": u_n.tolist(),
        "u95_n": (_WIDE * u_n).tolist(),
        "k": [None] * nm.size,
        "u_k": [None] * nm.size,
        "reason": [_NO_K] * nm.size,
        "values": values,
        "line": {"wavelength_nm": LINE_D, "n": found.n_line, "u_n": found.u_line},
        "dispersion": {
            "abbe": found.abbe,
            "u_abbe": found.u_abbe,
            "bend": found.share,
            "u_bend": found.u_share,
            "prior": dict(vars(found.prior)),
            "chi2": found.chi2,
            "freedom": found.freedom,
        },
        "temperature": {"u_temperature_k": options.u_temperature_k, "dn_dt_per_k": dn_dt_per_k},
        "fit": {
            "kind": "cauchy",
            "terms": 3,
            "model": found.model.model_dump(mode="json", exclude_none=True),
        },
        "at": [dict(vars(formula_in(found.model, lines([one], [1.0])))) for one in options.at_nm],
        "led": _in_led(found, options.led),
        "sources": [Provenance(format="stated", instrument="refractometer").as_dict()],
        "warnings": [*found.warnings, *_literature(found, options)],
    }


def _in_led(found: Refractometer, name: str | None) -> dict[str, Any] | None:
    if name is None:
        return None
    light, source = light_named(name)
    return {"source": source, **vars(formula_in(found.model, light))}


def _literature(found: Refractometer, options: RefractometerOptions) -> list[str]:
    """Whether the measured values lie where such polymers do."""
    values = found.values
    u_n = np.sqrt(np.diag(values.covariance))
    return check_index(values.wavelength_nm, values.n, u_n, options.polymers or RESINS, package=False)
