"""Soft bodies agree with closed forms for blocks, strips, contacts and rotations; invalid inputs are refused."""

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
    """Assert that the forces and moments of all reactions add up to zero."""
    total = np.zeros(3)
    for reaction in deformed.reactions:
        (x, z), (fx, fz) = reaction.about_mm, reaction.force_N
        total += (fx, fz, reaction.moment_Nmm + x * fz - z * fx)
    assert np.abs(total).max() < within_N


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("kind", MODELS)
def test_compressed_block_has_the_closed_form_stretch_of_each_model(kind: str, plane: Plane) -> None:
    """A block on sliding holds under uniform pressure: plane strain is the planar test, plane stress the uniaxial."""
    material = Material(kind, MODELS[kind])
    stretch, width, thickness = 0.8, 2.0, 4.0
    mode = MODES["planar" if plane == "strain" else "uniaxial"]
    stress = float(model(kind).stress(MODELS[kind], mode, np.array([stretch]))[0])
    press = Pull((Stretch("top"),), (0.0, stress * width * thickness))
    soft = SoftBody(block(width, 1.0), material, SYMMETRIC, thickness, plane, MeshOptions(0.5))
    deformed = soft.state([press])
    np.testing.assert_allclose(deformed.walls["top"].displacement_mm[:, 1], stretch - 1.0, atol=1e-7)
    across = 1.0 / stretch if plane == "strain" else stretch**-0.5
    np.testing.assert_allclose(deformed.walls["right"].displacement_mm[:, 0], width * (across - 1.0), atol=1e-7)
    assert deformed.strain_largest == pytest.approx(-math.log(stretch), abs=1e-7)
    assert not deformed.warnings
    assert_balanced(deformed)


def test_compressible_block_follows_hookes_law_at_small_strain() -> None:
    """In plane strain, ε = (1 − ν) σ / 2μ along the pressure and −ν σ / 2μ across it."""
    nu, stress = 0.45, -1e-4
    soft = SoftBody(block(2.0, 1.0), Material.neo_hookean(1.0, nu), SYMMETRIC, 1.0, mesh=MeshOptions(0.5))
    deformed = soft.state([Pull((Stretch("top"),), (0.0, 2.0 * stress))])
    along, across = deformed.walls["top"].displacement_mm[:, 1], deformed.walls["right"].displacement_mm[:, 0] / 2.0
    np.testing.assert_allclose(along, 0.5 * stress * (1.0 - nu), rtol=1e-3)
    np.testing.assert_allclose(across, -0.5 * stress * nu, rtol=1e-3)


@pytest.mark.parametrize(("plane", "young"), [("strain", 4.0), ("stress", 3.0)])
def test_guided_strip_deflects_as_a_timoshenko_beam(plane: Plane, young: float) -> None:
    """Δ = F L³ / 12 E'I + 6 F L / 5 μ A, within 2 %: one end is fixed, the other slides without rotating."""
    length, height, thickness, force = 18.0, 1.5, 2.0, 1e-4
    holds = (fixed("bottom"), Hold((Stretch("top"),), "sliding", name="guide"))
    soft = SoftBody(block(height, length), RUBBER, holds, thickness, plane, MeshOptions(0.5))
    deformed = soft.state([Pull((Stretch("top"),), (force, 0.0))])
    inertia, area = thickness * height**3 / 12.0, thickness * height
    expected = force * length**3 / (12.0 * young * inertia) + 1.2 * force * length / area
    assert deformed.walls["top"].displacement_mm[:, 0].mean() == pytest.approx(expected, rel=0.02)
    assert_balanced(deformed)
    assert "guide pulls" in deformed.warnings[0]  # a support that only pushes would lose contact on one side
    floor = deformed.reactions[0]
    assert floor.force_N[0] == pytest.approx(-force, rel=1e-4)
    assert floor.moment_Nmm == pytest.approx(0.5 * force * length, rel=0.01)


def pressed_block(press: Press, size_mm: float = 1.5) -> Deformed:
    """A block of 12 mm by 8 mm, fixed at the bottom, under a finger."""
    return SoftBody(block(12.0, 8.0), RUBBER, (fixed("bottom"),), 2.0, mesh=MeshOptions(size_mm)).state([press])


