"""Number types with limits, shared by several tables; lengths are in mm, angles in degrees."""

from typing import Annotated

from pydantic import Field

from solen.spec.strict import Number

Length = Annotated[Number, Field(ge=1e-6, le=1e6)]
Place = Annotated[Number, Field(ge=-1e6, le=1e6)]
Point = tuple[Place, Place]
Size = Annotated[Number, Field(ge=0, le=1e6)]
Angle = Annotated[Number, Field(ge=0, le=180)]
Index = Annotated[Number, Field(ge=1, lt=5)]
Wavelength = Annotated[Number, Field(ge=100, le=20_000)]
