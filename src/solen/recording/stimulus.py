"""The stimulus of a recorded sensor: an angle, a force or a depth.

Analysis, calibration and decoding are the same for all three. Arrays and fields are named after the angle
(``angle_deg``), as receiver fields are named after volts, but contain the stimulus in its actual unit. Sentences, axes
and the keys of JSON and files use that unit: ``sensitivity_V_per_N``, ``interval95_force_N``.

Public names: `Stimulus`, `ANGLE`, `FORCE`, `DEPTH` and `STIMULI`.
"""

import re
from dataclasses import dataclass
from typing import Any, Literal

from solen.results import in_unit, rekeyed

Name = Literal["angle", "force", "depth"]
NEAR_ZERO_DEG = 0.5
"""Range of angles about 0 over which the sensitivity near zero is determined."""
_NEAR_ZERO = 1.0 / 6.0  # fraction of the reach: 0.5° of the 3° of a rotation


@dataclass(frozen=True)
class Stimulus:
    """The quantity that acts on a sensor.

    Attributes
    ----------
    name, plural
        Name of the quantity in sentences.
    unit
        Unit of the values, also used in keys.
    sign
        Unit symbol after a number.
    """

    name: Name
    plural: str
    unit: str
    sign: str

    @property
    def label(self) -> str:
        """Axis label."""
        return f"{self.name} ({self.sign.strip()})"

    @property
    def known_label(self) -> str:
        """Label of the reference axis; a force is known only from the load cell reading."""
        return f"force, {self.known} (N)" if self.name == "force" else f"true {self.label}"

    @property
    def known(self) -> str:
        """Description of the reference values."""
        return "the load cell reading" if self.name == "force" else "true"

    @property
    def column(self) -> str:
        """Name of the option that selects the column; ``load`` for a force, as ``--force`` has another meaning."""
        return "load" if self.name == "force" else self.name

    def near_zero(self, reach: float) -> float:
        """Return the range about 0 for the sensitivity near zero, from the reach of the motion."""
        return NEAR_ZERO_DEG if self.unit == "deg" else float(f"{_NEAR_ZERO * reach:.2g}")

    def keyed(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return plain data whose keys name this quantity instead of the angle."""
        return self._rekeyed(data, ANGLE, self)

    def unkeyed(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return plain data of a file with keys that name the angle."""
        return self._rekeyed(data, self, ANGLE)

    @staticmethod
    def _rekeyed(data: dict[str, Any], before: "Stimulus", after: "Stimulus") -> dict[str, Any]:
        if before == after:
            return data
        data = in_unit(data, after.unit, before.unit)
        for old, new in ((before.plural, after.plural), (before.name, after.name)):
            data = rekeyed(data, re.compile(rf"(?:(?<=_)|^){old}(?=_|$)"), new)
        return data


ANGLE = Stimulus("angle", "angles", "deg", "°")
FORCE = Stimulus("force", "forces", "N", " N")
DEPTH = Stimulus("depth", "depths", "mm", " mm")
STIMULI: dict[str, Stimulus] = {stimulus.name: stimulus for stimulus in (ANGLE, FORCE, DEPTH)}
