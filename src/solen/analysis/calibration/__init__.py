"""Calibration of a sensor from its recorded response, cross-validation, and decoding of voltages into angles.

A calibration consists of the curves that (V_left, V_right) follows while the sensor turns, one for rising and one for
falling angles, and the covariance of a reading about them. A reading is decoded from the likelihood of every angle, so
that all angles that match it are reported. The accuracy is determined on cycles or prints held out of the calibration.

Public name: `calibrated_sensors`. Its steps are `training_of`, which prepares a `SensorResponse`; `calibrated`,
`pooled`, `leave_one_cycle_out` and `leave_one_sensor_out`. `CalibrationFile` is the saved file, `Decoder` uses it to
decode readings, and `StreamDecoder` decodes a stream.
"""

from solen.analysis.calibration.calibrate import CalibrationOptions, SensorCalibrations, calibrated_sensors
from solen.analysis.calibration.cross_validation import Check, leave_one_cycle_out, leave_one_sensor_out
from solen.analysis.calibration.decoder import Decoder
from solen.analysis.calibration.estimate import Calibration, calibrated, pooled
from solen.analysis.calibration.file import CalibrationFile
from solen.analysis.calibration.heading import Tracker
from solen.analysis.calibration.stream_decoder import DecodeOptions, Decoding, StreamDecoder
from solen.analysis.calibration.training import Training, training_of

__all__ = [
    "Calibration",
    "CalibrationFile",
    "CalibrationOptions",
    "Check",
    "DecodeOptions",
    "Decoder",
    "Decoding",
    "SensorCalibrations",
    "StreamDecoder",
    "Tracker",
    "Training",
    "calibrated",
    "calibrated_sensors",
    "leave_one_cycle_out",
    "leave_one_sensor_out",
    "pooled",
    "training_of",
]
