"""What a printer makes of the images that it is sent: dose, set resin, the printed lens, and drawing against it.

`solen.fabricate.process.settings` holds the process file; `solen.fabricate.process.field` is the dose;
`solen.fabricate.process.flat` and `solen.fabricate.process.upright` follow a lens's wall in each orientation,
`solen.fabricate.process.solid` makes the whole part that comes out, `solen.fabricate.process.predict` gives its
uncertainty, `solen.fabricate.process.compensate` draws so that it prints as wanted,
`solen.fabricate.process.print_design` does all of it for a design, and `solen.fabricate.process.calibrate` finds the
process's numbers from measured coupons.
"""

from solen.fabricate.process.calibrate import CalibratedNumber, FittedFeature, PrinterCalibration, calibrated
from solen.fabricate.process.compensate import Compensation, compensated
from solen.fabricate.process.compensation_files import compensation_files
from solen.fabricate.process.drawing import DrawnFace, as_designed, curve_of, lens_face, redrawn, rings_of
from solen.fabricate.process.features import MeasuredFeature, printed_mm, read_features
from solen.fabricate.process.field import DoseMap, FlatImage, dose_map
from solen.fabricate.process.flat import FlatPrint, walls_um
from solen.fabricate.process.growth import growth_um, straight_edge_um, with_growth
from solen.fabricate.process.predict import Orientation, Prediction, points_for, predicted
from solen.fabricate.process.print_design import PrintedDesign, PrintedPart, print_design, profile_of_print
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
from solen.fabricate.process.source import PrintOptions, process_of, with_printer, with_resin
from solen.fabricate.process.target import Deviation, Target, exits_um
from solen.fabricate.process.terms import Terms, terms_at
from solen.fabricate.process.upright import SidePrint

__all__ = [
    "CalibratedNumber",
    "Calibration",
    "Compensation",
    "Deviation",
    "DoseMap",
    "DrawnFace",
    "FittedFeature",
    "FlatImage",
    "FlatPrint",
    "MeasuredFeature",
    "Orientation",
    "Prediction",
    "PrintOptions",
    "PrintedDesign",
    "PrintedPart",
    "PrinterCalibration",
    "Process",
    "Settings",
    "SidePrint",
    "Slab",
    "Target",
    "Terms",
    "as_designed",
    "calibrated",
    "compensated",
    "compensation_files",
    "curve_of",
    "default_process",
    "dose_map",
    "exits_um",
    "growth_um",
    "lens_face",
    "parsed_process",
    "points_for",
    "predicted",
    "print_design",
    "printed_mm",
    "printed_solid",
    "process_of",
    "process_text",
    "profile_of_print",
    "read_features",
    "read_process",
    "redrawn",
    "rings_of",
    "straight_edge_um",
    "terms_at",
    "walls_um",
    "with_growth",
    "with_printer",
    "with_resin",
]
