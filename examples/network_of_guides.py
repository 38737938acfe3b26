"""A network of guides: the shipped hand with three emitters, lit in turn, and six receivers, in the plane.

The wrist illuminates the middle finger; two fingers illuminate the palm, and little of their light strays into the
thumb and the sides.
"""

from solen.sensor.network import NetworkTrace, network_trace
from solen.spec import loads, template, with_values


def main() -> NetworkTrace:
    """Return the power at each receiver by emitter, as a fraction of that emitter's power."""
    design = with_values(loads(template("hand-860")), {"trace.dimension": "2d", "emitter.rays": 20_000})
    found = network_trace(design)
    print("emitter " + "".join(f"{name:>11}" for name in found.receivers))
    for name, row in zip(found.emitters, found.power[0], strict=True):
        print(f"{name:8}" + "".join(f"{power:11.4f}" for power in row))
    return found


if __name__ == "__main__":
    main()
