"""Loss of a guide by cut-back, and the smallest loss that a thin layer can reveal.

`readings` selects the columns of a table, `levels` converts readings to dB, and `cutback` fits the loss.
"""

from solen.material.loss.cutback import GuideLoss, Line, cut_back
from solen.material.loss.levels import absorption_per_mm, launched_level_dB, levels_dB, smallest_loss_dB_per_cm
from solen.material.loss.pieces import Piece
from solen.material.loss.readings import CutbackOptions, guide_loss

__all__ = [
    "CutbackOptions",
    "GuideLoss",
    "Line",
    "Piece",
    "absorption_per_mm",
    "cut_back",
    "guide_loss",
    "launched_level_dB",
    "levels_dB",
    "smallest_loss_dB_per_cm",
]
