"""Inverse design: numbers of a design that make a merit as good as it can be, within limits and under deviations.

Every candidate is traced as designed and with its deviations: the goal is its worst value among these, and conditions
hold for all of them. A search exploits whatever its tracing leaves open, so its result is traced again, more finely and
by samples.

The interface: `optimise` a design by `OptimiseOptions` returns an `Optimum`.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray, Progress
from solen.errors import SolenError, SpecError
from solen.explore.axes import Axis, axis
from solen.explore.merits import NAMES
from solen.explore.requirement import Goal, Limit
from solen.explore.search import Tried, search
from solen.explore.store import Accuracy, Point, Store, Variant
from solen.explore.sweep import check_angles, merits_of_points, responses
from solen.explore.variations import check_key
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.sensor.numbers import number
from solen.spec import Design, with_values
from solen.spec.strict import Finite, Options

UNMET = 1e3
"""Value of a candidate without a response, in units of the goal of the design that the search begins with."""
PENALTY = 30.0
"""Weight of a limit missed by all of its size, in the same units."""
MOST_BORNE = 4
FINER = 10.0
"""How much more closely the result is traced than the candidates."""
SURE = 2.0
FORMS = "write KEY=LOW:HIGH"


class OptimiseOptions(Options):
    """What is sought, what may change, and what must hold."""

    minimise: str | None = None
    """A value of merits to be made small, as in linearity_percent."""
    maximise: str | None = None
    """A value of merits to be made large, as in span."""
    free: tuple[str, ...] = ()
    """A number of the design and the ends between which it may be, KEY=LOW:HIGH; repeatable."""
    subject_to: tuple[str, ...] = ()
    """A condition on merits that must hold, as in "light >= 0.9*base"; repeatable."""
    robust: tuple[str, ...] = ()
    """A number and how far off it may be, KEY=DEVIATION: the worst value counts and all conditions hold with it off to
    either side, in all combinations; repeatable."""
    evaluations: int = Field(400, ge=20, le=100_000)
    """Number of designs tried."""
    seed: int = Field(0, ge=0)
    """Seed of the search."""
    tolerance: Finite = Field(1e-3, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power while searching, as a share of the emitted power; the result is traced ten times
    as closely."""


class FreeNumber(Result, eq=True):
    """A number that was free.

    Attributes
    ----------
    key
        The number.
    low, high
        Between which values it was free.
    before, after
        Its value in the design, and in the result.
    """

    key: str
    low: float
    high: float
    before: float
    after: float


class Judged(Result):
    """One design by its goal, limits and merits.

    Attributes
    ----------
    goal, u_goal
        Worst value of the goal among the design and its deviations, and its uncertainty by those of the merits.
    meets
        Whether all conditions hold, by condition.
    merits
        Merits of the design as it is, with their uncertainties, by name.
    worst
        Each merit where the goal is worst.
    """

    goal: float
    u_goal: float
    meets: dict[str, bool]
    merits: dict[str, float]
    worst: dict[str, float]


class Optimum(Result):
    """Result of a search.

    Attributes
    ----------
    name
        Name of the design.
    goal
        What was sought.
    free
        The numbers that were free.
    before, after
        The design and the result, both traced finely.
    claimed
        Goal of the result as the search saw it.
    sampled_difference, u_sampled_difference
        Largest difference of the result's contrast between integration and samples over its angles, and the
        uncertainty there.
    evaluations, traced
        Number of designs tried, and of responses traced now; the others were known.
    interrupted
        Whether the search was stopped before its end.
    design
        The result.
    angle_deg, contrast_before, contrast_after
        Responses as designed and where the goal is worst, (2, A).
    history
        Best value so far, by evaluation (E,); NaN before one met all conditions.
    """

    name: str
    goal: str
    free: tuple[FreeNumber, ...]
    before: Judged
    after: Judged
    claimed: float
    sampled_difference: float
    u_sampled_difference: float
    evaluations: int
    traced: int
    interrupted: bool
    warnings: tuple[str, ...]
    design: Design = field(metadata=HIDDEN)
    angle_deg: FloatArray = field(metadata=HIDDEN)
    contrast_before: FloatArray = field(metadata=HIDDEN)
    contrast_after: FloatArray = field(metadata=HIDDEN)
    history: FloatArray = field(metadata=HIDDEN)
    simulated: bool = True


