"""Values of a network's readings from its powers, with their uncertainties.

The powers at all receivers from one emitter come from the same rays, so their errors are correlated to an unknown
extent. The uncertainty of a reading is therefore an upper bound: the linear sum of the contributions of all powers,
with exact derivatives, or, if that is larger, the change of the reading when every power deviates by its uncertainty.

Public names: `readings_of`, `slopes_of` and `without_value`.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.ranks import warning
from solen.spec.network import Network
from solen.spec.reading import Formula


def readings_of(network: Network, power: FloatArray, u_power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values (..., readings) and bounds of their uncertainties for powers (..., emitters, receivers).

    Both are NaN where a reading has no value, such as a contrast without light.
    """
    rows = [_reading(formula, indices, power, u_power) for formula, indices in _formula_indices(network)]
    if not rows:
        empty = np.empty((*power.shape[:-2], 0))
        return empty, empty
    values, u = (np.stack(side, axis=-1) for side in zip(*rows, strict=True))
    return values, u


def without_value(names: Sequence[str], reading: FloatArray, u_reading: FloatArray) -> list[str]:
    """Return warnings about readings (states, readings) without a value or an uncertainty in some state."""
    is_missing = ~(np.isfinite(reading) & np.isfinite(u_reading))
    counts = zip(names, is_missing.sum(axis=0).tolist(), strict=True)
    return [
        warning(f"reading {name} has no value, or none with an uncertainty, in {count} of {len(is_missing)} states")
        for name, count in counts
        if count
    ]


def slopes_of(network: Network, power: FloatArray) -> FloatArray:
    """Return exact derivatives (readings, emitters, receivers) of all readings with respect to the powers."""
    slopes = np.zeros((len(network.formulas), *power.shape))
    for slope, (formula, indices) in zip(slopes, _formula_indices(network), strict=True):
        with np.errstate(all="ignore"):
            for pair, value in formula.slopes({pair: power[index] for pair, index in indices.items()}).items():
                slope[indices[pair]] = value
    return slopes


def _formula_indices(network: Network) -> Iterator[tuple[Formula, dict[tuple[str, str], tuple[int, int]]]]:
    """Yield formulas with the array indices of their powers."""
    emitters, receivers = ([part.name for part in parts] for parts in (network.emitters, network.receivers))
    for formula in network.formulas:
        yield formula, {pair: (emitters.index(pair[0]), receivers.index(pair[1])) for pair in formula.powers}


def _reading(
    formula: Formula, indices: Mapping[tuple[str, str], tuple[int, int]], power: FloatArray, u_power: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the value and the uncertainty of one reading."""
    powers, uncertainties = (
        {pair: values[..., *index] for pair, index in indices.items()} for values in (power, u_power)
    )
    with np.errstate(all="ignore"):
        value = np.asarray(formula.value(powers), dtype=float)
        slopes = {pair: np.broadcast_to(slope, value.shape) for pair, slope in formula.slopes(powers).items()}
        u = np.sum([np.abs(slope) * uncertainties[pair] for pair, slope in slopes.items()], axis=0)
        for sign in (-1.0, 1.0):
            deviated = {
                pair: powers[pair] + np.where(slope < 0.0, -sign, sign) * uncertainties[pair]
                for pair, slope in slopes.items()
            }
            u = np.fmax(u, np.abs(formula.value(deviated) - value))
    exists = np.isfinite(value)
    return np.where(exists, value, np.nan), np.where(exists & np.isfinite(u), u, np.nan)