def test_finger_on_a_half_space_has_the_hertz_contact() -> None:
    """Half width and pressure of a line contact within 3 %: a² = 4 F R / π E*, p = 2 F / π a, with E* = 4 μ."""
    radius, half = 2.0, 0.12
    line = math.pi * 4.0 * half**2 / (4.0 * radius)  # N per mm
    deformed = pressed_block(Press("top", 6.0, radius, force_N=2.0 * line))
    (contact,) = deformed.contacts
    assert contact.force_N == pytest.approx(2.0 * line, rel=1e-6)
    assert 12.0 * (contact.u_to - contact.u_from) / 2.0 == pytest.approx(
        half, rel=0.1
    )  # resolved to half an element edge
    assert contact.pressure_MPa == pytest.approx(2.0 * line / (math.pi * half), rel=0.03)
    assert_balanced(deformed)
    by_depth = pressed_block(Press("top", 6.0, radius, depth_mm=contact.depth_mm))
    assert by_depth.contacts[0].force_N == pytest.approx(2.0 * line, rel=0.02)


@pytest.mark.evidence
def test_finer_elements_resolve_the_hertz_width() -> None:
    """The half width is also within 3 % of Hertz's if the elements are a fortieth of it."""
    radius, half = 2.0, 0.12
    line = math.pi * 4.0 * half**2 / (4.0 * radius)
    fine = tuple((x, 8.0, half / 40) for x in np.linspace(6.0 - 1.1 * half, 6.0 + 1.1 * half, 30))
    soft = SoftBody(block(12.0, 8.0), RUBBER, (fixed("bottom"),), 2.0, mesh=MeshOptions(0.8, fine))
    (contact,) = soft.state([Press("top", 6.0, radius, force_N=2.0 * line)]).contacts
    assert 12.0 * (contact.u_to - contact.u_from) / 2.0 == pytest.approx(half, rel=0.03)
    assert contact.pressure_MPa == pytest.approx(2.0 * line / (math.pi * half), rel=0.03)


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("solid", [True, False])
def test_clamp_on_all_faces_rotates_the_body_without_strain(solid: bool, plane: Plane) -> None:
    turn = Turn((Stretch("*"),), (0.3, 1.7), 3.0, solid=solid)
    deformed = SoftBody(y_body(), RUBBER, (), 4.0, plane, MeshOptions(2.0)).state([turn])
    for wall in deformed.walls.values():
        goal = np.array([turn.motion.point((x, z)) for x, z in wall.points_mm.tolist()])
        np.testing.assert_allclose(wall.points_mm + wall.displacement_mm, goal, atol=1e-9)
    assert deformed.strain_largest < 1e-8


def test_clamp_alone_rotates_the_body_without_strain_at_large_angles() -> None:
    """The body is otherwise free: it is unstrained, whereas small-strain theory would give strains of 1 − cos."""
    turn = Turn((Stretch("lens"),), (0.0, 1.7), -20.0, name="clamp")
    deformed = SoftBody(y_body(), RUBBER, (), 4.0, mesh=MeshOptions(2.0)).state([turn])
    wall = deformed.walls["outer-left"]
    goal = np.array([turn.motion.point((x, z)) for x, z in wall.points_mm.tolist()])
    np.testing.assert_allclose(wall.points_mm + wall.displacement_mm, goal, atol=1e-6)
    assert deformed.strain_largest < 1e-8
    assert np.abs(deformed.reactions[0].force_N).max() < 1e-8


def test_states_do_not_depend_on_the_states_before() -> None:
    """The reused matrix and the extrapolation change no result; angles of opposite signs are mirror images."""
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


def test_results_converge_as_the_mesh_is_halved() -> None:
    """Walls agree within 1 µm and moments within 0.5 %, since the crotch, where strain is singular, is refined."""
    turn = Turn((Stretch("lens"),), (0.0, 1.7), -3.0, name="clamp")
    moments, moves = [], []
    for size in (1.0, 0.5):
        soft = SoftBody(y_body(), RUBBER, (fixed("receiver-*"),), 4.0, mesh=MeshOptions(size))
        deformed = soft.state([turn])
        moments.append(deformed.reactions[0].moment_Nmm)
        moves.append(deformed.walls["stem-right"].displacement_mm[-1])
    assert moments[0] == pytest.approx(moments[1], rel=5e-3)
    np.testing.assert_allclose(moves[0], moves[1], atol=1e-3)


