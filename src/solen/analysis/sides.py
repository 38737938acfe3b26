"""Left and right together: their difference, what one sees of the other's light, and the sense of the angle.

The idea: a sensor is read by both receivers. Brighter means a lower voltage, so V_left − V_right is positive where the
right one is brighter, as it is at negative angles in this project's convention. Whether a recording follows it is
checked and said; nothing is turned round.

The interface: `pair_numbers` of a sensor's passes; `sign_warnings` of its receivers' numbers.
"""

import math
from typing import Any

import numpy as np

from solen.analysis.numbers import Estimate, over_cycles, receiver_numbers
from solen.analysis.response import Passes, curve
from solen.arrays import FloatArray

_NOTHING_V = 1e-9  # a change below this is rounding


def pair_numbers(
    found: Passes,
    sides: tuple[int, int],
    noise_V: list[float],
    dark_V: float | None,
) -> dict[str, Any]:
    """Numbers of V_left − V_right, and of what each receiver sees while the other brightens.

    Parameters
    ----------
    found
        Passes of the sensor.
    sides
        Places of the left and the right receiver.
    noise_V
        Of each receiver.
    dark_V
        Voltage without light; without it, shares of light cannot be told.
    """
    left, right = sides
    apart = Passes(
        found.angle_deg,
        (found.volts[..., left] - found.volts[..., right])[..., None],
        (found.clipped[..., left] | found.clipped[..., right])[..., None],
        found.middle_s,
    )
    size = found.angle_deg.size
    mean = curve(apart.volts[..., 0].reshape(-1, size), apart.clipped[..., 0].reshape(-1, size))
    volts = np.where(found.clipped, np.nan, found.volts).mean(axis=1)
    balance = _balance(apart)
    return {
        "angle_deg": found.angle_deg,
        "mean_V": mean.mean_V,
        "sd_V": mean.sd_V,
        **receiver_numbers(apart, math.hypot(noise_V[left], noise_V[right])),
        "balance_deg": balance.value,
        "u_balance_deg": balance.u,
        "crosstalk": [
            _crosstalk(found.angle_deg, volts[..., near], volts[..., far], toward, dark_V)
            for near, far, toward in ((right, left, "right"), (left, right, "left"))
        ],
        "contrast": _contrast(found.angle_deg, volts[..., left], volts[..., right], dark_V),
    }


def _balance(apart: Passes) -> Estimate:
    """Angle nearest to 0 at which both receivers show one voltage, of each cycle by straight lines, and its mean."""
    rows = apart.volts[..., 0].mean(axis=1)
    return over_cycles(np.array([_crossing(apart.angle_deg, row) for row in rows]))


def _crossing(angle_deg: FloatArray, row: FloatArray) -> float:
    with np.errstate(invalid="ignore"):
        places = np.flatnonzero(row[:-1] * row[1:] <= 0.0)
    found = [
        float(angle_deg[n] + (angle_deg[n + 1] - angle_deg[n]) * row[n] / (row[n] - row[n + 1]))
        for n in places
        if row[n] != row[n + 1]
    ]
    return min(found, key=abs, default=math.nan)


def _crosstalk(
    angle_deg: FloatArray,
    near: FloatArray,
    far: FloatArray,
    toward: str,
    dark_V: float | None,
) -> dict[str, Any]:
    """What the far receiver does while the sensor turns from 0 to the end that brightens the near one.

    ``change_percent`` is the fall of the far voltage in per cent of the fall of the near one: above 0 both brighten,
    below 0 the far one darkens, as it should. ``light_percent`` is the far light at the end in per cent of the near
    one, which needs the voltage without light.
    """
    middle = int(np.argmin(np.abs(angle_deg)))
    end = 0 if toward == "right" else -1  # by the convention
    near_fall, far_fall = near[:, middle] - near[:, end], far[:, middle] - far[:, end]
    fall = over_cycles(near_fall)
    change = over_cycles(100.0 * far_fall / np.where(near_fall == 0.0, np.nan, near_fall))
    known = fall.resolved
    found: dict[str, Any] = {
        "toward": toward,
        "angle_deg": float(angle_deg[end]),
        "change_percent": change.value if known else math.nan,
        "u_change_percent": change.u if known else math.nan,
        "light_percent": math.nan,
        "u_light_percent": math.nan,
    }
    if dark_V is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            light = over_cycles(100.0 * (dark_V - far[:, end]) / (dark_V - near[:, end]))
        found |= {"light_percent": light.value, "u_light_percent": light.u}
    return found


def _contrast(
    angle_deg: FloatArray,
    left: FloatArray,
    right: FloatArray,
    dark_V: float | None,
) -> dict[str, Any] | None:
    """(R − L)/(R + L) of the light at both ends, light being what a voltage is below that without light."""
    if dark_V is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (left - right) / (2.0 * dark_V - left - right)
    found: dict[str, Any] = {"angle_deg": angle_deg, "mean": share.mean(axis=0)}
    for name, end in (("at_low", 0), ("at_high", -1)):
        one = over_cycles(share[:, end])
        found |= {name: one.value, f"u_{name}": one.u}
    return found


def sign_warnings(
    numbers: dict[str, dict[str, Any]], sides: tuple[int, int] | None, receivers: tuple[str, ...]
) -> list[str]:
    """Whether left and right answer as in the convention: a rising angle darkens the right and brightens the left."""
    if sides is None:
        return []
    left, right = (Estimate(numbers[receivers[n]]["swing_V"], numbers[receivers[n]]["u_swing_V"]) for n in sides)
    if not (left.resolved and right.resolved) or min(abs(left.value), abs(right.value)) < _NOTHING_V:
        return []
    told = f"from the lowest to the highest angle {receivers[sides[0]]} changes by {left.value:+.3g} V and "
    told += f"{receivers[sides[1]]} by {right.value:+.3g} V"
    if left.value > 0.0 > right.value:
        return [
            f"{told}: the reverse of the convention (at negative angles the right receiver is brighter, and brighter "
            "is a lower voltage); the angle counts the other way, the receivers are swapped, or the circuit's voltage "
            "rises with light. Nothing was turned round: --flip-angle counts it the other way"
        ]
    if left.value * right.value > 0.0:
        return [f"{told}: both move the same way, so they do not tell one side from the other"]
    return []
