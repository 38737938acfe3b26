from solen.api import cutback as cutback
from solen.errors import SolenError as SolenError
from solen.recording import read as read
from solen.report.plot import plot as plot
from solen.results import Result as Result
from solen.sensor import Sensor as Sensor
from solen.spec import load as load

__all__: list[str]
__version__: str
