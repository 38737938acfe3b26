"""Wall finishes, keyed by the name that a design specifies in ``wall.finish``.

Another package adds a finish with an entry point of the group ``solen.finishes``, for example with a table of measured
values::

    VELVET = Finish(
        "mirror", Surface(table=AngleTable((0.0, 60.0, 90.0), (0.02, 0.05, 0.3)), scatter=Lambertian()),
        wavelength_nm=(840.0, 880.0),
    )

A wall has the body on its left: `Surface.table` applies to light from inside the body and `Surface.table_right` to
light from the air.
"""

from dataclasses import dataclass
from typing import Literal

from solen import registry
from solen.curve import check_range
from solen.errors import DesignError
from solen.scene.surface import Surface

BARE = Surface()


@dataclass(frozen=True)
class Finish:
    """Optical behaviour of part of a wall.

    Attributes
    ----------
    behaviour
        Whether light is transmitted, reflected or absorbed.
    surface
        Surface treatment: films, roughness, texture, coating.
    wavelength_nm
        Shortest and longest wavelength of the measurement; None if the finish is valid at any wavelength.
    """

    behaviour: Literal["refracting", "mirror", "absorbing"]
    surface: Surface = BARE
    wavelength_nm: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.wavelength_nm is not None:
            check_range("finish wavelength_nm", self.wavelength_nm[0], above=0.0)
            check_range("finish wavelength_nm", self.wavelength_nm[1], self.wavelength_nm[0])

    def check_at(self, what: str, name: str, wavelengths_nm: tuple[float, ...]) -> None:
        """Raise `DesignError` if one of these wavelengths is outside the measured range."""
        for nm in wavelengths_nm:
            if self.wavelength_nm is not None and not self.wavelength_nm[0] <= nm <= self.wavelength_nm[1]:
                low, high = self.wavelength_nm
                limit = f"was measured from {low:g} to {high:g} nm, but the light has {nm:g} nm"
                raise DesignError(what, value=name, limit=limit, remedy="use another finish or emitter")


FINISHES: registry.Registry[Finish] = registry.Registry(
    registry.FINISHES,
    {"clear": Finish("refracting"), "mirror": Finish("mirror"), "black": Finish("absorbing")},
    Finish,
)
"""Finishes, keyed by name."""
