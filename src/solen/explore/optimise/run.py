"""The search for a design.

Public name: `optimise`.
"""

import numpy as np

from solen.explore.optimise.candidates import Candidates, Keep, least
from solen.explore.optimise.evaluation import Evaluator
from solen.explore.optimise.front import Front, front_of, search_front
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
    """Find the numbers of a design that optimise one merit or two.

    Parameters
    ----------
    subject
        The initial design of the search: a sensor, a design, or the path of a design file. If a free number is outside
        its limits, the search starts at the nearer one.
    options
        Goals, free numbers, conditions, deviations.
    store
        Known responses, to which new ones are added; the same search with the same store continues where it stopped.
        Default: a store in memory.
    progress
        Function called with the completed fraction, up to 1.
    keep
        Function called with the best designs so far whenever a further one is added: for one goal, with the best alone,
        the last of which is the result; for two goals, with the designs of which none is better in both.

    Raises
    ------
    SpecError
        If goals, conditions, free numbers or deviations are malformed, or the design has no response.
    """
    store = Store() if store is None else store
    task = Task.of(design_of(subject), options)
    known = len(store.points)
    evaluator, begun = Evaluator.begun(task, store, options.tolerance)
    candidates = Candidates(evaluator, begun.goals, options.evaluations, progress, keep)
    interrupted = False
    try:
        if len(task.goals) > 1:
            search_front(candidates, options.front, options.seed)
        else:
            search(Tried(lambda point: candidates(point).total(ONE), options.evaluations), task.begin, options.seed)
    except KeyboardInterrupt:
        if not candidates.tried:
            raise
        interrupted = True
    candidates.check_feasible()
    if len(task.goals) > 1:
        return front_of(candidates, options.front, known, interrupted=interrupted)
    best = least(candidates.feasible, ONE)
    return optimum_of(candidates, best, known, interrupted=interrupted)
