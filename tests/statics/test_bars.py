"""Pins and bars of a scissor against a plane frame, and what their giving way does to the platform."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.statics import Load, Material, Section
from jaxscissor.statics._beams import beams_of, combined, compliance_of, greatest
from jaxscissor.statics._bodies import Bodies
from jaxscissor.statics._linkage import linkage_of
from tests.conftest import exhaustive
from tests.statics.frame import Frame
from tests.toys import LinearDelta

FLAT = Section.rectangle(Material.aluminum(), depth=0.03, width=0.006)
DOWN = np.array([0.0, 0.0, -9.81])


def leg_planes(robot, pose):
    """Of every leg of a TSE: origin, axes across and along the scissor, width, and apex: all by its closure alone."""
    joints = np.asarray(js.inverse_kinematics(robot, pose).value).reshape(3, 2)
    position, rotation = (np.asarray(part.array()) for part in robot.space.place(jnp.asarray(pose)))
    planes = []
    for azimuth, (a, b) in zip(np.asarray(robot.azimuths), joints, strict=True):
        outward = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        tangent, eta = np.array([np.sin(azimuth), -np.cos(azimuth), 0]), float(robot.actuator_angle)
        origin = outward * float(robot.actuator_radius)
        foot_a = origin + a * (tangent * np.cos(eta) + outward * np.sin(eta))
        foot_b = origin + b * (-tangent * np.cos(eta) + outward * np.sin(eta))
        apex = position + rotation @ (outward * float(robot.top_radius))
        width = np.linalg.norm(foot_b - foot_a)
        across = (foot_b - foot_a) / width
        up = apex - (foot_a + foot_b) / 2
        planes.append(((foot_a + foot_b) / 2, np.stack([across, up / np.linalg.norm(up)]), width, apex))
    return position, planes


def scissor_frame(halves, width, axial, bending):
    """The TSE's scissor, standing on both feet: bars from the left and from the right by turns."""
    angle = np.arccos(width / (2 * halves[0]))
    c, s = np.cos(angle), np.sin(angle)
    bars, height = [], halves[0] * s
    for lower, upper in itertools.pairwise(halves):
        left = [(-lower * c, height - lower * s), (0, height), (upper * c, height + upper * s)]
        bars += [left, [(-x, y) for x, y in left]]
        height += 2 * upper * s
    last = halves[-1]
    left = [(-last * c, height - last * s), (0, height)]
    bars += [left, [(-x, y) for x, y in left]]
    frame = Frame(bars, axial, bending)
    for foot in (0, 1):
        for component in (0, 1):
            frame.hold(frame.dof(foot, 0, component))
    for first in range(0, len(bars) - 2, 2):
        frame.pin(first, 1, first + 1, 1)
    for first in range(0, len(bars) - 2, 2):
        frame.pin(first, 2, first + 3, 0)
        frame.pin(first + 1, 2, first + 2, 0)
    frame.pin(len(bars) - 2, 1, len(bars) - 1, 1)
    return frame


@pytest.fixture(scope="module", params=exhaustive("two pairs of bars", "three pairs of bars"))
def tilted(request):
    """A TSE off its axis, tilted and turned, with all kinds of loads, and what this room says of its bars."""
    robot = js.TripleScissorExtender.prototype()
    if request.param == "two pairs of bars":
        robot = js.TripleScissorExtender.from_ratios(*robot.ratios, length=robot.length)
    pose, wrench = jnp.array([0.08, 0.1, 0.95, 0.15, -0.1, 0.2]), jnp.array([20.0, -35.0, 10.0, 3.0, 2.0, -4.0])
    load = Load(payload=11.34, payload_center=[0.02, -0.03, 0.1], platform_mass=2.0)
    bending = {"wrench": wrench, "load": load, "section": FLAT}

    @jax.jit
    def all_of(robot, pose):
        found = js.statics.bar_forces(robot, pose, **bending)
        give = js.statics.sag(robot, pose, actuator_stiffness=1e9, **bending)
        return found, give, js.statics.stiffness(robot, pose, actuator_stiffness=1e9, **bending)

    return robot, np.asarray(pose), np.asarray(wrench), load, *all_of(robot, pose)


