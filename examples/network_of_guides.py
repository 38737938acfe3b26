"""A network of guides: the shipped hand with three emitters, switched on in turn, and six receivers, in the plane.

The emitter in the wrist illuminates the middle finger; the emitters in two fingers illuminate the palm, and little of
their light reaches the thumb and the sides.
"""

from solen.sensor.network import NetworkTrace, network_trace
from solen.spec import loads, template, with_values


def main() -> NetworkTrace:
    """Return the power at each receiver from each emitter, as a fraction of the power of that emitter."""
    design = with_values(loads(template("hand-860")), {"trace.dimension": "2d", "emitter.rays": 20_000})
    result = network_trace(design)
    print("emitter " + "".join(f"{name:>11}" for name in result.receivers))
    for name, row in zip(result.emitters, result.power[0], strict=True):
        print(f"{name:8}" + "".join(f"{power:11.4f}" for power in row))
    return result


if __name__ == "__main__":
    main()
