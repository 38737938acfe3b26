"""A sensor with the lens that a process prints in place of the designed one.

The print is that of `solen print predict` at half the thickness: flat, with its vertex on a corner of pixels, without
compensation, and with the best estimates of the process parameters. Only the lens is replaced.

Public names: `as_printed` and `check_printable`.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

from solen.errors import SpecError
from solen.fabricate.process import Deviation, Printing, Settings, Target, as_designed, lens_face, rings_of
from solen.fabricate.process.predict import FLAT_POINTS
from solen.fabricate.process.printed_design import profile_of_print
from solen.geometry import Body
from solen.lens import DesignedLens, MeasuredLens
from solen.lens.build import measured_lens
from solen.sensor import Sensor


def as_printed(sensor: Sensor, settings: Settings) -> Sensor:
    """Return the sensor with its lens as printed.

    Raises
    ------
    SpecError
        If the lens is not printed as one profile.
    DataError
        If the process cannot print it.
    """
    lens = check_printable(sensor)
    return replace(sensor, cut=_printed(_Drawing(lens, sensor.body(), sensor.design.body.thickness_mm, settings)))


def check_printable(sensor: Sensor) -> DesignedLens:
    """Return the lens of a sensor; raise `SpecError` if it is not designed as one profile."""
    if isinstance(sensor.cut, DesignedLens) and not sensor.is_sampled:
        return sensor.cut
    limit = "only an oval or a free form can be printed as one profile"
    shape = "the lenses of a network" if sensor.is_network else sensor.design.lens.shape
    raise SpecError("--as-printed", value=shape, limit=limit, remedy="omit --as-printed")


@dataclass(frozen=True)
class _Drawing:
    """Cache key of a print: equal if the outlines and the process are equal."""

    lens: DesignedLens
    body: Body = field(compare=False)
    thickness_mm: float
    settings: Settings = field(compare=False)
    digest: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "digest", hashlib.sha256(b"".join(self._inputs())).hexdigest())

    def _inputs(self) -> Iterator[bytes]:
        yield self.settings.model_dump_json().encode()
        yield from (ring.tobytes() for ring in rings_of(as_designed(self.body)))


@lru_cache(maxsize=32)
def _printed(drawing: _Drawing) -> MeasuredLens:
    """Return the lens of a print, cached for all deviations that do not change the drawing."""
    body, settings = drawing.body, drawing.settings
    target = Target.of(lens_face(body).curve, FLAT_POINTS)
    thickness_mm = drawing.thickness_mm
    printing = Printing(body, target, settings, thickness_mm, settings.middle_um(thickness_mm))
    deviation = Deviation(target, printing.deviation_um(as_designed(body)))
    return measured_lens(drawing.lens, profile_of_print(deviation, "design", "as printed", 0.0))