class _Task(NamedTuple):
    """What is asked, checked."""

    goal: Goal
    sign: float
    limits: list[Limit]
    free: list[Axis]
    cases: list[dict[str, float]]


def optimise(
    design: Design,
    options: OptimiseOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    keep: Callable[[Design], object] | None = None,
) -> Optimum:
    """Search for the numbers of a design that make a merit best.

    Parameters
    ----------
    design
        What the search begins with; where a free number lies beyond its ends, at the nearer one.
    options
        Goal, free numbers, conditions, deviations.
    store
        What is known already, and where responses are kept as they come; the same search with the same store goes on
        where it stopped. Default: in memory alone.
    progress
        Called with the share done, up to 1.
    keep
        Called with each better design; the last is the result.

    Raises
    ------
    SpecError
        Where goal, conditions, free numbers or deviations are malformed, or the design has no response.
    """
    store = Store() if store is None else store
    task = _task(design, options)
    known = len(store.points)
    judge = _Judge(task, store, options.tolerance, Sensor.of(design))
    scale = _begun(judge, design)
    history: list[float] = []
    best, best_point = math.inf, np.empty(0)

    def value(point: FloatArray) -> float:
        nonlocal best, best_point
        try:
            candidate = _at(design, task, point)
        except SolenError:
            judged = None
        else:
            judged = judge.of(candidate)
        if judged is None or math.isnan(judged.goal):
            total = UNMET
        else:
            total = task.sign * judged.goal / scale + PENALTY * judge.violation
        if judged is not None and judge.violation == 0.0 and total < best:
            best, best_point = total, point
            if keep is not None:
                keep(candidate)
        history.append(task.sign * best * scale if best < math.inf else math.nan)
        if progress is not None:
            progress(len(history) / options.evaluations)
        return total

    tried = Tried(value, options.evaluations)
    begin = np.array([_share(one, number(judge.sensor, one.key)) for one in task.free])
    interrupted = False
    try:
        search(tried, begin, options.seed)
    except KeyboardInterrupt:
        if not tried.values:
            raise
        interrupted = True
    if not best < math.inf:
        raise SpecError("--subject-to", limit=_nearest(judge, design, task, tried), remedy="loosen it, or free more")
    found = _at(design, task, best_point)
    return _optimum(design, found, task, options, judge, history, interrupted, len(store.points) - known)


def _begun(judge: "_Judge", design: Design) -> float:
    """Size of the goal of the design that the search begins with, whose merits conditions refer to."""
    first = judge.of(design)
    if first is None:
        raise SpecError("design", limit=f"has no response: {judge.why}")
    judge.base = {name: first.merits[name] for name in NAMES}
    begun = judge.of(design)
    goal = judge.task.goal
    if begun is None or math.isnan(begun.goal):
        limit = f"{goal.text} does not exist for the design, or not with a number off"
        raise SpecError(goal.option, limit=limit, remedy="begin with a design that has it")
    return abs(begun.goal) or 1.0


class _Judge:
    """Judges designs by the task; remembers what the last one lacks."""

    def __init__(self, task: _Task, store: Store, tolerance: float, sensor: Sensor) -> None:
        self.task, self.store, self.tolerance, self.sensor = task, store, tolerance, sensor
        self.base: Mapping[str, float] = dict.fromkeys(NAMES, math.nan)
        self.violation, self.why = 0.0, ""

    def of(self, design: Design) -> Judged | None:
        """Judgement of a design; None where it has no response in one of the cases."""
        points = self.points(design)
        self.why = next((point.why for point in points if not point.right.size), "")
        if self.why:
            return None
        return self.judged(merits_of_points(np.array(design.motion.angles_deg()), points))

    def points(self, design: Design) -> list[Point]:
        """Responses of a design in all cases."""
        variants = [partial(Variant, design, case) for case in self.task.cases]
        return responses(variants, Accuracy(self.tolerance), self.store)

    def judged(self, merits: Mapping[str, FloatArray]) -> Judged:
        """Judgement by the merits (C,) of all cases."""
        task = self.task
        values = task.sign * np.broadcast_to(task.goal.value(merits, self.base), len(task.cases))
        missing = np.isnan(values)
        place = int(np.argmax(np.where(missing, np.inf, values)))
        violations = [float(limit.violation(merits, self.base).max()) for limit in task.limits]
        self.violation = sum(violations) + float(missing.any())
        worst = {name: float(column[place]) for name, column in merits.items()}
        return Judged(
            goal=float(task.sign * values[place]),
            u_goal=self._u(merits, place),
            meets={limit.text: not missed for limit, missed in zip(task.limits, violations, strict=True)},
            merits={name: float(column[0]) for name, column in merits.items()},
            worst=worst,
        )

    def _u(self, merits: Mapping[str, FloatArray], place: int) -> float:
        """Uncertainty of the goal in a case: changes by that of each merit that it names, added."""
        at = {name: column[place : place + 1] for name, column in merits.items()}
        value = self.task.goal.value(at, self.base)
        off = [
            self.task.goal.value({**at, name: at[name] + at[f"u_{name}"]}, self.base) - value
            for name in self.task.goal.merits
        ]
        return float(np.sum(np.abs(off)))


