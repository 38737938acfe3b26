"""Deviations that a design must tolerate: parameters deviate to either side of their nominal values.

Public name: `cases_of`.
"""

from collections.abc import Iterator, Sequence
from itertools import product

from solen.errors import SpecError
from solen.explore.variations import parse_deviation
from solen.sensor import Sensor

MAX_PARAMETERS = 4


def cases_of(sensor: Sensor, texts: Sequence[str], *, mirrors: bool) -> Iterator[dict[str, float]]:
    """Yield the deviations of each case: first none, then all combinations; ``mirrors`` omits mirror images.

    Raises
    ------
    SpecError
        If a text is malformed, a parameter is specified twice, or there are too many parameters.
    """
    deviations = dict(parse_deviation(text, sensor, "--robust") for text in texts)
    if len(deviations) < len(texts):
        limit = "contains a parameter twice"
        raise SpecError("--robust", value=", ".join(texts), limit=limit, remedy="omit one of its two deviations")
    if len(deviations) > MAX_PARAMETERS:
        limit = f"must have at most {MAX_PARAMETERS} parameters"
        raise SpecError("--robust", value=f"{len(texts)} parameters", limit=limit, remedy="omit the least important")
    mirrors = mirrors and sensor.is_symmetric
    yield {}
    for signs in product((1.0, -1.0), repeat=len(deviations)):
        case = {key: sign * size for sign, (key, size) in zip(signs, deviations.items(), strict=True)}
        if case and not (mirrors and case.get("emitter.offset_mm", 1.0) < 0.0):
            yield case
