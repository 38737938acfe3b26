"""The registry of body kinds: a kind from outside the package is built, refused and described like the others."""

from collections.abc import Iterator

import pytest

from solen.errors import SpecError
from solen.geometry import BODY_KINDS, Body, BodyKind, Pose, body_of
from solen.geometry.kinds import register
from solen.geometry.y import y_body
from solen.lens import Lens, lens_of
from solen.spec import Design
from solen.spec.body import UNUSED_KEYS


def design(**body: object) -> Design:
    return Design(name="d", material={"index": 1.44}, body=body)


@pytest.fixture
def twin() -> Iterator[None]:
    """A kind of its own: a Y whose emitter never moves."""

    def build(of: Design, lens: Lens | None, angle_deg: float) -> Body:
        assert lens is not None
        found = y_body(of, lens, angle_deg)
        return Body(found.faces, Pose((0.0, -of.emitter.distance_mm), 0.0), found.marks)

    register("twin", BodyKind(build, {"body": ("file",)}))
    yield
    del BODY_KINDS.own["twin"], UNUSED_KEYS["twin"]


@pytest.mark.usefixtures("twin")
def test_a_kind_from_outside_is_built_and_its_keys_are_checked() -> None:
    made = design(kind="twin")
    lens = lens_of(made, 1.44)
    assert body_of(made, lens, -3.0).faces == y_body(design(), lens, -3.0).faces
    assert body_of(made, lens, -3.0).emitter == body_of(made, lens).emitter
    with pytest.raises(SpecError, match=r"body\.file.*twin"):
        design(kind="twin", file="a.dxf")
    assert "twin" in Design.model_json_schema()["$defs"]["Body"]["properties"]["kind"]["enum"]


def test_an_unknown_kind_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SpecError, match=r"body\.kind = 'cross'; must be 'y' or 'outline'"):
        design(kind="cross")


def test_a_drawn_lens_is_not_computed() -> None:
    assert [name for name, kind in BODY_KINDS.items() if kind.lens_is_drawn] == ["outline", "network"]