def _optimum(
    design: Design,
    found: Design,
    task: _Task,
    options: OptimiseOptions,
    judge: _Judge,
    history: Sequence[float],
    interrupted: bool,
    traced: int,
) -> Optimum:
    """The result, traced again: with angles twice as dense, ten times as closely, and by samples."""
    claimed = judge.of(found)
    assert claimed is not None  # noqa: S101  the search kept it
    fine = _Judge(task, judge.store, options.tolerance / FINER, judge.sensor)
    dense = [_denser(one) for one in (design, found)]
    fine.base = judge.base
    judged = [fine.of(one) for one in dense]
    before, after = judged
    if before is None or after is None:
        raise SpecError("result", limit=f"has no response where it is traced more closely: {fine.why}")
    angle_deg = np.array(dense[0].motion.angles_deg())
    curves = [_curves(fine, one, task, angle_deg) for one in dense]
    difference, u_difference = _by_samples(Sensor.of(found))
    return Optimum(
        name=design.name,
        goal=f"{'maximise' if task.sign < 0.0 else 'minimise'} {task.goal.text}",
        free=tuple(
            FreeNumber(one.key, low, high, number(judge.sensor, one.key), number(Sensor.of(found), one.key))
            for one in task.free
            for low, high in [one.values]
        ),
        before=before,
        after=after,
        claimed=claimed.goal,
        sampled_difference=difference,
        u_sampled_difference=u_difference,
        evaluations=len(history),
        traced=traced,
        interrupted=interrupted,
        warnings=tuple(_warnings(before, after, claimed, difference, u_difference, interrupted, task)),
        design=found,
        angle_deg=angle_deg,
        contrast_before=curves[0],
        contrast_after=curves[1],
        history=np.array(history),
    )


def _warnings(
    before: Judged,
    after: Judged,
    claimed: Judged,
    difference: float,
    u_difference: float,
    interrupted: bool,
    task: _Task,
) -> Iterator[str]:
    off = abs(after.goal - claimed.goal)
    if off > SURE * math.hypot(after.u_goal, claimed.u_goal):
        yield (
            f"the search saw {claimed.goal:.4g}, and finer tracing gives {after.goal:.4g}: it exploited the roughness "
            "of its tracing; lower --tolerance"
        )
    if difference > SURE * u_difference:
        times = difference / u_difference
        yield f"samples differ from the integral by {difference:.2g} of contrast, {times:.1f} times the uncertainty"
    for text, met in after.meets.items():
        if not met:
            yield f"traced more closely, the result misses {text}"
    if task.sign * after.goal > task.sign * before.goal and all(before.meets.values()):
        yield "traced more closely, the result is no better than the design"
    if interrupted:
        yield "interrupted: the best design so far; the same command goes on from here"


def _denser(design: Design) -> Design:
    return design.set({"motion.step_deg": design.motion.step_deg / 2.0})


def _curves(judge: _Judge, design: Design, task: _Task, angle_deg: FloatArray) -> FloatArray:
    """Contrast of a design as it is, and in the case where its goal is worst."""
    points = judge.points(design)
    values = task.sign * task.goal.value(merits_of_points(angle_deg, points), judge.base)
    chosen = (points[0], points[int(np.argmax(np.nan_to_num(values, nan=np.inf)))])
    return np.array([(point.right - point.left) / (point.right + point.left) for point in chosen])