def test_hinge_turns_freely_and_bears_no_moment() -> None:
    """A strip on two hinges, loaded in the middle: its ends rotate by F L² / 16 E'I, and the hinges bear no moment."""
    length, height, force = 16.0, 1.0, 2e-4
    ends = {"bottom": 0.0, "top": length}
    hinges = tuple(Hold((Stretch(face),), "turning", (0.5 * height, z), name=face) for face, z in ends.items())
    soft = SoftBody(block(height, length), RUBBER, hinges, 1.0, mesh=MeshOptions(0.5))
    deformed = soft.state([Pull((Stretch("right", 7.5, 8.5),), (-force, 0.0))])
    assert deformed.reactions[0].moment_Nmm == pytest.approx(0.0, abs=1e-10)
    bottom = deformed.walls["bottom"]
    motion = Rigid.nearest(bottom.points_mm, bottom.points_mm + bottom.displacement_mm)
    np.testing.assert_allclose(motion.points(bottom.points_mm) - bottom.points_mm, bottom.displacement_mm, atol=1e-9)
    turn = math.asin(motion.sin)
    assert turn == pytest.approx(force * length**2 / (16.0 * 4.0 * height**3 / 12.0), rel=0.02)
    assert_balanced(deformed)


PLATE = block(4.0, 3.0)
FLOOR = (fixed("bottom"),)
FINGER = Press("top", 2.0, 1.0, depth_mm=0.1)


@pytest.mark.parametrize(
    ("holds", "load", "message"),
    [
        ((), FINGER, "no holds.*not supported"),
        (SYMMETRIC[:1], FINGER, r"floor.*shift in the direction \(-?1, "),
        ((Hold((Stretch("bottom"),), "turning", (1.0, 0.5), name="pin"),), FINGER, "pin.*turn about x = 1, z = 0.5"),
        (FLOOR, replace(FINGER, depth_mm=3.5), r"press\.depth_mm.*3\.5.*below 3 mm"),
        (FLOOR, replace(FINGER, at_mm=9.0), r"press\.at_mm.*9.*0 to 4 mm"),
        (FLOOR, replace(FINGER, face="roof"), "press.face.*roof.*bottom, right, top, left"),
        (FLOOR, replace(FINGER, radius_mm=0.0), r"press\.radius_mm.*above 0"),
        (FLOOR, replace(FINGER, force_N=1.0), "depth_mm or force_N"),
        ((fixed("top", "bottom"),), FINGER, r"press; .*supported point, x = .*, z = 3 mm"),
        (FLOOR, replace(FINGER, direction_deg=0.0), r"press\.direction_deg.*top"),
        (FLOOR, Turn((Stretch("bottom"),), (0.0, 0.0), 1.0, name="clamp"), r"hold.*x = .*, z = 0 mm.*clamp"),
        (FLOOR, Turn((Stretch("top", 8.0),), (0.0, 0.0), 1.0, name="clamp"), r"clamp\.from_mm.*8.*4 mm long"),
        (FLOOR, Pull((Stretch("top"),), (0.0, math.inf)), "pull.*inf.*finite"),
        (FLOOR, Pull((Stretch("top"),), (0.0, -200.0)), r"loads.*bears no more than about pull\.force_N"),
        (FLOOR, replace(FINGER, depth_mm=None, force_N=4000.0), r"bears less than about press\.force_N = 125"),
    ],
)
def test_refuses_impossible_supports_and_loads(holds: tuple[Hold, ...], load: Load, message: str) -> None:
    with pytest.raises(DesignError, match=message) as error:
        SoftBody(PLATE, RUBBER, holds, 4.0, mesh=MeshOptions(1.5)).state([load])
    assert "\n" not in str(error.value)


