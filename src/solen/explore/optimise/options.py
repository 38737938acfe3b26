"""Options of a search."""

from pydantic import Field

from solen.fabricate.process import ProcessOptions
from solen.spec.strict import Finite, Options


class OptimiseOptions(ProcessOptions, Options):
    """Goals of a search, the parameters that may change, and the conditions to be met."""

    minimise: tuple[str, ...] = ()
    """An expression of merits to minimise, as in linearity_percent. Two expressions, or one in --minimise and one in
    --maximise, give a front of designs.
    """
    maximise: tuple[str, ...] = ()
    """An expression of merits to maximise, as in span; see --minimise."""
    front: int = Field(7, ge=3, le=50)
    """Number of designs of the front of two goals; some may be the same."""
    free: tuple[str, ...] = ()
    """A parameter of the design and the limits between which it may vary, KEY=LOW:HIGH; repeatable."""
    subject_to: tuple[str, ...] = ()
    """A condition on merits that the result must meet, as in "light >= 0.9*base"; repeatable."""
    robust: tuple[str, ...] = ()
    """A parameter and its deviation, KEY=DEVIATION: each design is also traced with the parameter deviating to either
    side, in all combinations; the goal is its worst value over these, and all must meet the conditions; repeatable.
    """
    as_printed: bool = False
    """Trace each design with the lens that --process prints, flat and without compensation, in place of the designed
    lens.
    """
    evaluations: int = Field(400, ge=20, le=100_000)
    """Number of designs to try, for all designs of a front together."""
    seed: int = Field(0, ge=0)
    """Seed of the search."""
    tolerance: Finite = Field(1e-3, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power during the search, as a fraction of the emitted power; results are traced with a
    tenth of it.
    """
    vary: tuple[str, ...] = ()
    """A parameter that varies between prints of the design and of the result, as in solen explore tolerance; default:
    the default variations of that command, with the growth and shrinkage of --process.
    """
    require: tuple[str, ...] = ()
    """A condition on merits that a good print meets; repeatable."""
    prints: int = Field(64, ge=0, le=100_000)
    """Number of prints of the design and of the result to trace: 0, or at least 32."""