def _by_samples(sensor: Sensor) -> tuple[float, float]:
    """Largest difference in contrast between integration and samples at some angles, and the uncertainty there."""
    motion = sensor.design.motion
    angles = np.linspace(motion.from_deg, motion.to_deg, 5)
    integrated = sensor.power(angles.tolist())
    differences, u = [], []
    for place, angle in enumerate(angles.tolist()):
        sampled, u_sampled = sensor.sampled(angle)
        right, left = (sampled.detectors[side].power for side in ("right", "left"))
        differences.append(abs((right - left) / (right + left) - float(integrated.contrast[place])))
        u.append(math.hypot(2.0 * u_sampled / (right + left), float(integrated.u_contrast[place])))
    worst = int(np.argmax(np.array(differences) / np.array(u)))
    return differences[worst], u[worst]


def _nearest(judge: _Judge, design: Design, task: _Task, tried: Tried) -> str:
    """Which conditions the candidate nearest to meeting them misses."""
    judged = judge.of(_at(design, task, tried.best))
    missed = [text for text, met in judged.meets.items() if not met] if judged is not None else []
    return f"no design tried meets every condition; the nearest misses {', '.join(missed) or 'a response'}"


def _at(design: Design, task: _Task, point: FloatArray) -> Design:
    """Design at a point of the box; `SpecError` where it is not valid."""
    return with_values(design, {one.key: one.at(float(share)) for one, share in zip(task.free, point, strict=True)})


def _share(one: Axis, value: float) -> float:
    low, high = one.values
    return float(min(max((value - low) / (high - low), 0.0), 1.0))


def _task(design: Design, options: OptimiseOptions) -> _Task:
    if (options.minimise is None) == (options.maximise is None):
        raise SpecError(
            "--minimise, --maximise", limit="state one of them", remedy="as in --minimise linearity_percent"
        )
    check_angles(design)
    free = [axis(text, design, "--free") for text in options.free]
    if not free:
        raise SpecError("--free", limit="nothing may change", remedy=FORMS)
    sensor = Sensor.of(design)
    for one in free:
        if one.kind != "range":
            raise SpecError(f"--free {one.key}", limit="is not a range", remedy=FORMS)
        check_key(sensor, one.key, "--free")
    keys = [one.key for one in free]
    twice = next((key for key in keys if keys.count(key) > 1), None)
    if twice:
        raise SpecError(f"--free {twice}", limit="is stated twice", remedy="leave one out")
    goal = Goal.parse(options.maximise or options.minimise or "")
    limits = [Limit.parse(text) for text in options.subject_to]
    motion, named = design.motion, {name for one in (goal, *limits) for name in one.merits}
    mirrors = motion.from_deg == -motion.to_deg and "null_deg" not in named and "emitter.offset_mm" not in keys
    return _Task(goal, -1.0 if options.maximise else 1.0, limits, free, list(_cases(sensor, options.robust, mirrors)))


def _cases(sensor: Sensor, robust: Sequence[str], mirrors: bool) -> Iterator[dict[str, float]]:
    """The design as it is, and all combinations of its deviations; with ``mirrors`` one of two mirror images."""
    deviations = dict(_deviation(text, sensor) for text in robust)
    if len(deviations) < len(robust) or len(deviations) > MOST_BORNE:
        limit = f"takes each number once, and {MOST_BORNE} at most"
        raise SpecError("--robust", value=f"{len(robust)} numbers", limit=limit, remedy="leave one out")
    yield {}
    for signs in product((1.0, -1.0), repeat=len(deviations)):
        case = {key: sign * size for sign, (key, size) in zip(signs, deviations.items(), strict=True)}
        mirrored = mirrors and case.get("emitter.offset_mm", 1.0) < 0.0 and sensor.is_symmetric
        if case and not mirrored:
            yield case


def _deviation(text: str, sensor: Sensor) -> tuple[str, float]:
    key, _, size = (part.strip() for part in text.partition("="))
    try:
        deviation = float(size)
    except ValueError:
        deviation = math.nan
    if not 0.0 < deviation < math.inf:
        limit, remedy = "must be a number greater than 0", "write KEY=DEVIATION, as in emitter.offset_mm=0.03"
        raise SpecError(f"--robust {key}", value=size, limit=limit, remedy=remedy)
    check_key(sensor, key, "--robust", material=True)
    return key, deviation
