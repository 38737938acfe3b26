"""A design over the angles of its motion: counted and in power, with its lens and without, and beside neighbours."""

from dataclasses import dataclass, replace

from solen.arrays import Progress
from solen.errors import DesignError
from solen.sensor.practice import Practice, practice
from solen.sensor.printed import Printed, printed
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.spec import Design


@dataclass(frozen=True)
class Case:
    """A sensor's response twice over: by counting the design's rays, and in power, integrated.

    ``null_deg`` is the balance point nearest to 0, from the power; ``slope_per_deg`` the contrast's slope there.
    """

    sensor: Sensor
    counted: Response
    power: Response
    null_deg: float | None
    slope_per_deg: float | None


@dataclass(frozen=True)
class Study:
    """A design over the angles of its motion, with its lens and without.

    ``lens`` is None for a design without one. ``flat`` is None where the sensor with a lens cannot be built without it;
    ``flat_refused`` then says why. ``practice`` compares the design with its neighbours, where that was asked for.
    ``designed`` is the case of the lens that was asked for, and ``printed`` what lies between, where the design's own
    lens was measured.
    """

    design: Design
    lens: Case | None
    flat: Case | None
    flat_refused: str | None = None
    practice: Practice | None = None
    designed: Case | None = None
    printed: Printed | None = None

    @property
    def case(self) -> Case:
        """The design's own case."""
        case = self.lens or self.flat
        if case is None:
            raise AssertionError("a study has at least one case")
        return case

    @property
    def cases(self) -> dict[str, Case]:
        """Cases by name: ``lens``, ``designed``, ``no_lens``."""
        all_of_them = {"lens": self.lens, "designed": self.designed, "no_lens": self.flat}
        return {name: case for name, case in all_of_them.items() if case is not None}


def study(design: Design, progress: Progress | None = None, *, practical: bool = False) -> Study:
    """Trace a design over its motion, with its lens and without, counting and in power.

    Every body of the motion is built before the first ray is traced, so that a motion which breaks the body is refused
    at once. ``progress`` is called with the share done, up to 1. ``practical`` adds the comparison of
    `solen.sensor.practice`, and of a measured lens with the one that was designed.
    """
    if not practical:
        return _study(design, progress)
    parts = 7 if design.lens.shape == "measured" else 5
    found = _beside_design(_study(design, _part(progress, 0, parts, 3)), _part(progress, 3, parts, 2))
    case, beside = found.case, found.printed
    chip = None if beside is None or beside.chip is None else beside.chip.printed
    told = _part(progress, parts - 2, parts, 2)
    return replace(found, practice=practice(case.sensor, case.power, told, chip=chip))


def _beside_design(found: Study, progress: Progress | None) -> Study:
    """The same with the lens that was asked for, where the design's own was measured."""
    lens = found.lens
    if lens is None or not lens.sensor.is_measured:
        return found
    lens.sensor.as_designed.check()
    designed = _case(lens.sensor.as_designed, None)
    return replace(found, designed=designed, printed=printed(lens.sensor, lens.power, designed.power, progress))


def _study(design: Design, progress: Progress | None) -> Study:
    sensor = Sensor.of(design)
    sensor.check_pair()
    sensor.check()
    if not sensor.has_lens:
        return Study(design, None, _case(sensor, progress))
    flat, refused = _comparison(sensor)
    if flat is None:
        return Study(design, _case(sensor, progress), None, refused)
    return Study(design, _case(sensor, _part(progress, 0, 2)), _case(flat, _part(progress, 1, 2)))


def _comparison(sensor: Sensor) -> tuple[Sensor | None, str | None]:
    """The sensor without its lens, or why it cannot be built."""
    if sensor.is_drawn:
        return None, "the body is drawn, and has no version without its lens"
    try:
        sensor.without_lens.check()
    except DesignError as bad:
        return None, str(bad)
    return sensor.without_lens, None


def _case(sensor: Sensor, progress: Progress | None) -> Case:
    counted = sensor.count(progress=_part(progress, 0, 10))
    power = sensor.power(progress=_part(progress, 1, 10, 8))
    null = power.null_deg()
    slope = None if null is None else sensor.slope_per_deg(null)
    if progress is not None:
        progress(1.0)
    return Case(sensor, counted, power, null, slope)


def _part(progress: Progress | None, first: int, parts: int, length: int = 1) -> Progress | None:
    """Progress of ``length`` of so many equal parts, told as the share of the whole."""
    return None if progress is None else lambda done: progress((first + length * done) / parts)
