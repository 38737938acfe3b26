"""A tolerance run: the yield of 128 simulated prints whose emitters are glued slightly off the axis.

A print passes if its null is within 0.2° of zero. The lens magnifies the decentre of the emitter, so a few micrometres
matter; the variation of the index of the resin has almost no effect.
"""

from solen.explore import ToleranceOptions, Tolerances, tolerance
from solen.sensor import Sensor
from solen.spec import loads, template

SD_MM, LIMIT_DEG = 0.004, 0.2
VARIED = (f"emitter.offset_mm=normal:0:{SD_MM}", "material.index=normal:0:0.002")


def main() -> Tolerances:
    """Return the results of the prints, with their yield and their nulls."""
    options = ToleranceOptions(vary=VARIED, require=(f"abs(null_deg) < {LIMIT_DEG}",), prints=128, rays=1024)
    result = tolerance(Sensor.of(loads(template("paper-860"))), options)
    nulls = result.to_dataset()["null_deg"]
    print(f"null within ±{LIMIT_DEG}°: {100 * result.yields[-1].share:.0f} % of the prints")
    print(f"null: mean {float(nulls.mean()):+.3f}°, standard deviation {float(nulls.std()):.3f}°")
    return result


if __name__ == "__main__":
    main()
