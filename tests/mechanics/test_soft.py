"""Soft bodies against closed forms: blocks, strips, contacts, turns; and what is refused."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from solen.errors import DesignError
from solen.geometry import Body
from solen.material.stiffness import MODES, model
from solen.mechanics import (
    Deformed,
    Hold,
    Load,
    Material,
    MeshOptions,
    Plane,
    Press,
    Pull,
    SoftBody,
    Stretch,
    Turn,
)
from solen.plane import Rigid
from solen.sensor import Sensor
from solen.spec import loads
from tests.mechanics.bodies import block, polygon

RUBBER = Material.neo_hookean(1.0)
MODELS = {
    "neo-hookean": (0.2,),
    "mooney-rivlin": (0.15, 0.04),
    "yeoh": (0.18, -0.004, 0.002),
    "ogden-1": (0.3, 2.4),
    "ogden-2": (0.4, -0.02, 1.6, -3.0),
    "ogden-3": (0.6, 0.001, -0.01, 1.3, 5.0, -2.0),
}
SYMMETRIC = (Hold((Stretch("bottom"),), "sliding", name="floor"), Hold((Stretch("left"),), "sliding", name="side"))
Y = 'schema = 1\nname = "y"\n[material]\nindex = 1.44\n'


def fixed(*faces: str, name: str = "hold") -> Hold:
    return Hold(tuple(Stretch(face) for face in faces), name=name)


def y_body() -> Body:
    return Sensor.of(loads(Y)).body()


def assert_balanced(deformed: Deformed, within_N: float = 2e-6) -> None:
    """Forces and moments of all that touches the body add up to nothing."""
    total = np.zeros(3)
    for one in deformed.reactions:
        (x, z), (fx, fz) = one.about_mm, one.force_N
        total += (fx, fz, one.moment_Nmm + x * fz - z * fx)
    assert np.abs(total).max() < within_N


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("kind", MODELS)
def test_a_compressed_block_by_the_closed_form_of_every_model(kind: str, plane: Plane) -> None:
    """A block on slippery walls under an even pressure: plane strain is the planar test, plane stress the uniaxial."""
    material = Material(kind, MODELS[kind])
    stretch, width, thickness = 0.8, 2.0, 4.0
    mode = MODES["planar" if plane == "strain" else "uniaxial"]
    stress = float(model(kind).stress(MODELS[kind], mode, np.array([stretch]))[0])
    press = Pull((Stretch("top"),), (0.0, stress * width * thickness))
    soft = SoftBody(block(width, 1.0), material, SYMMETRIC, thickness, plane, MeshOptions(0.5))
    found = soft.state([press])
    np.testing.assert_allclose(found.walls["top"].displacement_mm[:, 1], stretch - 1.0, atol=1e-7)
    across = 1.0 / stretch if plane == "strain" else stretch**-0.5
    np.testing.assert_allclose(found.walls["right"].displacement_mm[:, 0], width * (across - 1.0), atol=1e-7)
    assert found.strain_largest == pytest.approx(-math.log(stretch), abs=1e-7)
    assert not found.warnings
    assert_balanced(found)


def test_a_block_that_gives_in_volume_is_hookes_at_small_strain() -> None:
    """Plane strain: ε = (1 − ν) σ / 2μ along the pressure, −ν σ / 2μ across."""
    nu, stress = 0.45, -1e-4
    soft = SoftBody(block(2.0, 1.0), Material.neo_hookean(1.0, nu), SYMMETRIC, 1.0, mesh=MeshOptions(0.5))
    found = soft.state([Pull((Stretch("top"),), (0.0, 2.0 * stress))])
    along, across = found.walls["top"].displacement_mm[:, 1], found.walls["right"].displacement_mm[:, 0] / 2.0
    np.testing.assert_allclose(along, 0.5 * stress * (1.0 - nu), rtol=1e-3)
    np.testing.assert_allclose(across, -0.5 * stress * nu, rtol=1e-3)


@pytest.mark.parametrize(("plane", "young"), [("strain", 4.0), ("stress", 3.0)])
def test_a_guided_strip_is_timoshenkos(plane: Plane, young: float) -> None:
    """Δ = F L³ / 12 E'I + 6 F L / 5 μ A, within 2 %: one end is fixed, the other slides without turning."""
    length, height, thickness, force = 18.0, 1.5, 2.0, 1e-4
    holds = (fixed("bottom"), Hold((Stretch("top"),), "sliding", name="guide"))
    soft = SoftBody(block(height, length), RUBBER, holds, thickness, plane, MeshOptions(0.5))
    found = soft.state([Pull((Stretch("top"),), (force, 0.0))])
    inertia, area = thickness * height**3 / 12.0, thickness * height
    wanted = force * length**3 / (12.0 * young * inertia) + 1.2 * force * length / area
    assert found.walls["top"].displacement_mm[:, 0].mean() == pytest.approx(wanted, rel=0.02)
    assert_balanced(found)
    assert "guide pulls" in found.warnings[0]  # a support that only pushes would let one side go
    floor = found.reactions[0]
    assert floor.force_N[0] == pytest.approx(-force, rel=1e-4)
    assert floor.moment_Nmm == pytest.approx(0.5 * force * length, rel=0.01)


