"""Voltages to angles: a calibration of a sensor by its recorded response, what it is worth, and decoding by it.

The idea: a calibration is the curve that (V_left, V_right) runs through while the sensor turns, one for rising and one
for falling angles, and the covariance of a reading about it. A reading is decoded by the likelihood of every angle, so
that two angles that explain it equally well stay two. What a calibration is worth is told by cycles, or prints, that
it has not seen.

The interface: `training_of` an `Analysed` sensor, `calibrated` or `pooled`, `Decoder`, `leave_one_cycle_out` and
`leave_one_sensor_out`; `CalibrationFile` is what is saved.
"""

from solen.analysis.calibration.checks import Check, leave_one_cycle_out, leave_one_sensor_out
from solen.analysis.calibration.decoder import Decoded, Decoder
from solen.analysis.calibration.fit import Calibration, calibrated, pooled
from solen.analysis.calibration.heading import Headings, Tracker
from solen.analysis.calibration.training import Samples, Training, training_of

__all__ = [
    "Calibration",
    "Check",
    "Decoded",
    "Decoder",
    "Headings",
    "Samples",
    "Tracker",
    "Training",
    "calibrated",
    "leave_one_cycle_out",
    "leave_one_sensor_out",
    "pooled",
    "training_of",
]
