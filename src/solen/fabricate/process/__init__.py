"""From images to printed parts: dose, cured resin, printed lens, and a compensated drawing.

`solen.fabricate.process.settings` contains the values of the process file, and `solen.fabricate.process.field` computes
the dose. `solen.fabricate.process.flat` and `solen.fabricate.process.side_print` compute the printed lens for each
orientation, `solen.fabricate.process.solid` computes the entire printed part, and `solen.fabricate.process.predict`
computes the uncertainty. `solen.fabricate.process.compensate` corrects the drawing so that the part prints as designed.
`solen.fabricate.process.print_design` combines these steps for a design, and `solen.fabricate.process.calibrate`
determines process parameters from measured coupons.
"""

from solen.fabricate.process.calibrate import PrinterCalibration, calibrated
from solen.fabricate.process.compensate import Compensation, Drawing, Printing, compensated
from solen.fabricate.process.compensation_files import compensation_files, outline_text, targets_of
from solen.fabricate.process.coupon_fit import FittedFeature
from solen.fabricate.process.drawing import as_designed, curve_of, lens_face, redrawn, rings_of
from solen.fabricate.process.features import MeasuredCoupon, MeasuredFeature, SharedScale, printed_mm, read_features
from solen.fabricate.process.field import FlatImage, dose_map
from solen.fabricate.process.flat import FlatPrint, walls_um
from solen.fabricate.process.grey_steps import GreyOptions, MeasuredGreys, measured_greys
from solen.fabricate.process.growth import straight_edge_um
from solen.fabricate.process.predict import Orientation, predicted
from solen.fabricate.process.print_design import print_design
from solen.fabricate.process.printed_design import PrintedDesign
from solen.fabricate.process.printed_layers import PrintedLayers, layer_files, print_layers
from solen.fabricate.process.process_file import (
    Calibration,
    Process,
    default_process,
    parsed_process,
    process_text,
    read_process,
)
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.side_print import SidePrint
from solen.fabricate.process.solid import printed_solid
from solen.fabricate.process.source import PrintOptions, ProcessOptions, files_read, process_of, with_cure, with_resin
from solen.fabricate.process.target import Deviation, Target, exits_um
from solen.fabricate.process.terms import terms_at

__all__ = [
    "Calibration",
    "Compensation",
    "Deviation",
    "Drawing",
    "FittedFeature",
    "FlatImage",
    "FlatPrint",
    "GreyOptions",
    "MeasuredCoupon",
    "MeasuredFeature",
    "MeasuredGreys",
    "Orientation",
    "PrintOptions",
    "PrintedDesign",
    "PrintedLayers",
    "PrinterCalibration",
    "Printing",
    "Process",
    "ProcessOptions",
    "Settings",
    "SharedScale",
    "SidePrint",
    "Target",
    "as_designed",
    "calibrated",
    "compensated",
    "compensation_files",
    "curve_of",
    "default_process",
    "dose_map",
    "exits_um",
    "files_read",
    "layer_files",
    "lens_face",
    "measured_greys",
    "outline_text",
    "parsed_process",
    "predicted",
    "print_design",
    "print_layers",
    "printed_mm",
    "printed_solid",
    "process_of",
    "process_text",
    "read_features",
    "read_process",
    "redrawn",
    "rings_of",
    "straight_edge_um",
    "targets_of",
    "terms_at",
    "walls_um",
    "with_cure",
    "with_resin",
]
