"""The response of a lens as printed, here simulated with an RMS deviation of 20 µm from its design.

The profile is like one measured in a micrograph: points 4 µm apart, each with an uncertainty of 0.5 µm. It is smoothed
accordingly, traced, and compared with the designed lens. Outlines sampled at random within this uncertainty give the
uncertainty of the response.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from solen.lens import MeasuredLens, OvalLens, measured_lens, profile_of
from solen.sensor import Comparison, Sensor, as_printed
from solen.spec import loads, template, with_values

RMS_UM, NOISE_UM = 20.0, 0.5
ANGLES_DEG = (-1.0, 0.0, 1.0)


class Result(NamedTuple):
    """The printed lens, and the comparison of its response with that of the designed lens."""

    lens: MeasuredLens
    response: Comparison


def printed_lens(oval: OvalLens) -> MeasuredLens:
    """Return a lens whose surface has a ripple of `RMS_UM`, measured as points with noise."""
    x = np.linspace(-oval.half_width_mm, oval.half_width_mm, 1001)
    arc_per_x = np.hypot(1.0, oval.slope(x))
    ripple = np.sin(2.5 * x + 0.4)
    deviation_um = RMS_UM * ripple / np.sqrt(np.average(ripple**2, weights=arc_per_x))
    deviation_um += np.random.default_rng(3).normal(0.0, NOISE_UM, x.size)
    profile = profile_of(x, oval.z_mm(x) - 1e-3 * deviation_um * arc_per_x, 1e-3 * NOISE_UM, simulated=True)
    return measured_lens(oval, profile)


def main() -> Result:
    """Compare focus and contrast of the printed lens with those of the designed lens, with a chip 0.2 mm wide."""
    sensor = Sensor.of(with_values(loads(template("paper-860")), {"emitter.width_mm": 0.2}))
    if not isinstance(sensor.lens, OvalLens):
        raise TypeError("the lens of this design is not an oval")
    lens, index = printed_lens(sensor.lens), sensor.material.index
    sensor = replace(sensor, cut=lens)
    response = as_printed(sensor, sensor.power(ANGLES_DEG), draws=4).emitter
    print(f"RMS deviation of the lens from its design: {lens.fit.deviation.rms_um:.1f} µm")
    focus, u_focus = lens.best_focus_mm(index), lens.u_best_focus_mm(index)
    print(f"smallest spot at {focus:.2f} ± {u_focus:.2f} mm, designed {lens.designed.best_focus_mm(index):.2f} mm")
    for i, angle in enumerate(ANGLES_DEG):
        designed, printed = response.designed.contrast[i] + 0.0, response.printed.contrast[i]
        u = response.u_difference[i]
        print(f"  {angle:+.0f}°: contrast {designed:+.3f} designed, {printed:+.3f} ± {u:.3f} printed")
    print(f"null shifted by {response.null_shift_deg:+.2f} ± {response.u_null_shift_deg:.2f}°")
    return Result(lens, response)


if __name__ == "__main__":
    main()