def test_refuses_a_finger_that_lost_contact() -> None:
    """A clamp rotates the top of a column away from a finger at its side."""
    column = block(1.0, 6.0)
    near = ((1.0, 5.0, 0.1),)
    press, turn = Press("right", 5.0, 1.0, depth_mm=0.01), Turn((Stretch("top"),), (0.5, 0.0), 20.0, name="clamp")
    with pytest.raises(DesignError, match=r"press.*lost contact.*x = "):
        SoftBody(column, RUBBER, FLOOR, 4.0, mesh=MeshOptions(1.0, near)).state([press, turn])


def test_refuses_invalid_material_values() -> None:
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


def test_states_refuse_different_loads_and_accept_an_empty_list() -> None:
    soft = SoftBody(PLATE, RUBBER, FLOOR, 4.0)
    assert soft.states([]) == []
    with pytest.raises(DesignError, match="states may differ"):
        soft.states([[FINGER], [replace(FINGER, radius_mm=2.0)]])


def test_motion_of_a_clamp_is_its_rotation() -> None:
    assert Turn((), (1.0, 2.0), 30.0).motion == Rigid.about((1.0, 2.0), 30.0)


def test_contact_forces_on_two_faces_add_up_to_the_fingers_force() -> None:
    roof = polygon(
        {"bottom": (0.0, 0.0), "wall": (3.0, 0.0), "right": (3.0, 2.8), "left": (1.5, 3.0), "end": (0.0, 2.8)}
    )
    deformed = SoftBody(roof, RUBBER, FLOOR, 2.0, mesh=MeshOptions(0.8)).state([Press("left", 0.0, 1.0, 0.2)])
    assert {contact.face for contact in deformed.contacts} == {"right", "left"}
    (force_N,) = [reaction.force_N for reaction in deformed.reactions if reaction.name == "press"]
    assert sum(contact.force_N for contact in deformed.contacts) == pytest.approx(math.hypot(*force_N), rel=0.01)


def test_finger_at_zero_depth_exerts_no_force() -> None:
    deformed = SoftBody(PLATE, RUBBER, FLOOR, 4.0, mesh=MeshOptions(1.5)).state([replace(FINGER, depth_mm=0.0)])
    assert deformed.contacts == ()
    assert deformed.strain_largest < 1e-8


def test_missing_package_error_names_the_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(DesignError, match=r'scikit-fem, which is not installed; pip install "scikit-fem\S+"$'):
        SoftBody(PLATE, RUBBER, FLOOR, 4.0)


@pytest.mark.parametrize(("plane", "fraction"), [("stress", 1 / 2), ("strain", 2 / 3)])
def test_bulge_of_a_bent_strip_is_anticlastic(plane: Plane, fraction: float) -> None:
    """A strip bent by κ bends by ν κ across, which is a bulge of ν κ t²/8, or 4/3 of it in plane strain."""
    length, turn_deg, thickness = 12.0, 2.0, 3.0
    clamps = [
        Turn((Stretch(face),), (0.5, z), sign * turn_deg, name=face)
        for face, z, sign in (("bottom", 0.0, 1.0), ("top", length, -1.0))
    ]
    deformed = SoftBody(block(1.0, length), RUBBER, (), thickness, plane, MeshOptions(0.4)).state(clamps)
    bend = 2.0 * math.radians(turn_deg) / length
    assert deformed.bulge_mm == pytest.approx(fraction * bend * thickness**2 / 8.0, rel=0.1)


def test_strip_bent_by_a_large_dead_load_is_the_elastica() -> None:
    """F L² / E'I = 2 moves the end by 0.4935 L across and 0.1606 L along (Bisshopp & Drucker 1945)."""
    length, height = 24.0, 1.0
    force = 2.0 * 4.0 * height**3 / 12.0 / length**2
    soft = SoftBody(block(height, length), RUBBER, FLOOR, 1.0, mesh=MeshOptions(0.6))
    across, along = soft.state([Pull((Stretch("top"),), (force, 0.0))]).walls["top"].displacement_mm.mean(axis=0)
    assert across == pytest.approx(0.4935 * length, rel=0.01)
    assert along == pytest.approx(-0.1606 * length, rel=0.02)