def test_a_leg_under_every_unit_load_is_a_plane_frame():
    """Pins, and the compliance of the bars by what the leg exerts on the platform and by their own weight."""
    robot = js.TripleScissorExtender.prototype()
    pose = jnp.array([0.08, 0.1, 0.95, 0.15, -0.1, 0.2])
    _, planes = leg_planes(robot, pose)
    _, axes, width, apex = planes[1]
    _, (leg,), _ = one_by_one(robot.legs())
    joints = tuple(js.inverse_kinematics(robot, pose).value[2:4])
    attachment = js.Vec(*map(jnp.asarray, apex))
    halves = np.asarray(robot.link_lengths)
    masses = float(FLAT.mass_per_length) * np.repeat([*(halves[:-1] + halves[1:]), halves[-1]], 2)

    @jax.jit
    def solved(leg, joints, attachment):
        bodies = Bodies(jnp.asarray(masses), jnp.zeros(6))
        linkage, parts = linkage_of(leg, joints, attachment, bodies, jnp.asarray(DOWN))
        beams = beams_of(linkage, parts)
        each = [greatest(combined(beams, load), FLAT) for load in jnp.eye(4)]
        return linkage.forces, linkage.axes, compliance_of(beams, FLAT), each

    forces, own_axes, compliance, each = solved(leg, joints, attachment)
    give = []
    for load in range(4):
        frame = scissor_frame(halves, width, float(FLAT.axial_stiffness), float(FLAT.bending_stiffness))
        top = [frame.dof(4, 1, component) for component in (0, 1)]
        if load < 3:
            frame.loads[top] = -axes[:, load]  # the platform pushes back
        else:
            frame.spread(masses[:, None] * (axes @ DOWN)[None])
        shifts, exerted = frame.solve()
        pins = forces[:, :, load] @ own_axes @ axes.T
        signs = np.where(np.arange(9) < 2, -1, 1)[:, None]  # a multiplier pulls back the first of what it ties
        np.testing.assert_allclose(pins[:-1], signs * exerted.reshape(-1, 2), atol=1e-9)
        give.append(-axes.T @ shifts[top])
        stress = frame.greatest(shifts, float(FLAT.area), 2 * float(FLAT.inertia) / 0.03)
        for found, known in zip(each[load], stress, strict=True):
            known = np.abs(known)[:4]  # the last two bars bend by their own weight alone, between an element's ends
            np.testing.assert_allclose(np.abs(found)[:4], known, rtol=1e-9, atol=1e-9 * known.max())
    np.testing.assert_allclose(compliance[:, :3], give, rtol=1e-9, atol=1e-9 * float(jnp.abs(compliance[:3, :3]).max()))


