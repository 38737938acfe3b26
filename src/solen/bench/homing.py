"""Homing of stages that do not know their zero: never without permission.

A search for the reference switch may move the stage to its limits with a sensor mounted on it. The search is made only
if the rig file allows it (``home = true``) or if the operator at the terminal, warned of the range, agrees. With ``home
= "here"`` the current position is defined as the zero of the rig, and nothing moves.

Public names: `make_known` and `knows_zero`.
"""

from collections.abc import Callable
from typing import Literal, TypeGuard

from solen.bench.roles import Homes, Stage
from solen.errors import BenchError

Home = bool | Literal["here"]
Confirm = Callable[[str], bool]
"""Asks the operator a question; returns True if the answer is yes."""


def make_known(stage: Stage, home: Home, zero: float, confirm: Confirm | None = None, *, resumed: bool = False) -> None:
    """Ensure that a stage knows its zero.

    Parameters
    ----------
    stage
        The stage; a stage without `Homes` finds its zero by its own means.
    home
        Whether the stage may move to find its zero, or ``"here"`` if it is at its zero.
    zero
        Position at which the sensor is straight.
    confirm
        Asks the operator for permission if ``home`` is false; None without an operator.
    resumed
        Whether an interrupted run continues; the stage may then be anywhere.

    Raises
    ------
    BenchError
        If the stage is not allowed to move, or finds no reference.
    """
    if not _moves_to_know(stage):
        stage.reference()
    elif stage.referenced:
        return
    elif home == "here" and resumed:
        remedy = "close the journal with solen bench recover, and begin another run"
        raise BenchError(stage.name, limit="has lost its zero since the run began", remedy=remedy)
    elif home == "here":
        stage.set_position(zero)
    elif home or (confirm is not None and confirm(f"{stage.name} does not know its zero. {stage.search} Begin?")):
        stage.reference()
    else:
        remedy = 'home = true in [stage] allows it; home = "here" defines its current position as zero'
        raise BenchError(stage.name, limit=f"does not know its zero. {stage.search}", remedy=remedy)


def knows_zero(stage: Stage) -> bool:
    """Whether the stage positions are currently valid; nothing moves."""
    return not _moves_to_know(stage) or stage.referenced


def _moves_to_know(stage: object) -> TypeGuard[Homes]:
    """Whether a stage implements `Homes`; properties, which may query the instrument, are not evaluated."""
    return hasattr(type(stage), "search") and hasattr(type(stage), "set_position")
