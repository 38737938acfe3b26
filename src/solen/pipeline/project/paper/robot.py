"""Figure 5: the monolithic robot, a network whose members guide light from the lenses to the receivers."""

from pathlib import Path

from solen.paper.sensor_numbers import received_percent, shipped
from solen.paper.statements import compared
from solen.pipeline.project.paper.model import Made, PaperFigure, Picture
from solen.report.paper.figures import robot_figure
from solen.sensor.network import network_trace


def _robot(_: Path) -> Made:
    traced = network_trace(shipped("robot-860").design)
    alt = "rays of both emitters of a robot in one body: each lens directs its light through the trunk to the far legs"
    mark = "SIMULATED: robot-860, a network with dimensions chosen for solen; traced in the plane"
    picture = Picture("5.svg", alt, lambda: robot_figure(traced), mark=mark)
    return Made((picture,), (compared("robot", *received_percent(traced)),))


ROBOT = PaperFigure(
    "5",
    "A monolithic soft robot: its structural members are waveguides, and printed lenses direct the light.",
    (
        "solen new robot-860 --example robot-860",
        "solen trace robot-860/sensor.toml --set trace.mode=count --figure fig5.pdf",
    ),
    _robot,
)
