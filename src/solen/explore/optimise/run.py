"""The search for a design.

Public name: `optimise`.
"""

import numpy as np

from solen.explore.optimise.candidates import Candidates, Keep, best_candidate
from solen.explore.optimise.evaluation import Evaluator
from solen.explore.optimise.front import Front, front_of, search_front
from solen.explore.optimise.optimum import Optimum, optimum_of
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.search import Trials, search
from solen.explore.optimise.task import Task
from solen.explore.store import Store
from solen.explore.subject import Subject, design_of
from solen.progress import Progress

SINGLE_WEIGHT = np.ones(1)


def optimise(
    subject: Subject,
    options: OptimiseOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    keep: Keep | None = None,
) -> Optimum | Front:
    """Find the parameters of a design that optimise one or two figures of merit.

    Parameters
    ----------
    subject
        The initial design of the search: a sensor, a design, or the path of a design file. If a free parameter is
        outside its limits, the search starts at the nearer limit.
    options
        Goals, free parameters, conditions and deviations.
    store
        Known responses, to which new ones are added; the same search with the same store continues where it stopped.
        Default: a store in memory.
    progress
        Function called with the completed fraction, up to 1.
    keep
        Function called whenever a candidate improves on the previous ones: for one goal, with the best design so far,
        for two goals, with all nondominated designs so far.

    Raises
    ------
    SpecError
        If goals, conditions, free parameters or deviations are malformed, the design has no response, or no design
        meets every condition.
    """
    store = Store() if store is None else store
    task = Task.of(design_of(subject), options)
    known = len(store.points)
    evaluator, initial = Evaluator.of_task(task, store, options.tolerance)
    candidates = Candidates(evaluator, initial.goals, options.evaluations, progress, keep)
    interrupted = False
    try:
        if len(task.goals) > 1:
            search_front(candidates, options.front, options.seed)
        else:
            trials = Trials(lambda point: candidates(point).objective(SINGLE_WEIGHT), options.evaluations)
            search(trials, task.initial_point, options.seed)
    except KeyboardInterrupt:
        if not candidates.tried:
            raise
        interrupted = True
    candidates.check_feasible()
    if len(task.goals) > 1:
        return front_of(candidates, options.front, known, interrupted=interrupted)
    best = best_candidate(candidates.feasible, SINGLE_WEIGHT)
    return optimum_of(candidates, best, known, interrupted=interrupted)