def test_pins_bars_and_the_give_of_the_platform_are_those_of_a_plane_frame(tilted):
    """Feet fixed, the apex loaded by its share of everything, every bar by its weight in the leg's plane."""
    robot, pose, wrench, load, found, give, stiff = tilted
    position, planes = leg_planes(robot, pose)
    axial, bending = float(FLAT.axial_stiffness), float(FLAT.bending_stiffness)
    halves = np.asarray(robot.link_lengths)
    lengths = np.repeat([*(halves[:-1] + halves[1:]), halves[-1]], 2)
    masses = float(FLAT.mass_per_length) * lengths
    rotation = np.asarray(robot.space.place(jnp.asarray(pose))[1].array())
    total = wrench.copy()
    for mass, center in ((11.34, load.payload_center), (2.0, load.platform_center)):
        arm = rotation @ np.asarray(center)
        total += np.concatenate([mass * DOWN, np.cross(arm, mass * DOWN)])
    # the apices' forces on the platform in the legs' planes, and across them what holds the bars' weight about the feet
    columns, across = [], np.zeros(6)
    for middle, axes, width, apex in planes:
        normal = np.cross(*axes)
        frame = scissor_frame(halves, width, axial, bending)
        centers = np.array([bar[[0, -1]].mean(axis=0) for bar in frame.bars])
        moment = sum(m * (DOWN @ normal) * y for m, y in zip(masses, centers[:, 1], strict=True))
        aside = normal * moment / np.linalg.norm(apex - middle)
        across += np.concatenate([aside, np.cross(apex - position, aside)])
        columns += [np.concatenate([axis, np.cross(apex - position, axis)]) for axis in axes]
    shares = np.linalg.inv(np.stack(columns, axis=1))  # of the legs in what the platform needs
    held = (shares @ -(total + across)).reshape(3, 2)
    twist, compliance = np.zeros(6), np.zeros((6, 6))
    for leg, (_, axes, width, _) in enumerate(planes):
        frame = scissor_frame(halves, width, axial, bending)
        top = [frame.dof(len(lengths) - 2, 1, component) for component in (0, 1)]
        slopes = -shares[2 * leg : 2 * leg + 2]  # of the leg's force on the platform, by the wrench
        frame.loads[top] += -held[leg]
        frame.spread(masses[:, None] * (axes @ DOWN)[None])
        shifts, exerted = frame.solve()
        twist += slopes.T @ -shifts[top]
        pins = np.asarray(found.pins)[leg] @ axes.T
        np.testing.assert_allclose(pins[-1], held[leg], rtol=1e-9)
        # a multiplier acts against its first degree of freedom: of the base on a bar, of the first bar on the second
        signs = np.where(np.arange(len(pins) - 1) < 2, -1, 1)[:, None]
        np.testing.assert_allclose(pins[:-1], signs * exerted.reshape(-1, 2), rtol=1e-9, atol=1e-7)
        most, moments, stress = frame.greatest(shifts, float(FLAT.area), 2 * float(FLAT.inertia) / 0.03)
        np.testing.assert_allclose(found.axial[leg], most, rtol=1e-9)
        whole = slice(0, -2)  # the last two bars bend by their own weight alone, most between the ends of an element
        np.testing.assert_allclose(found.bending[leg][whole], moments[whole], rtol=1e-9)
        np.testing.assert_allclose(found.stress[leg][whole], stress[whole], rtol=1e-9)
        gives = []
        for component in (0, 1):
            frame.loads[:] = 0
            frame.loads[top[component]] = 1
            gives.append(frame.solve()[0][top])
        compliance += slopes.T @ np.array(gives) @ slopes
    np.testing.assert_allclose(give.twist, twist, rtol=1e-3, atol=1e-3 * np.abs(twist).max())
    np.testing.assert_allclose(stiff.compliance, compliance, rtol=1e-3, atol=1e-3 * np.abs(compliance).max())
    np.testing.assert_allclose(stiff.compliance @ stiff.matrix, np.eye(6), atol=1e-8)


