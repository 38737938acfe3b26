"""Pockets and slots: their position, their volume and those that do not fit."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from solen.errors import DataError, DesignError, SolenError, SpecError
from solen.fabricate import mesh_of, sensor_part
from solen.geometry import outline_body
from solen.parts import ReceiverPart, library_part
from solen.plane import along, dot, left_of, minus, unit
from solen.spec import Design, with_values
from tests.fabricate.solid_support import HALF, body_of, design, oval_z, part_of, seated

CLEARANCE = 0.05


def test_default_parts_have_no_seats() -> None:
    assert part_of(design()).cuts == ()


def test_pockets_have_the_size_of_the_package() -> None:
    part = library_part("TEMT7100X01")
    assert isinstance(part, ReceiverPart)
    assert part.package_depth_mm is not None
    width, height = 2.0 + 2 * CLEARANCE, 1.25 + 2 * CLEARANCE
    sensor = part_of(design(fabricate__pockets=True))
    assert [cut.name for cut in sensor.cuts] == ["pocket-right", "pocket-left"]
    for cut in sensor.cuts:
        assert cut.volume_mm3 == pytest.approx(width * height * 0.85, rel=1e-12)
        assert (cut.removed.from_mm, cut.removed.to_mm) == pytest.approx((2.0 - height / 2, 2.0 + height / 2))
    shallow = part_of(design(fabricate__pockets=True, fabricate__pocket_depth_mm=0.3, fabricate__clearance_mm=0.0))
    assert shallow.cuts[0].volume_mm3 == pytest.approx(2.0 * 1.25 * 0.3, rel=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_pocket_is_in_the_arm_at_the_centre_of_its_receiver(side: str) -> None:
    sensor = design(fabricate__pockets=True)
    receiver = body_of(sensor).face(f"receiver-{side}").curve
    inwards = left_of(unit(minus(receiver.end, receiver.start)))
    (cut,) = (cut for cut in part_of(sensor).cuts if cut.name == f"pocket-{side}")
    corners = np.array([face.curve.start for face in cut.removed.outlines[0]])
    centre = along(receiver.middle_point, inwards, 0.85 / 2)
    assert corners.mean(axis=0) == pytest.approx(centre, abs=1e-12)
    depths = sorted(dot(minus((x, z), receiver.start), inwards) for x, z in corners.tolist())
    assert depths == pytest.approx([0.0, 0.0, 0.85, 0.85], abs=1e-12)


def test_slots_are_at_the_top_with_the_depth_of_the_film() -> None:
    part = part_of(design(fabricate__slots=["receivers"], body__thickness_mm=3.0))
    for cut in part.cuts:
        assert (cut.removed.from_mm, cut.removed.to_mm) == (2.9, 3.0)
        assert cut.volume_mm3 == pytest.approx(0.1 * 2.1 * 2.0, rel=1e-12)


def test_the_slot_of_the_emitter_begins_at_the_lens() -> None:
    """Its area between the oval and its end agrees with a quadrature."""
    (cut,) = part_of(design(fabricate__slots=["emitter"])).cuts
    end = float(oval_z(np.array([HALF]))[0]) + 2.0
    half = 1.0 + CLEARANCE
    before = quad(lambda x: float(oval_z(np.array([x]))[0]), -half, half, epsabs=1e-11)[0]
    assert cut.volume_mm3 == pytest.approx(0.1 * (2 * half * end - before), abs=1e-10)


def test_the_slot_of_the_emitter_in_a_divided_lens_and_in_a_flat_face() -> None:
    undivided = part_of(design(fabricate__slots=["emitter"]))
    divided = design(
        fabricate__slots=["emitter"], wall=[{"face": "lens", "from_mm": 1.0, "to_mm": 3.1, "finish": "black"}]
    )
    assert len([face for face in body_of(divided).faces if face.part == "lens"]) == 3
    assert part_of(divided).volume_mm3 == pytest.approx(undivided.volume_mm3, abs=1e-9)
    flat = part_of(design(fabricate__slots=["emitter"], lens__shape="none"))
    assert flat.cuts[0].volume_mm3 == pytest.approx(0.1 * 2.1 * 2.0, rel=1e-12)


def test_seats_reduce_the_volume_of_the_mesh() -> None:
    uncut, part = part_of(design()), part_of(seated())
    removed = mesh_of(uncut, 1e-4).volume_mm3 - mesh_of(part, 1e-4).volume_mm3
    assert removed == pytest.approx(sum(cut.volume_mm3 for cut in part.cuts), abs=1e-4)
    assert len(part.cuts) == 5


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"fabricate__pockets": True, "body__arm_width_mm": 2.0}, "pocket-right; extends beyond the part"),
        ({"fabricate__pockets": True, "body__thickness_mm": 1.0}, "pocket-right; extends beyond the part"),
        ({"fabricate__pockets": True, "fabricate__pocket_depth_mm": 40.0}, "pocket-right and pocket-left intersect"),
        (
            {"fabricate__pockets": True, "fabricate__slots": ["receivers"], "body__thickness_mm": 1.45},
            "pocket-right and slot-right intersect; make the part thicker",
        ),
        ({"fabricate__slots": ["emitter"], "fabricate__slot_width_mm": 3.9}, "slot_width_mm = 3.9; "),
        ({"fabricate__slots": ["receivers"], "fabricate__slot_length_mm": 500.0}, "slot-right and slot-left intersect"),
        ({"fabricate__slots": ["receivers"], "fabricate__film_mm": 5.0}, "extends beyond the part"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "VSMY1850"}, "is an emitter, not a receiver"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "TEMT7100"}, "did you mean TEMT7100X01?"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "none.toml"}, "no such file"),
    ],
)
def test_refuses_seats_that_do_not_fit(values: dict[str, object], text: str) -> None:
    with pytest.raises(SolenError) as error:
        part_of(design(**values))
    assert text in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"fabricate__slots": ["emitter", "emitter"]}, 'must be a list of "receivers" and "emitter"'),
        ({"fabricate__slots": ["arms"]}, 'must be a list of "receivers" and "emitter"'),
        ({"fabricate__film_mm": 0.0}, "fabricate.film_mm = 0.0; must be at least 0.001"),
        ({"fabricate__clearance_mm": -0.1}, "must be at least 0"),
        ({"fabricate__pockets": 1}, "fabricate.pockets = 1"),
        (
            {"fabricate__pockets": True, "receivers__coupling": "air-gap", "receivers__gap_mm": 0.5},
            "fabricate.pockets",
        ),
    ],
)
def test_refuses_invalid_keys(values: dict[str, object], text: str) -> None:
    with pytest.raises(SpecError) as error:
        design(**values)
    assert text in str(error.value)


def test_refuses_a_part_file_without_a_size(tmp_path: Path) -> None:
    text = 'schema = 1\nname = "mine"\nkind = "receiver"\nmaker = "me"\ndocument = "page 1"\n'
    for key, value in (("current_ua_per_mw_cm2", 400), ("package_width_mm", 1.5), ("package_height_mm", 1.0)):
        text += f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "page 1"\n'
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    sensor = design(fabricate__pockets=True, fabricate__receiver_part="mine.toml").in_folder(tmp_path)
    with pytest.raises(DataError, match=r"mine; .*package_depth_mm.*fabricate\.pocket_depth_mm"):
        part_of(sensor)
    part = part_of(with_values(sensor, {"fabricate.pocket_depth_mm": 0.5}))
    assert part.cuts[0].volume_mm3 == pytest.approx(1.6 * 1.1 * 0.5, rel=1e-12)


def outline(folder: Path, receiver: str, **fabricate: object) -> Design:
    """Write an outline 10 mm high whose right side has the specified name, and return its design."""
    sides = [
        ("wall", [0, 0], [6, 0]),
        (receiver, [6, 0], [6, 10]),
        ("wall", [6, 10], [0, 10]),
        ("wall", [0, 10], [0, 0]),
    ]
    faces = ", ".join(
        f'{{"name": "{name}", "curve": {{"kind": "segment", "a": {a}, "b": {b}}}}}' for name, a, b in sides
    )
    text = f'{{"solen_outline": 1, "faces": [{faces}], "emitters": [{{"point": [3, -1]}}]}}'
    (folder / "box.json").write_text(text, encoding="utf-8")
    tables = {"body": {"kind": "outline", "file": "box.json"}, "material": {"index": 1.5}, "fabricate": fabricate}
    return Design.model_validate({"name": "box", **tables}).in_folder(folder)


def test_outlines_can_have_seats(tmp_path: Path) -> None:
    box = outline(tmp_path, "receiver-end", pockets=True, slots=["receivers"])
    part = sensor_part(box, outline_body(box))
    assert [cut.name for cut in part.cuts] == ["pocket-end", "slot-end"]


@pytest.mark.parametrize(
    ("receiver", "seats", "text"),
    [
        ("wall", {"pockets": True}, "receiver"),
        ("receiver", {"slots": ["emitter"]}, "fabricate.slots"),
    ],
)
def test_refuses_seats_for_which_an_outline_has_no_face(
    tmp_path: Path, receiver: str, seats: dict[str, object], text: str
) -> None:
    box = outline(tmp_path, receiver, **seats)
    with pytest.raises(DesignError, match=text):
        sensor_part(box, outline_body(box))


def test_seats_do_not_change_the_optical_body() -> None:
    assert body_of(seated()).faces == body_of(design()).faces
