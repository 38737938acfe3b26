"""A tolerance run: how many of 128 prints meet the limit if the emitter of each is glued slightly off its position.

A print is good if it balances within 0.2° of zero. The lens magnifies a decentre of the emitter, so a few micrometres
are decisive; variation of the resin's index adds almost nothing.
"""

from solen.explore import ToleranceOptions, Tolerances, tolerance
from solen.sensor import Sensor
from solen.spec import loads, template

SD_MM, LIMIT_DEG = 0.004, 0.2
VARIED = (f"emitter.offset_mm=normal:0:{SD_MM}", "material.index=normal:0:0.002")


def main() -> Tolerances:
    """Return the yield of the prints, and the statistics of their balance points."""
    options = ToleranceOptions(vary=VARIED, require=(f"abs(null_deg) < {LIMIT_DEG}",), prints=128, rays=1024)
    found = tolerance(Sensor.of(loads(template("paper-860"))), options)
    nulls = found.to_dataset()["null_deg"]
    print(f"{100 * found.yields[-1].share:.0f} % of the prints balance within ±{LIMIT_DEG}°")
    print(f"balance {float(nulls.mean()):+.3f}° on average, {float(nulls.std()):.3f}° from print to print")
    return found


if __name__ == "__main__":
    main()
