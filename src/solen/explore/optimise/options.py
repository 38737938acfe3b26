"""What may be asked of a search."""

from pydantic import Field

from solen.fabricate.process import ProcessOptions
from solen.spec.strict import Finite, Options


class OptimiseOptions(ProcessOptions, Options):
    """What is sought, what may change, and what must hold."""

    minimise: tuple[str, ...] = ()
    """A value of merits to be made small, as in linearity_percent; of two values, or one and one of --maximise, a front
    of designs is sought."""
    maximise: tuple[str, ...] = ()
    """A value of merits to be made large, as in span; see --minimise."""
    front: int = Field(7, ge=3, le=50)
    """Number of designs of the front, where two values are sought; some may be the same."""
    free: tuple[str, ...] = ()
    """A number of the design and the ends between which it may be, KEY=LOW:HIGH; repeatable."""
    subject_to: tuple[str, ...] = ()
    """A condition on merits that must hold, as in "light >= 0.9*base"; repeatable."""
    robust: tuple[str, ...] = ()
    """A number and how far off it may be, KEY=DEVIATION: the worst value counts and all conditions hold with it off to
    either side, in all combinations; repeatable."""
    as_printed: bool = False
    """Trace each design with the lens that --process prints, flat and without compensation, in place of the designed
    one."""
    evaluations: int = Field(400, ge=20, le=100_000)
    """Number of designs tried, of a front in all."""
    seed: int = Field(0, ge=0)
    """Seed of the search."""
    tolerance: Finite = Field(1e-3, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power while searching, as a share of the emitted power; results are traced ten times as
    closely."""
    vary: tuple[str, ...] = ()
    """What varies between prints of the design and of the result, as in solen explore tolerance; default: what varies
    there, and growth and shrinkage by --process."""
    require: tuple[str, ...] = ()
    """A condition on merits that a good print meets; repeatable."""
    prints: int = Field(64, ge=0, le=100_000)
    """Number of prints that are traced of the design and of the result; 0 for none, else at least 32."""
