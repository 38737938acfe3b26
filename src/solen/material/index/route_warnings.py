"""Warnings about a route to an index: missing uncertainties, assumptions, and negative k."""

from collections.abc import Mapping, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.material.index.inversion import Inverse
from solen.material.index.lossless_index import lossless_slope
from solen.material.index.masks import ROUNDING, THREE_SIGMAS
from solen.material.index.reading import Combined, Reading, student
from solen.material.index.spectrum import Estimate
from solen.material.index.stack import Setup
from solen.ranks import Caution, do_not_use, note, warning


def too_bright(result: FloatArray, k: Combined) -> list[Caution]:
    """Return a warning if the weighted mean of all k is more negative than its uncertainty explains."""
    with np.errstate(all="ignore"):
        weight = 1.0 / (k.random**2 + (k.parts**2).sum(axis=0))
    seen = np.isfinite(result) & np.isfinite(weight)
    if not seen.any():
        return []
    share = weight[seen] / weight[seen].sum()
    mean = float(share @ result[seen])
    u = float(np.sqrt(share**2 @ k.random[seen] ** 2 + ((k.parts[:, seen] @ share) ** 2).sum()))
    freedom = float(np.min(k.freedom[seen]))
    if not mean < -u * float(student(THREE_SIGMAS, freedom)) - ROUNDING:
        return []
    return [
        do_not_use(
            f"the mean over all wavelengths is k = {mean:.1e} ± {u:.1e}, below 0: no layer emits light, so a 100 % "
            "reading, a baseline or the substrate's index is wrong, and so is n"
        )
    ]


def assumed(t: FloatArray) -> Caution:
    """Return a warning with the effect on n of assuming k = 0, at the median transmittance."""
    assumption = "lossless: k = 0 is assumed, so n is an upper bound"
    if not t.size:
        return warning(assumption)
    middle = float(np.median(t))
    by = -0.001 * float(lossless_slope(middle))
    return warning(
        f"{assumption}; if 0.1 % of the light is absorbed or scattered, n is too high by {by:.4f} at T = {middle:.4f}"
    )


def unstated(read: Mapping[str, Reading]) -> list[Caution]:
    """Return warnings about missing inputs for the uncertainty of a layer in air."""
    names = [name for name, reading in read.items() if not reading.known]
    if names:
        by = {"R": "0.0039 in R", "A": "0.0039 in A", "T": "0.0003 in T" if "R" in read else "0.0042 in T"}
        moves = " and by ".join(by[name] for name in names)
        return [
            warning(
                f"the uncertainty of {' and '.join(names)} is unknown, and so is that of n and "
                f"k: specify it with {_options(names)}, or provide repeats; near n = 1.5 an error "
                f"of 0.001 changes n by {moves}"
            )
        ]
    alone = [name for name, one in read.items() if one.repeats > 1 and not one.u_common[1].any()]
    return [
        warning(
            f"the uncertainty includes only the repeats of {' and '.join(alone)}, not the instrument's "
            f"accuracy: specify the accuracy with {_options(alone)}"
        )
    ] * bool(alone)


def _options(names: Sequence[str]) -> str:
    return " and ".join(f"--u-{name}" for name in names)


def about_substrate(inverse: Inverse, n: Estimate, read: Mapping[str, Reading], setup: Setup) -> list[Caution]:
    """Return warnings about the effect of reading and substrate errors on n, and about missing inputs."""
    warnings, at = [], np.flatnonzero(n.known)
    i = at[at.size // 2] if at.size else None
    if i is not None:
        moves = [f"{abs(inverse.n_by[name][i]) * 1e-3:.4f} per 0.001 in {name}" for name in ("R", "T") if name in read]
        sheet = f"{abs(inverse.n_by['sheet_n'][i]) * 0.01:.4f} per 0.01 in the substrate's index"
        warnings.append(note(f"on this substrate n = {inverse.n[i]:.4f} changes by {', '.join(moves)}, and {sheet}"))
    if names := [name for name, reading in read.items() if not reading.known]:
        unknown = f"the uncertainty of {' and '.join(names)} is unknown, and so is that of n"
        warnings.append(warning(f"{unknown}: specify it with {_options(names)}, or provide repeats"))
    u_sheet = np.broadcast_to(np.asarray(setup.substrate.u_n), n.value.shape)
    if not (u_sheet > 0).any():
        warnings.append(
            warning("the substrate's index is assumed exact: any error in that index causes an almost equal error in n")
        )
    if i is not None and (part := abs(float(inverse.n_by["sheet_n"][i] * u_sheet[i]))) ** 2 > float(n.u[i]) ** 2 / 2:
        warnings.append(
            warning(
                f"most of u(n) = {n.u[i]:.2g}, namely {part:.2g}, is due to the uncertainty of "
                "the substrate's index: measure T and R of the bare sheet in air, determine its "
                "index with solen resin index, and specify that index with --substrate and --u-substrate-n"
            )
        )
    return warnings
