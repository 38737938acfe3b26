"""Pockets and slots: where they are, what they take away, and which do not fit."""

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


def refused(chosen: Design) -> str:
    with pytest.raises(SolenError) as refusal:
        part_of(chosen)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_without_being_asked_for_there_are_none() -> None:
    assert part_of(design()).cuts == ()


def test_pockets_hold_the_package_of_the_datasheet() -> None:
    part = library_part("TEMT7100X01")
    assert isinstance(part, ReceiverPart)
    assert part.package_depth_mm is not None
    wide, high = 2.0 + 2 * CLEARANCE, 1.25 + 2 * CLEARANCE
    made = part_of(design(fabricate__pockets=True))
    assert [cut.name for cut in made.cuts] == ["pocket-right", "pocket-left"]
    for cut in made.cuts:
        assert cut.volume_mm3 == pytest.approx(wide * high * 0.85, rel=1e-12)
        assert (cut.takes.from_mm, cut.takes.to_mm) == pytest.approx((2.0 - high / 2, 2.0 + high / 2))
    shallow = part_of(design(fabricate__pockets=True, fabricate__pocket_depth_mm=0.3, fabricate__clearance_mm=0.0))
    assert shallow.cuts[0].volume_mm3 == pytest.approx(2.0 * 1.25 * 0.3, rel=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_pocket_lies_in_the_middle_of_its_receiver_and_runs_into_the_arm(side: str) -> None:
    chosen = design(fabricate__pockets=True)
    receiver = body_of(chosen).face(f"receiver-{side}").curve
    inwards = left_of(unit(minus(receiver.end, receiver.start)))
    (cut,) = (cut for cut in part_of(chosen).cuts if cut.name == f"pocket-{side}")
    corners = np.array([face.curve.start for face in cut.takes.outlines[0]])
    middle = along(receiver.middle_point, inwards, 0.85 / 2)
    assert corners.mean(axis=0) == pytest.approx(middle, abs=1e-12)
    depths = sorted(dot(minus((x, z), receiver.start), inwards) for x, z in corners.tolist())
    assert depths == pytest.approx([0.0, 0.0, 0.85, 0.85], abs=1e-12)


def test_slots_are_as_deep_as_the_film_and_open_at_the_top() -> None:
    made = part_of(design(fabricate__slots=["receivers"], body__thickness_mm=3.0))
    for cut in made.cuts:
        assert (cut.takes.from_mm, cut.takes.to_mm) == (2.9, 3.0)
        assert cut.volume_mm3 == pytest.approx(0.1 * 2.1 * 2.0, rel=1e-12)


def test_the_emitters_slot_goes_through_the_lens() -> None:
    """Its area is what lies between the oval and the slot's end, by a quadrature of the oval's equation."""
    (cut,) = part_of(design(fabricate__slots=["emitter"])).cuts
    end = float(oval_z(np.array([HALF]))[0]) + 2.0
    half = 1.0 + CLEARANCE
    under = quad(lambda x: float(oval_z(np.array([x]))[0]), -half, half, epsabs=1e-11)[0]
    assert cut.volume_mm3 == pytest.approx(0.1 * (2 * half * end - under), abs=1e-10)


def test_the_emitters_slot_in_a_lens_that_walls_divide_and_in_a_flat_face() -> None:
    whole = part_of(design(fabricate__slots=["emitter"]))
    divided = design(
        fabricate__slots=["emitter"], wall=[{"face": "lens", "from_mm": 1.0, "to_mm": 3.1, "finish": "black"}]
    )
    assert len([face for face in body_of(divided).faces if face.part == "lens"]) == 3
    assert part_of(divided).volume_mm3 == pytest.approx(whole.volume_mm3, abs=1e-9)
    flat = part_of(design(fabricate__slots=["emitter"], lens__shape="none"))
    assert flat.cuts[0].volume_mm3 == pytest.approx(0.1 * 2.1 * 2.0, rel=1e-12)


def test_what_is_cut_is_missing_from_the_mesh() -> None:
    whole, cut = part_of(design()), part_of(seated())
    missing = mesh_of(whole, 1e-4).volume_mm3 - mesh_of(cut, 1e-4).volume_mm3
    assert missing == pytest.approx(sum(one.volume_mm3 for one in cut.cuts), abs=1e-4)
    assert len(cut.cuts) == 5


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"fabricate__pockets": True, "body__arm_width_mm": 2.0}, "pocket-right; would remove"),
        ({"fabricate__pockets": True, "body__thickness_mm": 1.0}, "pocket-right; would remove"),
        ({"fabricate__pockets": True, "fabricate__pocket_depth_mm": 40.0}, "'pocket-right and pocket-left'; intersect"),
        (
            {"fabricate__pockets": True, "fabricate__slots": ["receivers"], "body__thickness_mm": 1.45},
            "'pocket-right and slot-right'; intersect; make the part thicker",
        ),
        ({"fabricate__slots": ["emitter"], "fabricate__slot_width_mm": 3.9}, "slot_width_mm = 3.9; must be below 3.9"),
        (
            {"fabricate__slots": ["receivers"], "fabricate__slot_length_mm": 500.0},
            "'slot-right and slot-left'; intersect",
        ),
        ({"fabricate__slots": ["receivers"], "fabricate__film_mm": 5.0}, "would remove"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "VSMY1850"}, "is an emitter, not a receiver"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "TEMT7100"}, "did you mean TEMT7100X01?"),
        ({"fabricate__pockets": True, "fabricate__receiver_part": "none.toml"}, "no such file"),
    ],
)
def test_what_does_not_fit_is_refused(values: dict[str, object], told: str) -> None:
    assert told in refused(design(**values))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"fabricate__slots": ["emitter", "emitter"]}, 'must be a list of "receivers" and "emitter"'),
        ({"fabricate__slots": ["arms"]}, 'must be a list of "receivers" and "emitter"'),
        ({"fabricate__film_mm": 0.0}, "fabricate.film_mm = 0.0; must be at least 0.001"),
        ({"fabricate__clearance_mm": -0.1}, "must be at least 0"),
        ({"fabricate__pockets": 1}, "fabricate.pockets = 1"),
        (
            {"fabricate__pockets": True, "receivers__coupling": "air-gap", "receivers__gap_mm": 0.5},
            "a pocket seats a receiver on the body",
        ),
    ],
)
def test_what_the_file_cannot_say(values: dict[str, object], told: str) -> None:
    with pytest.raises(SpecError) as refusal:
        design(**values)
    assert told in str(refusal.value)


