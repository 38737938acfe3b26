"""Warnings about the routes to an index: missing uncertainties, assumptions, and negative k."""

from collections.abc import Mapping, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.material.index.lossless_index import lossless_slope
from solen.material.index.masks import ROUNDING, THREE_SIGMAS
from solen.material.index.reading import Combined, Reading, student_t
from solen.material.index.spectrum import Estimate
from solen.material.index.stack import Setup
from solen.material.index.substrate import SubstrateInversion
from solen.ranks import Caution, do_not_use, note, warning


def negative_k_warnings(result: FloatArray, k: Combined) -> list[Caution]:
    """Return a warning if the weighted mean of k is more negative than its uncertainty explains."""
    with np.errstate(all="ignore"):
        weight = 1.0 / (k.random**2 + (k.parts**2).sum(axis=0))
    known = np.isfinite(result) & np.isfinite(weight)
    if not known.any():
        return []
    weight = weight[known] / weight[known].sum()
    mean = float(weight @ result[known])
    u = float(np.sqrt(weight**2 @ k.random[known] ** 2 + ((k.parts[:, known] @ weight) ** 2).sum()))
    df = float(np.min(k.df[known]))
    if not mean < -u * float(student_t(THREE_SIGMAS, df)) - ROUNDING:
        return []
    return [
        do_not_use(
            f"the mean over all wavelengths is k = {mean:.1e} ± {u:.1e}, below 0, which is impossible: a 100 % "
            "reading, a baseline or the substrate's index is wrong, and so is n"
        )
    ]


def lossless_warning(t: FloatArray) -> Caution:
    """Return a warning with the effect on n of assuming k = 0, at the median transmittance."""
    assumption = "lossless: k = 0 is assumed, so n is an upper bound"
    if not t.size:
        return warning(assumption)
    median = float(np.median(t))
    error = -0.001 * float(lossless_slope(median))
    return warning(
        f"{assumption}; if 0.1 % of the light is absorbed or scattered, n is too high by {error:.4f} at "
        f"T = {median:.4f}"
    )


def input_warnings(read: Mapping[str, Reading]) -> list[Caution]:
    """Return warnings about missing uncertainties of the readings of a layer in air."""
    names = [name for name, reading in read.items() if not reading.known]
    if names:
        changes = {"R": "0.0039 for R", "A": "0.0039 for A", "T": "0.0003 for T" if "R" in read else "0.0042 for T"}
        return [
            warning(
                f"the uncertainty of {' and '.join(names)} is unknown, and so is that of n and "
                f"k: specify it with {_options(names)}, or repeat the measurement; near n = 1.5, an error "
                f"of 0.001 changes n by {' and '.join(changes[name] for name in names)}"
            )
        ]
    without_accuracy = [name for name, reading in read.items() if reading.repeats > 1 and not reading.u_common[1].any()]
    return [
        warning(
            f"the uncertainty includes only the scatter of {' and '.join(without_accuracy)}, not the instrument's "
            f"accuracy: specify the accuracy with {_options(without_accuracy)}"
        )
    ] * bool(without_accuracy)


def _options(names: Sequence[str]) -> str:
    return " and ".join(f"--u-{name}" for name in names)


def substrate_warnings(
    inverse: SubstrateInversion, n: Estimate, read: Mapping[str, Reading], setup: Setup
) -> list[Caution]:
    """Return warnings about the effect of reading and substrate errors on n, and about missing inputs."""
    warnings, known = [], np.flatnonzero(n.known)
    i = known[known.size // 2] if known.size else None
    if i is not None:
        changes = [
            f"{abs(inverse.n_by[name][i]) * 1e-3:.4f} per 0.001 in {name}" for name in ("R", "T") if name in read
        ]
        sheet = f"{abs(inverse.n_by['sheet_n'][i]) * 0.01:.4f} per 0.01 in the substrate's index"
        warnings.append(note(f"on this substrate n = {inverse.n[i]:.4f} changes by {', '.join(changes)}, and {sheet}"))
    if names := [name for name, reading in read.items() if not reading.known]:
        unknown = f"the uncertainty of {' and '.join(names)} is unknown, and so is that of n"
        warnings.append(warning(f"{unknown}: specify it with {_options(names)}, or repeat the measurement"))
    u_sheet = np.broadcast_to(np.asarray(setup.substrate.u_n), n.value.shape)
    if not (u_sheet > 0).any():
        warnings.append(
            warning("the substrate's index is assumed to be exact: its error causes an almost equal error in n")
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
