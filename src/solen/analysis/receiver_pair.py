"""Left and right receivers combined: their difference, crosstalk, and the sign of the angle.

Both receivers measure the same sensor. More light means a lower voltage, so V_left − V_right is positive if the right
receiver is brighter, which by convention is at negative angles. A recording that violates the convention causes a
warning; signs are never changed.

Public names: `pair_response` and `sign_warnings`.
"""

import math
from collections.abc import Mapping

import numpy as np

from solen.analysis.figures_of_merit import Estimate, ReceiverResponse, over_cycles, receiver_response
from solen.analysis.response import Passes
from solen.arrays import FloatArray
from solen.ranks import Caution, warning
from solen.recording.stimulus import NEAR_ZERO_DEG
from solen.results import Result

_ROUNDING_V = 1e-9
_MIN_SIDE = 0.05  # smallest fraction of the range on one side of 0 with which a motion reaches that side


class Crosstalk(Result):
    """Response of the far receiver to a rotation from 0 to the end of the range on the side of the near receiver.

    Attributes
    ----------
    toward
        Side of the near receiver.
    angle_deg
        Angle at the end of the range.
    change_percent, u_change_percent
        Decrease of the far voltage in per cent of the decrease of the near voltage. If positive, both receivers
        brighten; if negative, the far receiver darkens, as intended.
    light_percent, u_light_percent
        Light at the far receiver in per cent of that at the near receiver, at the end of the range; NaN unless the
        voltage without light is known.
    """

    toward: str
    angle_deg: float
    change_percent: float
    u_change_percent: float
    light_percent: float = math.nan
    u_light_percent: float = math.nan


class Contrast(Result):
    """Contrast (R − L)/(R + L) of the light: mean at each angle (g,), and at both ends with uncertainties."""

    angle_deg: FloatArray
    mean: FloatArray
    at_low: float
    u_at_low: float
    at_high: float
    u_at_high: float


class PairResponse(ReceiverResponse):
    """Response of V_left − V_right.

    Attributes
    ----------
    balance_deg, u_balance_deg
        Angle nearest to 0 at which both receivers have the same voltage.
    crosstalk
        Crosstalk to the right and to the left, for each side that the motion reaches.
    contrast
        Contrast of the light; None unless the voltage without light is known.
    """

    balance_deg: float
    u_balance_deg: float
    crosstalk: tuple[Crosstalk, ...]
    contrast: Contrast | None


def pair_response(
    passes: Passes,
    sides: tuple[int, int],
    noise_V: tuple[float, float],
    dark_V: float | None,
    near_zero: float = NEAR_ZERO_DEG,
) -> PairResponse:
    """Compute the response of V_left − V_right, and the change of each receiver while the other brightens.

    Parameters
    ----------
    passes
        Half-cycles of the sensor.
    sides
        Indices of the left and the right receiver.
    noise_V
        Noise of the left and the right receiver.
    dark_V
        Voltage without light, required for ratios of light.
    near_zero
        Half-width of the range about 0 in which the sensitivity near zero is computed.
    """
    left, right = sides
    difference = Passes(
        passes.angle_deg,
        (passes.volts[..., left] - passes.volts[..., right])[..., None],
        (passes.clipped[..., left] | passes.clipped[..., right])[..., None],
        passes.middle_s,
    )
    volts = np.where(passes.clipped, np.nan, passes.volts).mean(axis=1)
    rows = difference.volts[..., 0].mean(axis=1)
    balance = over_cycles(np.array([crossing(passes.angle_deg, row) for row in rows]))
    return PairResponse(
        **vars(receiver_response(difference, math.hypot(*noise_V), near_zero=near_zero)),
        balance_deg=balance.value,
        u_balance_deg=balance.u,
        crosstalk=tuple(
            _crosstalk(passes.angle_deg, volts[..., near], volts[..., far], toward, dark_V)
            for near, far, toward in ((right, left, "right"), (left, right, "left"))
            if _reaches(passes.angle_deg, toward)
        ),
        contrast=None if dark_V is None else _contrast(passes.angle_deg, volts[..., left], volts[..., right], dark_V),
    )


def crossing(angle_deg: FloatArray, row: FloatArray) -> float:
    """Return the angle nearest to 0 at which a cycle's difference crosses zero, by linear interpolation."""
    with np.errstate(invalid="ignore"):
        before = np.flatnonzero(row[:-1] * row[1:] <= 0.0)
    crossings = [
        float(angle_deg[n] + (angle_deg[n + 1] - angle_deg[n]) * row[n] / (row[n] - row[n + 1]))
        for n in before
        if row[n] != row[n + 1]
    ]
    return min(crossings, key=abs, default=math.nan)


def _reaches(angle_deg: FloatArray, toward: str) -> bool:
    """Return whether a motion reaches the side of a receiver; a force or depth has no negative side."""
    low, high = float(angle_deg[0]), float(angle_deg[-1])
    return low < -_MIN_SIDE * (high - low) if toward == "right" else high > _MIN_SIDE * (high - low)


def _crosstalk(
    angle_deg: FloatArray, near: FloatArray, far: FloatArray, toward: str, dark_V: float | None
) -> Crosstalk:
    middle = int(np.argmin(np.abs(angle_deg)))
    end = 0 if toward == "right" else -1  # by the convention
    near_fall, far_fall = near[:, middle] - near[:, end], far[:, middle] - far[:, end]
    change = light = Estimate(math.nan, math.nan)
    if over_cycles(near_fall).resolved:
        change = over_cycles(100.0 * far_fall / np.where(near_fall == 0.0, np.nan, near_fall))
    if dark_V is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            light = over_cycles(100.0 * (dark_V - far[:, end]) / (dark_V - near[:, end]))
    return Crosstalk(toward, float(angle_deg[end]), *change, *light)


def _contrast(angle_deg: FloatArray, left: FloatArray, right: FloatArray, dark_V: float) -> Contrast:
    """Return the contrast (R − L)/(R + L) against angle; the light is the drop of a voltage below the dark voltage."""
    with np.errstate(divide="ignore", invalid="ignore"):
        contrast = (left - right) / (2.0 * dark_V - left - right)
    return Contrast(angle_deg, contrast.mean(axis=0), *over_cycles(contrast[:, 0]), *over_cycles(contrast[:, -1]))


def sign_warnings(
    receivers: Mapping[str, ReceiverResponse], sides: tuple[int, int] | None, unit: str = "V"
) -> list[Caution]:
    """Return a warning unless a rising angle darkens the right and brightens the left receiver (the convention)."""
    if sides is None:
        return []
    names = [list(receivers)[side] for side in sides]
    left, right = (Estimate(receivers[name].swing_V, receivers[name].u_swing_V) for name in names)
    if not (left.resolved and right.resolved) or min(abs(left.value), abs(right.value)) < _ROUNDING_V:
        return []
    changes = (
        f"from the lowest to the highest angle, {names[0]} changes by {left.value:+.3g} {unit} and {names[1]} by "
        f"{right.value:+.3g} {unit}"
    )
    if left.value > 0.0 > right.value and unit == "V":  # in lux, brighter is a higher value
        reverse = (
            f"{changes}, which is the reverse of the convention (at negative angles the right receiver is brighter, "
            "and a brighter receiver has a lower voltage). Either the angle has the opposite sign, the receivers are "
            "swapped, or the voltage of the circuit rises with light. No sign was changed: --flip-angle reverses the "
            "sign of the angle"
        )
        return [warning(reverse)]
    if left.value * right.value > 0.0:
        return [warning(f"{changes}: both change in the same direction, so they do not distinguish the sides")]
    return []
