"""The command `solen bench diagnose`."""

from collections.abc import Iterator

from solen.analysis.diagnosis import SensorDiagnoses
from solen.cli.app import lines
from solen.cli.bench.analyse import LENS
from solen.pipeline.bench.diagnose import diagnose as diagnose


@lines.register
def _(result: SensorDiagnoses) -> Iterator[str]:
    simulated = "; simulated" if result.simulated else ""
    for label, sensor in result.sensors.items():
        cycles = f"{sensor.cycles_used} cycles, ± is the half-width of the 95 % interval"
        yield f"{label}{LENS[sensor.lens]}: {cycles}{simulated}"
        yield from (f"  {line}" for line in sensor.words)
        yield from (f"  advice: {line}" for line in sensor.advice)
