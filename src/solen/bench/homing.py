"""Homing of stages that have no zero: never without permission.

Homing may move the stage to its limits with a sensor mounted on it. A stage is homed only if the rig file allows it
(``home = true``), or if the operator at the terminal, to whom the range is shown, agrees. With ``home = "here"`` the
current position is defined as the zero of the rig, and nothing moves.

Public names: `ensure_zero` and `has_zero`.
"""

from collections.abc import Callable
from typing import Literal, TypeGuard

from solen.bench.roles import HomingStage, Stage
from solen.errors import BenchError

Home = bool | Literal["here"]
Confirm = Callable[[str], bool]
"""Asks the operator a question; returns True if the answer is yes."""


def ensure_zero(
    stage: Stage, home: Home, zero: float, confirm: Confirm | None = None, *, resumed: bool = False
) -> None:
    """Ensure that a stage has a zero.

    Parameters
    ----------
    stage
        The stage; one that is not a `HomingStage` determines its zero without moving.
    home
        Whether the stage may be homed; ``"here"`` defines its current position as ``zero``.
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
    if not _is_homing(stage):
        stage.reference()
    elif stage.referenced:
        return
    elif home == "here" and resumed:
        remedy = "close the journal with solen bench recover, and begin another run"
        raise BenchError(stage.name, limit="has lost its zero since the run began", remedy=remedy)
    elif home == "here":
        stage.set_position(zero)
    elif home or (confirm is not None and confirm(f"{stage.name} has no zero. {stage.search} Begin?")):
        stage.reference()
    else:
        remedy = 'set home = true in [stage] to allow it, or home = "here" to define its current position as zero'
        raise BenchError(stage.name, limit=f"has no zero. {stage.search.rstrip('.')}", remedy=remedy)


def has_zero(stage: Stage) -> bool:
    """Whether the positions of a stage are valid; nothing moves."""
    return not _is_homing(stage) or stage.referenced


def _is_homing(stage: object) -> TypeGuard[HomingStage]:
    """Whether a stage is a `HomingStage`; properties, which may query the instrument, are not evaluated."""
    return hasattr(type(stage), "search") and hasattr(type(stage), "set_position")
