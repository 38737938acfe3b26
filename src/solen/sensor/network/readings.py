"""Values of a network's readings from its powers, with their uncertainties.

The receivers' powers under one emitter come from the same rays, so their errors are correlated to an unknown extent.
The uncertainty of a reading is therefore the linear sum of its parts, with exact derivatives: an upper bound. If a
reading is too strongly curved for derivatives, its uncertainty is the change when every power deviates by its
uncertainty.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.ranks import warning
from solen.spec.network import Network
from solen.spec.reading import Formula


def readings_of(network: Network, power: FloatArray, u_power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values (..., readings) and bounds of their uncertainties for powers (..., emitters, receivers).

    They are NaN if a reading has no value, such as a contrast without light.
    """
    rows = [_reading(formula, places, power, u_power) for formula, places in _places(network)]
    if not rows:
        none = np.empty((*power.shape[:-2], 0))
        return none, none
    values, u = (np.stack(side, axis=-1) for side in zip(*rows, strict=True))
    return values, u


def without_value(names: Sequence[str], reading: FloatArray, u_reading: FloatArray) -> list[str]:
    """Return warnings about readings (states, readings) that have no value or no uncertainty in some state."""
    bad = ~(np.isfinite(reading) & np.isfinite(u_reading))
    counts = zip(names, bad.sum(axis=0).tolist(), strict=True)
    return [
        warning(f"reading {name} has no certain value in {count} of {len(bad)} states")
        for name, count in counts
        if count
    ]


def slopes_of(network: Network, power: FloatArray) -> FloatArray:
    """Return exact derivatives (readings, emitters, receivers) of all readings with respect to the powers."""
    found = np.zeros((len(network.formulas), *power.shape))
    for slope, (formula, places) in zip(found, _places(network), strict=True):
        with np.errstate(all="ignore"):
            for pair, value in formula.slopes({pair: power[place] for pair, place in places.items()}).items():
                slope[places[pair]] = value
    return found


def _places(network: Network) -> Iterator[tuple[Formula, dict[tuple[str, str], tuple[int, int]]]]:
    """Return formulas with the indices of their powers."""
    emitters, receivers = ([one.name for one in many] for many in (network.emitters, network.receivers))
    for formula in network.formulas:
        yield formula, {pair: (emitters.index(pair[0]), receivers.index(pair[1])) for pair in formula.powers}


def _reading(
    formula: Formula, places: Mapping[tuple[str, str], tuple[int, int]], power: FloatArray, u_power: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return value and uncertainty of one reading."""
    at, off = ({pair: every[..., *place] for pair, place in places.items()} for every in (power, u_power))
    with np.errstate(all="ignore"):
        value = np.asarray(formula.value(at), dtype=float)
        slopes = {pair: np.broadcast_to(slope, value.shape) for pair, slope in formula.slopes(at).items()}
        u = np.sum([np.abs(slope) * off[pair] for pair, slope in slopes.items()], axis=0)
        for sign in (-1.0, 1.0):
            towards = {pair: np.where(slope < 0.0, -sign, sign) for pair, slope in slopes.items()}
            moved = {pair: at[pair] + way * off[pair] for pair, way in towards.items()}
            u = np.fmax(u, np.abs(formula.value(moved) - value))
    exists = np.isfinite(value)
    return np.where(exists, value, np.nan), np.where(exists & np.isfinite(u), u, np.nan)
