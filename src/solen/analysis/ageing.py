"""Ageing of a sensor over many cycles: response, balance angle and noise for groups of consecutive cycles.

Each group gives a swing, a level and a balance angle, with uncertainties from the scatter of its cycles, and the noise
of a reading (`solen.analysis.noise`). Changes from group to group that exceed these uncertainties are ageing or drift;
the cycles alone cannot distinguish the two.

`ageing_of` computes an `Ageing` from a sensor's half-cycles and the scatter of its readings.
"""

from collections.abc import Sequence

import numpy as np

from solen.analysis.figures_of_merit import Estimate, levels, line_fit, over_cycles, swing
from solen.analysis.noise import Scatter, pooled_noise
from solen.analysis.receiver_pair import crossing
from solen.analysis.response import Passes
from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.results import Result

MIN_GROUPS = 3
"""Smallest number of groups from which a trend is computed."""


class ReceiverAgeing(Result):
    """Results of a receiver for each group of cycles.

    Attributes
    ----------
    swing_V, u_swing_V
        Voltage at the largest angle minus voltage at the smallest angle, (groups,).
    level_V, u_level_V
        Mean voltage over the angles.
    noise_V
        Standard deviation of a reading.
    swing_V_per_cycle, u_swing_V_per_cycle, level_V_per_cycle, u_level_V_per_cycle
        Slopes of swing and level against the cycle number; the uncertainties follow from the scatter of the groups
        about a straight line.
    """

    swing_V: FloatArray
    u_swing_V: FloatArray
    level_V: FloatArray
    u_level_V: FloatArray
    noise_V: FloatArray
    swing_V_per_cycle: float
    u_swing_V_per_cycle: float
    level_V_per_cycle: float
    u_level_V_per_cycle: float


class Ageing(Result):
    """Ageing of a sensor over its cycles.

    Attributes
    ----------
    first_cycle
        Number of the first cycle in each group, counted from 1 among the cycles used, (groups,).
    receivers
        Results for each receiver, keyed by its name.
    balance_deg, u_balance_deg
        Angle nearest to 0 at which the left and right voltages are equal, (groups,); NaN if the receiver names do not
        identify left and right.
    balance_deg_per_cycle, u_balance_deg_per_cycle
        Slope of the balance angle against the cycle number.
    """

    first_cycle: IntArray
    receivers: dict[str, ReceiverAgeing]
    balance_deg: FloatArray
    u_balance_deg: FloatArray
    balance_deg_per_cycle: float
    u_balance_deg_per_cycle: float


def ageing_of(
    passes: Passes,
    scatters: Sequence[Scatter],
    names: Sequence[str],
    sides: tuple[int, int] | None,
    every: int,
) -> Ageing:
    """Compute the results for groups of ``every`` consecutive cycles; an incomplete last group is omitted.

    Parameters
    ----------
    passes
        Half-cycles of all used cycles, in order.
    scatters
        Scatter of the readings in each of these cycles.
    names, sides
        Receiver names, and the indices of the left and right receivers in this list.
    every
        Number of cycles in a group.

    Raises
    ------
    DataError
        If there are fewer than three groups.
    """
    groups = passes.cycles // every
    if groups < MIN_GROUPS:
        limit = f"makes {groups} groups of {passes.cycles} cycles, but at least {MIN_GROUPS} groups are needed"
        raise DataError("--every", value=every, limit=limit, remedy="use fewer cycles per group")
    volts = np.where(passes.clipped, np.nan, passes.volts).mean(axis=1)
    middle: FloatArray = np.asarray(every * (np.arange(groups) + 0.5), np.float64)
    slices = [slice(begin, begin + every) for begin in range(0, groups * every, every)]
    noise = np.array([pooled_noise(scatters[group]) for group in slices])
    receivers = {}
    for index, name in enumerate(names):
        rows = [volts[group, :, index] for group in slices]
        swings, means = [swing(passes.angle_deg, row) for row in rows], [over_cycles(levels(row)) for row in rows]
        receivers[name] = ReceiverAgeing(
            *_columns(swings), *_columns(means), noise[:, index], *_slope(middle, swings), *_slope(middle, means)
        )
    balances = [Estimate(np.nan, np.nan)] * groups
    if sides is not None:
        difference = volts[..., sides[0]] - volts[..., sides[1]]
        crossings = np.array([crossing(passes.angle_deg, row) for row in difference])
        balances = [over_cycles(crossings[group]) for group in slices]
    first = 1 + every * np.arange(groups)
    return Ageing(first, receivers, *_columns(balances), *_slope(middle, balances))


def _columns(values: Sequence[Estimate]) -> tuple[FloatArray, FloatArray]:
    return np.array([value.value for value in values]), np.array([value.u for value in values])


def _slope(middle: FloatArray, values: Sequence[Estimate]) -> Estimate:
    return line_fit(middle, np.array([value.value for value in values]))
