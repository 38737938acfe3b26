"""A stretch of the outline, as tables of walls, holds and pulls name it."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from solen.spec.strict import NotNegative, Number, Strict, Text, refused


class Stretch(Strict):
    """A face, every face that a pattern matches, or part of it."""

    face: Text = Field(description='a face or a pattern of faces, as "stem-right" or "stem-*".')
    from_mm: NotNegative = Field(0.0, description="Where the stretch begins, in mm along the face.")
    to_mm: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="Where the stretch ends, in mm along the face; default: at its end."
    )

    @model_validator(mode="after")
    def _runs_onwards(self) -> Self:
        if self.to_mm is not None and not self.from_mm < self.to_mm:
            raise refused("from_mm", f"must be less than to_mm = {self.to_mm}", value=self.from_mm)
        return self
