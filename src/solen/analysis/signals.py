"""What is analysed: receivers' voltages of one sensor over time, with the angle where there is one.

The interface: `Signals`; `side_of` tells a left receiver from a right one by its name; `smoothed` is the only filter,
and runs only where it is asked for.
"""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from solen.arrays import FloatArray

_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_SHORT = re.compile(r"(?:v|u|pd|pt|rx)(l|r|left|right)", re.IGNORECASE)
"""A receiver and its side in one word: VL, PDR, Vleft."""
_SIDES = {"l": "left", "left": "left", "links": "left", "r": "right", "right": "right", "rechts": "right"}


@dataclass(frozen=True)
class Signals:
    """One recording of one sensor.

    Attributes
    ----------
    label
        Name of the sensor; recordings of one name are of one sensor.
    receivers
        Names of the receivers, (m,).
    time_s
        Times that never fall, (n,).
    angle_deg
        (n,).
    volts
        (n, m), NaN where there is no reading.
    lens
        Whether it has a lens, None where nothing says.
    source
        The file.
    clipped
        Samples that whoever recorded them says are clipped, (n, m); None where nobody does.
    """

    label: str
    receivers: tuple[str, ...]
    time_s: FloatArray
    angle_deg: FloatArray
    volts: FloatArray
    lens: bool | None = None
    source: str = ""
    clipped: NDArray[np.bool_] | None = None


def side_of(name: str) -> str:
    """``left`` or ``right`` by the words of a receiver's name (``ReceiverR``, ``V_L``, ``VL``); else empty."""
    words = [_SHORT.sub(r"\1", word) if _SHORT.fullmatch(word) else word for word in _TOKEN.findall(name)]
    found = {_SIDES[word.lower()] for word in words if word.lower() in _SIDES}
    return found.pop() if len(found) == 1 else ""


def pair(receivers: tuple[str, ...]) -> tuple[int, int] | None:
    """Places of the left and the right receiver, where there is exactly one of each."""
    sides = [side_of(name) for name in receivers]
    if sides.count("left") == 1 == sides.count("right"):
        return sides.index("left"), sides.index("right")
    return None


def smoothed(volts: FloatArray, step_s: float, width_ms: float) -> FloatArray:
    """Centred moving mean of each receiver over as many samples as a width holds, an odd number."""
    samples = max(1, round(1e-3 * width_ms / step_s)) | 1
    return np.asarray(uniform_filter1d(volts, samples, axis=0, mode="nearest"))
