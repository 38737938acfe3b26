"""The paper's figures that software can make, in the paper's order, with a module for each group."""

from solen.pipeline.project.paper import bench, prints, resin, robot, rotation
from solen.pipeline.project.paper.model import Made, PaperFigure, Picture

FIGURES: tuple[PaperFigure, ...] = (
    resin.LAYER,
    rotation.LENSES,
    rotation.SIMULATED,
    prints.LENSES,
    rotation.EXPERIMENT,
    bench.RESPONSE,
    robot.ROBOT,
    *resin.MODIFIED,
    prints.FILM_LAYER,
    rotation.OTHERS,
    prints.COUPONS,
    bench.TRACES,
)

__all__ = ["FIGURES", "Made", "PaperFigure", "Picture"]