def pressed_ground(press: Press, size_mm: float = 1.5) -> Deformed:
    """A block of 12 mm by 8 mm on a fixed floor, under a finger."""
    return SoftBody(block(12.0, 8.0), RUBBER, (fixed("bottom"),), 2.0, mesh=MeshOptions(size_mm)).state([press])


def test_a_finger_on_a_half_space_is_hertz() -> None:
    """Half width and pressure of a line contact within 3 %: a² = 4 F R / π E*, p = 2 F / π a, with E* = 4 μ."""
    radius, half = 2.0, 0.12
    line = math.pi * 4.0 * half**2 / (4.0 * radius)  # N per mm
    found = pressed_ground(Press("top", 6.0, radius, force_N=2.0 * line))
    (contact,) = found.contacts
    assert contact.force_N == pytest.approx(2.0 * line, rel=1e-6)
    assert 12.0 * (contact.u_to - contact.u_from) / 2.0 == pytest.approx(half, rel=0.1)  # half an element's edge
    assert contact.pressure_MPa == pytest.approx(2.0 * line / (math.pi * half), rel=0.03)
    assert_balanced(found)
    again = pressed_ground(Press("top", 6.0, radius, depth_mm=contact.depth_mm))
    assert again.contacts[0].force_N == pytest.approx(2.0 * line, rel=0.02)


@pytest.mark.evidence
def test_hertz_at_finer_elements() -> None:
    """The half width too within 3 %, by elements of a fortieth of it."""
    radius, half = 2.0, 0.12
    line = math.pi * 4.0 * half**2 / (4.0 * radius)
    fine = tuple((x, 8.0, half / 40) for x in np.linspace(6.0 - 1.1 * half, 6.0 + 1.1 * half, 30))
    soft = SoftBody(block(12.0, 8.0), RUBBER, (fixed("bottom"),), 2.0, mesh=MeshOptions(0.8, fine))
    (contact,) = soft.state([Press("top", 6.0, radius, force_N=2.0 * line)]).contacts
    assert 12.0 * (contact.u_to - contact.u_from) / 2.0 == pytest.approx(half, rel=0.03)
    assert contact.pressure_MPa == pytest.approx(2.0 * line / (math.pi * half), rel=0.03)


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("solid", [True, False])
def test_a_body_turned_as_a_whole_is_the_turned_body(solid: bool, plane: Plane) -> None:
    turn = Turn((Stretch("*"),), (0.3, 1.7), 3.0, solid=solid)
    found = SoftBody(y_body(), RUBBER, (), 4.0, plane, MeshOptions(2.0)).state([turn])
    for wall in found.walls.values():
        goal = np.array([turn.motion.point((x, z)) for x, z in wall.points_mm.tolist()])
        np.testing.assert_allclose(wall.points_mm + wall.displacement_mm, goal, atol=1e-9)
    assert found.strain_largest < 1e-8


def test_a_clamp_alone_carries_the_body_along_however_far_it_turns() -> None:
    """Nothing else holds it: no strain, where small strains would swell by 1 − cos."""
    turn = Turn((Stretch("lens"),), (0.0, 1.7), -20.0, name="clamp")
    found = SoftBody(y_body(), RUBBER, (), 4.0, mesh=MeshOptions(2.0)).state([turn])
    wall = found.walls["outer-left"]
    goal = np.array([turn.motion.point((x, z)) for x, z in wall.points_mm.tolist()])
    np.testing.assert_allclose(wall.points_mm + wall.displacement_mm, goal, atol=1e-6)
    assert found.strain_largest < 1e-8
    assert np.abs(found.reactions[0].force_N).max() < 1e-8


def test_states_on_the_way_are_those_from_rest() -> None:
    """A kept matrix and extrapolation change nothing; angles of opposite signs are mirror images."""
    soft = SoftBody(y_body(), RUBBER, (fixed("receiver-*"),), 4.0, mesh=MeshOptions(1.5))
    lens = Turn((Stretch("lens"),), (0.0, 1.7), 0.0, name="clamp")
    angles = [-3.0, -1.0, 0.0, 1.0, 2.0, 3.0]
    states = soft.states([[replace(lens, angle_deg=angle)] for angle in angles])
    alone = soft.state([replace(lens, angle_deg=2.0)])
    for name, wall in alone.walls.items():
        np.testing.assert_allclose(wall.displacement_mm, states[4].walls[name].displacement_mm, atol=2e-8)
    left, right = states[0].reactions[0], states[5].reactions[0]
    assert left.moment_Nmm == pytest.approx(-right.moment_Nmm, rel=1e-3)
    assert np.abs([states[2].reactions[0].force_N]).max() < 1e-9
    assert_balanced(states[5])


