"""The figures of the paper that can be computed, in the order of the paper; each group has a module."""

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
