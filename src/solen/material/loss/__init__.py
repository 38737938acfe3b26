"""Loss of a guide: by cut-back, and what a thin layer could tell of it.

`solen.material.loss.levels` takes readings to dB, `solen.material.loss.cutback` finds the loss from them.
"""

from solen.material.loss.cutback import CutBack, Line, SetAside, cut_back
from solen.material.loss.levels import absorption_per_mm, full_level_dB, levels_dB, smallest_loss_dB_per_cm
from solen.material.loss.pieces import Piece

__all__ = [
    "CutBack",
    "Line",
    "Piece",
    "SetAside",
    "absorption_per_mm",
    "cut_back",
    "full_level_dB",
    "levels_dB",
    "smallest_loss_dB_per_cm",
]