@pytest.mark.exhaustive
def test_the_scissors_of_navaro_with_screw_and_guide_are_plane_frames():
    """Without weight, each leg pushes along itself; its compliance adds up as that of springs in the legs."""
    robot = js.NavaroII([[0, 0], [90, 0], [45, 78]], [[-15, -9], [15, -9], [0, 17]], (9.0, 80.0), 8, crosses=3)
    section = Section.rectangle(Material(1e3, 1.0), depth=1.5, width=0.5)
    pose, wrench = jnp.array([42.0, 30.0, 0.2]), jnp.array([8.0, -5.0, 60.0])
    still = {"wrench": wrench, "section": section, "load": Load(gravity=np.zeros(3))}
    found = js.statics.bar_forces(robot, pose, **still)
    stiff = js.statics.stiffness(robot, pose, actuator_stiffness=1e9, **still)
    forces = np.asarray(js.statics.actuator_forces(robot, pose, wrench=wrench).value)
    slopes = -np.linalg.inv(np.asarray(js.inverse_jacobian(robot, pose, rates="twist"))).T  # of the forces, by wrench
    compliance = np.zeros((3, 3))
    bar = np.hypot(9.0, 80.0) / 3
    for leg, rho in enumerate(np.asarray(js.inverse_kinematics(robot, pose).value)[1::2]):
        step = rho / 3
        width = np.sqrt(bar**2 - step**2)
        bars = []  # (along the leg, along the screw)
        for cross in range(3):
            side = [((cross + share) * step, (share - 0.5) * width) for share in (0, 0.5, 1)]
            bars += [side, [(x, -y) for x, y in side]]
        bars += [[(x, y) for y in (-width / 2, 0, width / 2)] for x in (0, rho)]
        frame = Frame(bars, float(section.axial_stiffness), float(section.bending_stiffness))
        for component in range(3):
            frame.hold(frame.dof(6, 1, component))
        frame.pin(6, 0, 0, 0), frame.pin(6, 2, 1, 0)
        for first in (0, 2, 4):
            frame.pin(first, 1, first + 1, 1)
        for first in (0, 2):
            frame.pin(first, 2, first + 3, 0), frame.pin(first + 1, 2, first + 2, 0)
        for first, node in ((4, 2), (5, 0)):
            frame.hold(frame.dof(first, 2, 0), frame.dof(7, node, 0))
        frame.hold(frame.dof(7, 1, 1))
        push = frame.dof(7, 1, 0)
        frame.loads[push] = -forces[leg]
        shifts, _ = frame.solve()
        axial, bending, stress = frame.greatest(shifts, float(section.area), 2 * float(section.inertia) / 1.5)
        np.testing.assert_allclose(np.abs(found.axial[leg]), np.abs(axial), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.bending[leg], bending, rtol=1e-9)
        np.testing.assert_allclose(found.stress[leg], stress, rtol=1e-9)
        compliance += np.outer(slopes[leg], slopes[leg]) * shifts[push] / -forces[leg]
    np.testing.assert_allclose(stiff.compliance, compliance, rtol=1e-5, atol=1e-6 * np.abs(compliance).max())


def test_masses_sections_and_what_is_refused():
    """Round tubes by Steiner's formulas; of a TSE all half-bars twice; per bar different sections add up."""
    tube = Section.tube(Material.steel(), diameter=0.02, wall=0.002)
    assert float(tube.area) == pytest.approx(np.pi * 0.018 * 0.002, rel=1e-12)
    assert float(tube.inertia) == pytest.approx(np.pi / 64 * (0.02**4 - 0.016**4), rel=1e-12)
    rod = Section.tube(Material.steel(), diameter=0.02)
    assert float(rod.mass_per_length) == pytest.approx(7850 * np.pi * 0.01**2, rel=1e-12)
    robot = js.TripleScissorExtender.prototype()
    lengths = np.asarray(robot.link_lengths)
    whole = 3 * 2 * (lengths[0] + 2 * lengths[1:].sum())
    assert float(js.statics.mass(robot, section=FLAT)) == pytest.approx(whole * 2700 * 0.03 * 0.006, rel=1e-12)
    some = Section(Material.aluminum(), [1e-4, 1e-4, 2e-4, 2e-4, 3e-4, 3e-4], 1e-9, 0.01)
    each = 3 * 2 * 2700e-4 * np.dot([1, 2, 3], [*(lengths[:-1] + lengths[1:]), lengths[-1]])
    load = Load(payload=7.0, platform_mass=1.5)
    assert float(js.statics.mass(robot, section=some, load=load)) == pytest.approx(each + 1.5, rel=1e-12)
    delta = LinearDelta.example()
    with pytest.raises(ValueError, match="DeltaLeg without connections"):
        js.statics.bar_forces(delta, delta.home()[0])
    with pytest.raises(ValueError, match="Got a wrench of shape"):
        js.statics.actuator_forces(delta, delta.home()[0], wrench=jnp.zeros(6))
    with pytest.raises(ValueError, match="expected a mass >= 0"):
        Load(payload=-1.0)
    with pytest.raises(ValueError, match="Got gravity of shape"):
        Load(gravity=[0.0, -9.81])
    with pytest.raises(ValueError, match="Got area"):
        Section(Material.steel(), 0.0, 1e-8, 0.01)
