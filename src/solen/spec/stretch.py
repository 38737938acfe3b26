"""Part of the outline, as specified in wall, hold and pull tables."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from solen.spec.strict import NotNegative, Number, Strict, Text, refused


class Stretch(Strict):
    """A face, all faces that match a pattern, or part of a face."""

    face: Text = Field(description='a face or a pattern of faces, such as "stem-right" or "stem-*".')
    from_mm: NotNegative = Field(0.0, description="Start of the part in mm along the face.")
    to_mm: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="End of the part in mm along the face; default: the end of the face."
    )

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.to_mm is not None and not self.from_mm < self.to_mm:
            raise refused("from_mm", f"must be less than to_mm = {self.to_mm}", value=self.from_mm)
        return self
