"""Figures 4D and S6: voltage against angle and against time, recorded on the simulated rig."""

from functools import lru_cache
from pathlib import Path

from solen import files
from solen.analysis import Study, study
from solen.bench.record import RecordOptions
from solen.paper.samples import write_samples
from solen.paper.sensor_numbers import control_percent, mean_slope, protocol_numbers, rig_numbers
from solen.paper.statements import compared
from solen.pipeline.bench.record import run
from solen.pipeline.project.paper.model import Made, PaperFigure, Picture
from solen.report.bench.traces import traces_figure
from solen.report.plot import figure_of

SEED = 1
MARK = f"SIMULATED: the rig of solen bench new, three prints and one without a lens; seed {SEED}"
COMMANDS = (
    f"solen bench run data/rotation.toml --rig data/rig.toml --out recordings --seed {SEED}",
    "solen bench analyse recordings/rotation.nc --figure fig4d.pdf --traces figs6.pdf",
)


@lru_cache(maxsize=1)
def _study(folder: Path) -> Study:
    """Run the paper's protocol on the simulated rig and analyse it, once for both figures."""
    protocol, rig, _ = write_samples(folder, "rotation.toml", "rig.toml", "sensor.toml")
    for name in ("rotation.nc", "rotation.journal"):
        files.remove(folder / name)
    outcome = run(protocol, rig, folder, RecordOptions(seed=SEED))
    return study((outcome.files["recording"],))


def _response(folder: Path) -> Made:
    recorded = _study(folder)
    alt = (
        "voltage against angle for three simulated sensors with a lens, mean and standard deviation of five cycles: "
        "the right voltage falls towards −3°, the left one towards +3°; without a lens, both hardly change"
    )
    rows = [compared(f"voltage-{side}", *mean_slope(recorded, side)) for side in ("right", "left")]
    control = compared("control-measured", *control_percent(recorded))
    rig = [compared(key, number) for key, number in rig_numbers(recorded).items()]
    return Made((Picture("4D.svg", alt, lambda: figure_of(recorded), mark=MARK),), (*rows, control, *rig))


def _traces(folder: Path) -> Made:
    recorded = _study(folder)
    alt = "voltages of both receivers and angle against time for six cycles of each simulated sensor; holds are grey"
    rows = [compared(key, *number) for key, number in protocol_numbers(recorded).items()]
    return Made((Picture("S6.svg", alt, lambda: traces_figure(recorded), mark=MARK),), tuple(rows))


RESPONSE = PaperFigure(
    "4D", "Voltage against rotation angle, five cycles (mean curve, shaded standard deviation).", COMMANDS, _response
)
TRACES = PaperFigure("S6", "Voltage against time.", COMMANDS, _traces)
