from solen.analysis.calibration import Decoder as Decoder
from solen.api import analyse as analyse
from solen.api import calibrate_printer as calibrate_printer
from solen.api import calibrate_sensor as calibrate_sensor
from solen.api import diagnose as diagnose
from solen.api import export as export
from solen.api import index_of_layer as index_of_layer
from solen.api import loss_of_guide as loss_of_guide
from solen.api import measure_lens as measure_lens
from solen.api import working_curve as working_curve
from solen.errors import SolenError as SolenError
from solen.recording import read as read
from solen.report.plot import plot as plot
from solen.results import Outcome as Outcome
from solen.results import Result as Result
from solen.sensor import Sensor as Sensor
from solen.spec import load as load
from solen.spec import save as save

__all__: list[str]
__version__: str
