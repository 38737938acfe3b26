"""What a printer makes of the images that it is sent: dose, set resin, the printed lens, and drawing against it.

`solen.fabricate.process.settings` holds the process file; `solen.fabricate.process.reference` is the dose by direct
sums and the truth for `solen.fabricate.process.field`, which is fast; `solen.fabricate.process.flat` and
`solen.fabricate.process.upright` follow a lens's wall in each orientation, `solen.fabricate.process.solid` makes the
whole part that comes out, `solen.fabricate.process.predict` says how
well it is known, `solen.fabricate.process.compensate` draws so that it prints as wanted, and
`solen.fabricate.process.calibrate` finds the process's numbers from measured coupons.
"""

from solen.fabricate.process.calibrate import Fit, calibrated
from solen.fabricate.process.compensate import Compensation, compensated
from solen.fabricate.process.coupons import Feature, printed_mm
from solen.fabricate.process.drawn import DrawnFace, as_designed, curve_of, lens_face, redrawn, rings_of
from solen.fabricate.process.field import DoseMap, Images, dose_map
from solen.fabricate.process.flat import FlatPrint, walls_um
from solen.fabricate.process.light import Terms, straight_edge_um, terms_at
from solen.fabricate.process.predict import ORIENTATIONS, Orientation, Prediction, points_for, predicted
from solen.fabricate.process.settings import (
    Calibration,
    Process,
    Settings,
    default_process,
    parsed_process,
    process_text,
    read_process,
)
from solen.fabricate.process.solid import Slab, printed_solid
from solen.fabricate.process.target import Deviation, Target, exits_um
from solen.fabricate.process.upright import SidePrint

__all__ = [
    "ORIENTATIONS",
    "Calibration",
    "Compensation",
    "Deviation",
    "DoseMap",
    "DrawnFace",
    "Feature",
    "Fit",
    "FlatPrint",
    "Images",
    "Orientation",
    "Prediction",
    "Process",
    "Settings",
    "SidePrint",
    "Slab",
    "Target",
    "Terms",
    "as_designed",
    "calibrated",
    "compensated",
    "curve_of",
    "default_process",
    "dose_map",
    "exits_um",
    "lens_face",
    "parsed_process",
    "points_for",
    "predicted",
    "printed_mm",
    "printed_solid",
    "process_text",
    "read_process",
    "redrawn",
    "rings_of",
    "straight_edge_um",
    "terms_at",
    "walls_um",
]
