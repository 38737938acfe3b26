"""The search itself.

The interface: `optimise` a design.
"""

import numpy as np

from solen.explore.optimise.course import Course, Keep, least
from solen.explore.optimise.front import Front, front_of, sought
from solen.explore.optimise.judge import Judge
from solen.explore.optimise.optimum import Optimum, optimum_of
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.search import Tried, search
from solen.explore.optimise.task import Task
from solen.explore.store import Store
from solen.explore.subject import Subject, design_of
from solen.progress import Progress

ONE = np.ones(1)


def optimise(
    subject: Subject,
    options: OptimiseOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    keep: Keep | None = None,
) -> Optimum | Front:
    """Search for the numbers of a design that make a merit best, or two.

    Parameters
    ----------
    subject
        What the search begins with: a sensor, a design, or the path of a design file. Where a free number lies beyond
        its ends, it begins at the nearer one.
    options
        Goals, free numbers, conditions, deviations.
    store
        What is known already, and where responses are kept as they come; the same search with the same store goes on
        where it stopped. Default: in memory alone.
    progress
        Called with the share done, up to 1.
    keep
        Called with the best designs so far whenever there is a further one: of one goal with the best alone, and the
        last is the result; of two with those of which none is better in both.

    Raises
    ------
    SpecError
        Where goals, conditions, free numbers or deviations are malformed, or the design has no response.
    """
    store = Store() if store is None else store
    task = Task.of(design_of(subject), options)
    known = len(store.points)
    judge, begun = Judge.begun(task, store, options.tolerance)
    course = Course(judge, begun.goals, options.evaluations, progress, keep)
    interrupted = False
    try:
        if len(task.goals) > 1:
            sought(course, options.front, options.seed)
        else:
            search(Tried(lambda point: course(point).total(ONE), options.evaluations), task.begin, options.seed)
    except KeyboardInterrupt:
        if not course.tried:
            raise
        interrupted = True
    course.check_feasible()
    if len(task.goals) > 1:
        return front_of(course, options.front, known, interrupted=interrupted)
    best = least(course.feasible, ONE)
    return optimum_of(course, best, known, interrupted=interrupted)
