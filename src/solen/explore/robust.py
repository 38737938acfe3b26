"""Deviations that a design must tolerate: the design without deviations, and with numbers deviating to either side.

Public name: `cases_of`.
"""

from collections.abc import Iterator, Sequence
from itertools import product

from solen.errors import SpecError
from solen.explore.variations import deviation_of
from solen.sensor import Sensor

MAX_NUMBERS = 4


def cases_of(sensor: Sensor, texts: Sequence[str], *, mirrors: bool) -> Iterator[dict[str, float]]:
    """Return the design's cases: no deviation, and all combinations; with ``mirrors``, one of two mirror images.

    Raises
    ------
    SpecError
        If a text is malformed, a number is stated twice, or there are too many numbers.
    """
    deviations = dict(deviation_of(text, sensor, "--robust") for text in texts)
    if len(deviations) < len(texts) or len(deviations) > MAX_NUMBERS:
        limit = f"accepts each parameter once, and at most {MAX_NUMBERS} parameters"
        raise SpecError("--robust", value=f"{len(texts)} numbers", limit=limit, remedy="omit one")
    mirrors = mirrors and sensor.is_symmetric
    yield {}
    for signs in product((1.0, -1.0), repeat=len(deviations)):
        case = {key: sign * size for sign, (key, size) in zip(signs, deviations.items(), strict=True)}
        if case and not (mirrors and case.get("emitter.offset_mm", 1.0) < 0.0):
            yield case