def test_a_part_file_that_lacks_a_size_is_refused(tmp_path: Path) -> None:
    text = "\n".join(
        (
            *('schema = 1\nname = "mine"', 'kind = "receiver"', 'maker = "me"', 'document = "page 1"'),
            *("[current_ua_per_mw_cm2]", "typical = 400", 'basis = "measured"', 'source = "page 1"'),
            *("[package_width_mm]", "typical = 1.5", 'basis = "measured"', 'source = "page 1"'),
            *("[package_height_mm]", "typical = 1.0", 'basis = "measured"', 'source = "page 1"'),
        )
    )
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    chosen = design(fabricate__pockets=True, fabricate__receiver_part="mine.toml").in_folder(tmp_path)
    with pytest.raises(DataError, match=r"receiver mine; specifies no package_depth_mm; .*fabricate.pocket_depth_mm"):
        part_of(chosen)
    made = part_of(with_values(chosen, {"fabricate.pocket_depth_mm": 0.5}))
    assert made.cuts[0].volume_mm3 == pytest.approx(1.6 * 1.1 * 0.5, rel=1e-12)


def outline(folder: Path, receiver: str, **fabricate: object) -> Design:
    """A box 10 mm high whose right side is a receiver, if that is its name."""
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


def test_an_outlines_receivers_have_seats_too(tmp_path: Path) -> None:
    chosen = outline(tmp_path, "receiver-end", pockets=True, slots=["receivers"])
    part = sensor_part(chosen, outline_body(chosen))
    assert [cut.name for cut in part.cuts] == ["pocket-end", "slot-end"]


@pytest.mark.parametrize(
    ("receiver", "seats", "told"),
    [
        ("wall", {"pockets": True}, "no face of the body is a receiver"),
        ("receiver", {"slots": ["emitter"]}, "can be cut only into a Y"),
    ],
)
def test_an_outline_without_a_place_for_them_is_refused(
    tmp_path: Path, receiver: str, seats: dict[str, object], told: str
) -> None:
    chosen = outline(tmp_path, receiver, **seats)
    with pytest.raises(DesignError, match=told):
        sensor_part(chosen, outline_body(chosen))


def test_light_does_not_know_of_seats() -> None:
    assert body_of(seated()).faces == body_of(design()).faces
