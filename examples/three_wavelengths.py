"""The three shipped designs, for 860, 500 and 450 nm: the effect of the index on the lens and its acceptance.

A lens with a higher index is flatter, and so accepts a larger part of the cone of the emitter. The received power
includes reflection losses; apart from light that leaves the body and enters it again, it does not depend on the angle.
"""

from typing import NamedTuple

from solen.sensor import Sensor
from solen.spec import loads, template


class Row(NamedTuple):
    """Results for one design."""

    refractive_index: float
    depth_mm: float
    acceptance_deg: float
    received: float


def main() -> list[Row]:
    """Return a row for each wavelength, in descending order."""
    rows = []
    print("wavelength   index   depth    accepts   received at rest")
    for name in ("paper-860", "paper-500", "paper-450"):
        sensor = Sensor.of(loads(template(name)))
        received = sensor.integrate(0.0).ledger.detected
        row = Row(sensor.material.index, sensor.lens.depth_mm, sensor.lens.acceptance_deg, received)
        rows.append(row)
        wavelength_nm = sensor.design.emitter.wavelength_nm
        print(f"{wavelength_nm:7.0f} nm   {row.refractive_index:.3f}   {row.depth_mm:.3f} mm", end="")
        print(f"  ±{row.acceptance_deg:.2f}°   {received:.4f} of the emitted power")
    return rows


if __name__ == "__main__":
    main()
