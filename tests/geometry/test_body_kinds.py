"""The registry of body kinds: a kind from outside the package is built, checked and documented like the others."""

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
def fixed_emitter_kind() -> Iterator[None]:
    """Register the kind ``twin``: a Y whose emitter does not move."""

    def build(design: Design, lens: Lens | None, angle_deg: float) -> Body:
        assert lens is not None
        y = y_body(design, lens, angle_deg)
        return Body(y.faces, Pose((0.0, -design.emitter.distance_mm), 0.0), y.marks)

    register("twin", BodyKind(build, {"body": ("file",)}))
    yield
    del BODY_KINDS.own["twin"], UNUSED_KEYS["twin"]


@pytest.mark.usefixtures("fixed_emitter_kind")
def test_builds_registered_kind_and_checks_its_keys() -> None:
    kind_design = design(kind="twin")
    lens = lens_of(kind_design, 1.44)
    assert body_of(kind_design, lens, -3.0).faces == y_body(design(), lens, -3.0).faces
    assert body_of(kind_design, lens, -3.0).emitter == body_of(kind_design, lens).emitter
    with pytest.raises(SpecError, match=r"body\.file.*twin"):
        design(kind="twin", file="a.dxf")
    assert "twin" in Design.model_json_schema()["$defs"]["Body"]["properties"]["kind"]["enum"]


def test_refuses_unknown_kind() -> None:
    with pytest.raises(SpecError, match=r"body\.kind = 'cross'; must be 'y', 'outline' or 'network'"):
        design(kind="cross")


def test_kinds_with_drawn_lens() -> None:
    assert [name for name, kind in BODY_KINDS.items() if kind.lens_is_drawn] == ["outline", "network"]