def test_halving_the_mesh_changes_little() -> None:
    """0.4 µm and 0.2 %: elements are refined at the crotch, where strain is singular; 1.4 µm where they are not."""
    turn = Turn((Stretch("lens"),), (0.0, 1.7), -3.0, name="clamp")
    moments, moves = [], []
    for size in (1.0, 0.5):
        soft = SoftBody(y_body(), RUBBER, (fixed("receiver-*"),), 4.0, mesh=MeshOptions(size))
        found = soft.state([turn])
        moments.append(found.reactions[0].moment_Nmm)
        moves.append(found.walls["stem-right"].displacement_mm[-1])
    assert moments[0] == pytest.approx(moments[1], rel=5e-3)
    np.testing.assert_allclose(moves[0], moves[1], atol=1e-3)


def test_a_hinge_turns_freely_and_bears_no_moment() -> None:
    """A strip on two hinges bends in a half wave: F L³ / 48 E'I and the shear's share, and its ends turn."""
    length, height, force = 16.0, 1.0, 2e-4
    ends = {"bottom": 0.0, "top": length}
    hinges = tuple(Hold((Stretch(face),), "turning", (0.5 * height, z), name=face) for face, z in ends.items())
    soft = SoftBody(block(height, length), RUBBER, hinges, 1.0, mesh=MeshOptions(0.5))
    found = soft.state([Pull((Stretch("right", 7.5, 8.5),), (-force, 0.0))])
    assert found.reactions[0].moment_Nmm == pytest.approx(0.0, abs=1e-10)
    bottom = found.walls["bottom"]
    motion = Rigid.nearest(bottom.points_mm, bottom.points_mm + bottom.displacement_mm)
    np.testing.assert_allclose(motion.points(bottom.points_mm) - bottom.points_mm, bottom.displacement_mm, atol=1e-9)
    turn = math.asin(motion.sin)
    assert turn == pytest.approx(force * length**2 / (16.0 * 4.0 * height**3 / 12.0), rel=0.02)
    assert_balanced(found)


PLATE = block(4.0, 3.0)
FLOOR = (fixed("bottom"),)
FINGER = Press("top", 2.0, 1.0, depth_mm=0.1)


