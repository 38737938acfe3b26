"""Prints of the initial design of a search and of its result, with the same tolerances.

Public names: `check_prints` and `with_prints`.
"""

from dataclasses import replace

from solen.errors import SolenError, SpecError
from solen.explore.default_variations import variations_of
from solen.explore.measures import measure_of
from solen.explore.optimise.optimum import INTERRUPTED, Optimum
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.task import Task
from solen.explore.requirement import Requirement
from solen.explore.store import Store
from solen.explore.subject import Subject, design_of
from solen.explore.tolerance import ToleranceOptions, Tolerances, tolerance
from solen.progress import Progress, part_of
from solen.sensor import Sensor

MIN_PRINTS = 32
PRINT_OPTIONS = ("prints", "vary", "require")


def check_prints(subject: Subject, options: OptimiseOptions) -> bool:
    """Return whether prints are to be traced after a search.

    Raises
    ------
    SpecError
        If a variation or a requirement is malformed, or would be ignored.
    """
    specified = next((name for name in PRINT_OPTIONS if name in options.model_fields_set), None)
    if len(options.minimise) + len(options.maximise) > 1:
        if specified is not None:
            limit = "applies to the prints of a single result, but a front has several results"
            remedy = "omit the option, and run solen explore tolerance on a design of the front"
            raise SpecError(f"--{specified}", limit=limit, remedy=remedy)
        return False
    if not options.prints and (options.vary or options.require):
        limit = "contradicts --vary and --require, which apply to prints"
        raise SpecError("--prints", value=0, limit=limit, remedy="omit --prints 0")
    if 0 < options.prints < MIN_PRINTS:
        limit, remedy = f"must be 0 or at least {MIN_PRINTS}", "increase --prints, or use 0"
        raise SpecError("--prints", value=options.prints, limit=limit, remedy=remedy)
    if options.prints:
        tolerance_options = _tolerance_options(options)
        design = design_of(subject)
        variations_of(
            Sensor.of(design),
            tolerance_options.vary,
            tolerance_options.process,
            compensated=tolerance_options.compensated,
        )
        for text in tolerance_options.require:
            Requirement.parse(text, measure_of(design).names)
    return bool(options.prints)


def with_prints(
    optimum: Optimum,
    subject: Subject,
    options: OptimiseOptions,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Optimum:
    """Return the result of a search with prints of it and of the initial design, if they are requested.

    If the tracing is interrupted with Ctrl-C or fails, the result has no prints but a warning.
    """
    design = design_of(subject)
    if optimum.interrupted or not check_prints(design, options):
        return optimum
    store, tolerance_options = Store() if store is None else store, _tolerance_options(options)
    process = Task.of(design, options).process if options.as_printed else None
    settings = None if process is None else process.process
    known, traced = len(store.points), []
    try:
        for number, printed in enumerate((design, optimum.design)):
            part = part_of(progress, number, 2)
            traced.append(tolerance(printed, tolerance_options, store, part, printed_by=settings))
    except KeyboardInterrupt:
        return replace(optimum, interrupted=True, warnings=(*optimum.warnings, INTERRUPTED))
    except SolenError as error:
        return replace(optimum, warnings=(*optimum.warnings, f"prints are not compared: {error}"))
    before, after = traced
    return replace(
        optimum,
        prints_before=before,
        prints_after=after,
        traced=optimum.traced + len(store.points) - known,
        warnings=(*optimum.warnings, *_warnings("the design", before), *_warnings("the result", after)),
    )


def _tolerance_options(options: OptimiseOptions) -> ToleranceOptions:
    """Return the options for tracing the prints; mean growth and shrinkage are 0, as in the search."""
    return ToleranceOptions(
        vary=options.vary,
        require=options.require,
        prints=options.prints,
        seed=options.seed,
        tolerance=options.tolerance,
        process=options.process,
        compensated=options.process is not None,
    )


def _warnings(what: str, prints: Tolerances) -> list[str]:
    return [f"prints of {what}: {text}" for text in prints.warnings]
