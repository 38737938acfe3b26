"""Responses of one sensor with several lenses: contrast and light at a few angles, with their standard errors.

All responses are sampled in the same way, so that a cylinder and a lens for skew rays are comparable.

Public names: `lens_responses` and `LensResponse`.
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
        Angles (N,), the contrast there and its standard error; NaN without light.
    light, u_light
        Fraction of the emitted power at both receivers, averaged over the angles, and an upper limit of its standard
        error: the errors of both receivers and of all angles, which share a seed, are added linearly.
    """

    name: str
    angle_deg: FloatArray
    contrast: FloatArray
    u_contrast: FloatArray
    light: float
    u_light: float

    @classmethod
    def of(cls, name: str, sensor: Sensor, angles_deg: Sequence[float]) -> "LensResponse":
        """Return the response of a sensor; the sign of the angles is such that positive ones brighten the right."""
        response = Response.of("power", angles_deg, [sensor.sampled(-angle, TOLERANCE) for angle in angles_deg])
        u_light = 2.0 * float(response.u_power.max())
        return cls(name, response.angle_deg, response.contrast, response.u_contrast, response.received_share, u_light)


def lens_responses(
    sensors: Mapping[str, Sensor], angles_deg: Sequence[float] = ANGLES_DEG, progress: Progress | None = None
) -> tuple[LensResponse, ...]:
    """Return the responses of sensors keyed by the names of their lenses; raise `DesignError` without two receivers."""
    responses = []
    for name, sensor in tracked(sensors.items(), progress):
        sensor.check_pair()
        responses.append(LensResponse.of(name, sensor, angles_deg))
    return tuple(responses)