@pytest.mark.parametrize(
    ("holds", "load", "named"),
    [
        ((), FINGER, "no holds.*nothing holds it"),
        (SYMMETRIC[:1], FINGER, r"floor.*shift in the direction \(-?1, "),
        ((Hold((Stretch("bottom"),), "turning", (1.0, 0.5), name="pin"),), FINGER, "pin.*turn about x = 1, z = 0.5"),
        (FLOOR, replace(FINGER, depth_mm=3.5), r"press\.depth_mm.*3\.5.*below 3 mm"),
        (FLOOR, replace(FINGER, at_mm=9.0), r"press\.at_mm.*9.*0 to 4 mm"),
        (FLOOR, replace(FINGER, face="roof"), "press.face.*roof.*bottom, right, top, left"),
        (FLOOR, replace(FINGER, radius_mm=0.0), r"press\.radius_mm.*above 0"),
        (FLOOR, replace(FINGER, force_N=1.0), "depth_mm or force_N"),
        ((fixed("top", "bottom"),), FINGER, r"press; runs into a held point, x = .*, z = 3 mm"),
        (FLOOR, replace(FINGER, direction_deg=0.0), r"press\.direction_deg.*top"),
        (FLOOR, Turn((Stretch("bottom"),), (0.0, 0.0), 1.0, name="clamp"), "hold.*clamp holds the same place"),
        (FLOOR, Turn((Stretch("top", 8.0),), (0.0, 0.0), 1.0, name="clamp"), r"clamp\.from_mm.*8.*4 mm long"),
        (FLOOR, Pull((Stretch("top"),), (0.0, math.inf)), "pull.*inf.*finite"),
        (FLOOR, Pull((Stretch("top"),), (0.0, -200.0)), r"loads.*bears no more than about pull\.force_N"),
        (FLOOR, replace(FINGER, depth_mm=None, force_N=4000.0), r"bears less than about press\.force_N = 125"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(holds: tuple[Hold, ...], load: Load, named: str) -> None:
    with pytest.raises(DesignError, match=named) as refused:
        SoftBody(PLATE, RUBBER, holds, 4.0, mesh=MeshOptions(1.5)).state([load])
    assert "\n" not in str(refused.value)


def test_a_finger_that_touches_nothing_any_more_is_refused() -> None:
    """A clamp turns the block's top away from a finger that stands at its corner."""
    column = block(1.0, 6.0)
    near = ((1.0, 5.0, 0.1),)
    press, turn = Press("right", 5.0, 1.0, depth_mm=0.01), Turn((Stretch("top"),), (0.5, 0.0), 20.0, name="clamp")
    with pytest.raises(DesignError, match=r"press.*contact lost.*x = "):
        SoftBody(column, RUBBER, FLOOR, 4.0, mesh=MeshOptions(1.0, near)).state([press, turn])


def test_numbers_of_a_material_that_cannot_be_are_refused() -> None:
    with pytest.raises(DesignError, match=r"poisson.*0\.3"):
        Material.neo_hookean(1.0, 0.3)
    with pytest.raises(DesignError, match="shear_modulus"):
        Material.neo_hookean(-1.0)
    with pytest.raises(DesignError, match="parameters"):
        Material("yeoh", (1.0,))
    with pytest.raises(DesignError, match=r"poisson.*plane stress"):
        SoftBody(PLATE, Material.neo_hookean(1.0, 0.49), FLOOR, 4.0, "stress")
    with pytest.raises(DesignError, match="thickness"):
        SoftBody(PLATE, RUBBER, FLOOR, 0.0)


def test_states_of_other_loads_are_refused_and_none_are_none() -> None:
    soft = SoftBody(PLATE, RUBBER, FLOOR, 4.0)
    assert soft.states([]) == []
    with pytest.raises(DesignError, match="states may differ"):
        soft.states([[FINGER], [replace(FINGER, radius_mm=2.0)]])


def test_a_clamp_says_how_what_is_fixed_to_it_moves() -> None:
    assert Turn((), (1.0, 2.0), 30.0).motion == Rigid.about((1.0, 2.0), 30.0)


def test_a_finger_on_a_corner_touches_two_faces_and_its_force_counts_once() -> None:
    roof = polygon(
        {"bottom": (0.0, 0.0), "wall": (3.0, 0.0), "right": (3.0, 2.8), "left": (1.5, 3.0), "end": (0.0, 2.8)}
    )
    found = SoftBody(roof, RUBBER, FLOOR, 2.0, mesh=MeshOptions(0.8)).state([Press("left", 0.0, 1.0, 0.2)])
    assert {contact.face for contact in found.contacts} == {"right", "left"}
    (pushed,) = [one.force_N for one in found.reactions if one.name == "press"]
    assert sum(contact.force_N for contact in found.contacts) == pytest.approx(math.hypot(*pushed), rel=0.01)


def test_a_finger_that_just_touches_presses_nothing() -> None:
    found = SoftBody(PLATE, RUBBER, FLOOR, 4.0, mesh=MeshOptions(1.5)).state([replace(FINGER, depth_mm=0.0)])
    assert found.contacts == ()
    assert found.strain_largest < 1e-8


def test_without_the_extra_the_command_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(DesignError, match=r'scikit-fem, which is not installed; pip install "scikit-fem\S+"$'):
        SoftBody(PLATE, RUBBER, FLOOR, 4.0)


@pytest.mark.parametrize(("plane", "share"), [("stress", 1 / 2), ("strain", 2 / 3)])
def test_walls_of_a_bent_strip_bulge_as_a_saddle(plane: Plane, share: float) -> None:
    """A strip bent by κ takes ν κ across (anticlastic), ν κ t²/8 over its thickness; plane strain says a third more."""
    length, turn_deg, thickness = 12.0, 2.0, 3.0
    clamps = [
        Turn((Stretch(face),), (0.5, z), sign * turn_deg, name=face)
        for face, z, sign in (("bottom", 0.0, 1.0), ("top", length, -1.0))
    ]
    found = SoftBody(block(1.0, length), RUBBER, (), thickness, plane, MeshOptions(0.4)).state(clamps)
    bend = 2.0 * math.radians(turn_deg) / length
    assert found.bulge_mm == pytest.approx(share * bend * thickness**2 / 8.0, rel=0.1)


def test_a_strip_bent_far_by_a_dead_force_is_the_elastica() -> None:
    """F L² / E'I = 2 moves the end by 0.4935 L across and 0.1606 L along (Bisshopp & Drucker 1945)."""
    length, height = 24.0, 1.0
    force = 2.0 * 4.0 * height**3 / 12.0 / length**2
    soft = SoftBody(block(height, length), RUBBER, FLOOR, 1.0, mesh=MeshOptions(0.6))
    across, along = soft.state([Pull((Stretch("top"),), (force, 0.0))]).walls["top"].displacement_mm.mean(axis=0)
    assert across == pytest.approx(0.4935 * length, rel=0.01)
    assert along == pytest.approx(-0.1606 * length, rel=0.02)
