"""Responses of one sensor with several lenses: contrast at a few angles, and light, each with its standard error.

All are sampled in the same way, so that a cylinder and a lens for space are comparable.

Public name: `lens_responses`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from solen.arrays import FloatArray
from solen.progress import Progress, tracked
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor

ANGLES_DEG = (0.5, 1.0, 3.0)
"""Angles of the comparison."""
TOLERANCE = 5e-4
"""Required standard error of the sampled power."""


@dataclass(frozen=True, eq=False)
class LensResponse:
    """Response of a sensor with one lens.

    Attributes
    ----------
    name
        Name of the lens.
    angle_deg, contrast, u_contrast
        Angles (N,), contrast there, and its standard error; NaN without light.
    light, u_light
        Fraction of the emitted power at both receivers, averaged over the angles, and an upper limit of its standard
        error: errors of both receivers and of all angles, which share a seed, are added linearly.
    """

    name: str
    angle_deg: FloatArray
    contrast: FloatArray
    u_contrast: FloatArray
    light: float
    u_light: float

    @classmethod
    def of(cls, name: str, sensor: Sensor, angles_deg: Sequence[float]) -> "LensResponse":
        """Return the response of a sensor; positive angles increase the power at the right receiver."""
        read = Response.of("power", angles_deg, [sensor.sampled(-angle, TOLERANCE) for angle in angles_deg])
        u_light = 2.0 * float(read.u_power.max())
        return cls(name, read.angle_deg, read.contrast, read.u_contrast, read.received_share, u_light)


def lens_responses(
    sensors: Mapping[str, Sensor], angles_deg: Sequence[float] = ANGLES_DEG, progress: Progress | None = None
) -> tuple[LensResponse, ...]:
    """Return responses of sensors by the names of their lenses; raise `DesignError` without two receivers."""
    made = []
    for name, sensor in tracked(sensors.items(), progress):
        sensor.check_pair()
        made.append(LensResponse.of(name, sensor, angles_deg))
    return tuple(made)
