"""Forces that hold a load: virtual work, balance, units, and what actuators of limited force can do."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import constraints_on, joints_by_leg, seen_by_legs
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.statics import Load, Material, Section
from tests.conftest import ALL, exhaustive, scaled
from tests.toys import LinearDelta, Planar3RPR

FLAT = Section.rectangle(Material.aluminum(), depth=0.03, width=0.006)
ALL_KINDS = ["navaro_mode_6", "three_prs", "stewart_gough", "tse_prototype", "tri_scott", "navaro_mode_1", "micabo"]


def poses_near_home(robot, count, rng):
    home, d = np.asarray(robot.home()[0]), robot.space.dimension
    reach = np.where(np.arange(d) < robot.space.translations, 0.05 * float(robot.length), 0.1)
    poses = home + reach * rng.uniform(-1, 1, (count, d))
    return jax.vmap(lambda pose: js.constrained_pose(robot, pose).value)(jnp.asarray(poses))


def slanted():
    """Everything off center, and gravity askew, so that it counts in the plane, too."""
    return Load(11.34, [0.02, -0.03, 0.1], 2.0, [-0.01, 0.02, 0.03], gravity=[1.0, -4.0, -9.0])


def potential(robot, load, pose, masses, twist):
    """Of platform, payload and bars, by what the robot draws: the reference for the forces, by another way."""
    position, rotation = robot.space.retract(*robot.space.place(pose), tuple(twist))
    moved = jnp.stack(robot.space.coordinates(position, rotation))
    joints = js.inverse_kinematics(robot, moved).value
    size = len(position.components)
    total = jnp.zeros(())
    for mass, center in ((load.payload, load.payload_center), (load.platform_mass, load.platform_center)):
        place = (position + rotation @ js.Vec(*center[:size])).array()
        total = total - mass * jnp.sum(load.gravity[:size] * place)
    cases = one_by_one(robot.legs(), joints_by_leg(robot, joints), seen_by_legs(robot, position, rotation))
    for (leg, q, attachment), mass in zip(cases, masses, strict=True):
        for (p, r), m in zip(leg.bars(q, attachment), mass, strict=True):
            center = ((p + r) * 0.5).array()
            if isinstance(robot, js.StewartGough):  # a rigid cylinder on the base and a rigid rod on the platform
                along = (attachment - leg.anchor) * (m / FLAT.mass_per_length / 2 / q[0])
                starts = (p - leg.anchor).dot(p - leg.anchor) == 0
                center = jnp.where(starts, (leg.anchor + along).array(), (attachment - along).array())
            total = total - m * jnp.sum(load.gravity[: center.shape[0]] * center)
    return total


@pytest.mark.parametrize("name", ["linear_delta", *exhaustive(*ALL_KINDS)])
def test_forces_do_no_virtual_work(name, rng):
    """f . dq + w . t - dV = 0 along every twist that the robot allows; and the legs carry the platform."""
    robot = ALL[name]()
    load, poses = slanted(), poses_near_home(robot, 4, rng)
    wrenches = jnp.asarray(30 * rng.normal(size=poses.shape))
    home, joints = robot.home()
    seen = seen_by_legs(robot, *robot.space.place(home))
    masses = [
        [np.linalg.norm((q - p).array()) * float(FLAT.mass_per_length) for p, q in leg.bars(own, attachment)]
        for leg, own, attachment in one_by_one(robot.legs(), joints_by_leg(robot, joints), seen)
    ]
    still = jnp.zeros(robot.space.dimension)

    @jax.jit
    @jax.vmap
    def all_of(pose, wrench):
        found = js.statics.actuator_forces(robot, pose, wrench=wrench, load=load, section=FLAT)
        slope = jax.grad(partial(potential, robot, load, pose, masses))(still)
        return found, js.inverse_jacobian(robot, pose, rates="twist"), slope

    @jax.vmap
    def platform(pose):
        position, rotation = robot.space.place(pose)
        bound = jax.jacfwd(lambda t: jnp.array(constraints_on(robot, *robot.space.nudge(position, rotation, tuple(t)))))
        weights = jax.grad(lambda t: load.potential(*robot.space.nudge(position, rotation, tuple(t))))
        return bound(still), weights(still)

    found, jacobians, slopes = all_of(poses, wrenches)
    bounds, weights = platform(poses)
    assert (np.asarray(found.status) == js.Status.CONVERGED).all()
    for force, legs, jacobian, slope, wrench, bound, weight in zip(
        found.value, found.legs, jacobians, slopes, wrenches, bounds, weights, strict=True
    ):
        free = np.linalg.svd(np.vstack([bound, np.zeros((1, len(wrench)))]))[2][bound.shape[0] :]  # allowed twists
        work = free @ (force @ jacobian + wrench - slope)
        size = np.abs(free @ slope).max() + np.abs(wrench).max()
        assert np.abs(work).max() < 1e-12 * size * float(max(1, robot.length))
        rest = free @ (legs.sum(axis=0) + wrench - weight)
        assert np.abs(rest).max() < 1e-12 * size * float(max(1, robot.length))
        if name == "linear_delta":
            assert np.abs(slope).max() > 1, "weights count"


def test_the_same_in_other_units_and_turned_in_the_world():
    robot, turn = js.NavaroII.prototype(mode=6), 0.7
    pose, wrench = jnp.array([46.0, 27.0, 0.2]), jnp.array([3.0, -5.0, 40.0])
    load = slanted()
    plain = js.statics.actuator_forces(robot, pose, wrench=wrench, load=load).value
    plain_stiff = js.statics.stiffness(robot, pose, actuator_stiffness=100.0, wrench=wrench, load=load)
    by = 0.01  # lengths in hundreds, so that forces in kg m / s^2 become that much smaller, moments by its square
    smaller = Load(11.34, load.payload_center * by, 2.0, load.platform_center * by, load.gravity * by)
    units, moments = jnp.array([by, by, 1]), jnp.array([by, by, by**2])
    found = js.statics.actuator_forces(scaled(robot, by), pose * units, wrench=wrench * moments, load=smaller).value
    held = np.where([joint == "theta" for joint in js.navaro.ACTUATION_MODES[6]], by**2, by)
    np.testing.assert_allclose(found, plain * held, rtol=1e-11)
    springs = np.where(held == by, 100.0, 100.0 * by**2)
    stiff = js.statics.stiffness(
        scaled(robot, by), pose * units, actuator_stiffness=springs, wrench=wrench * moments, load=smaller
    )
    np.testing.assert_allclose(stiff.matrix, plain_stiff.matrix * np.outer(moments, 1 / units), rtol=1e-9)

    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    turned = dataclasses.replace(robot, base=robot.base @ rotation.T)
    gravity = np.append(rotation @ np.asarray(load.gravity[:2]), load.gravity[2])
    there = jnp.asarray([*(rotation @ np.asarray(pose[:2])), 0.2 + turn])
    whole = np.block([[rotation, np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]])
    load = dataclasses.replace(load, gravity=gravity)
    found = js.statics.actuator_forces(turned, there, wrench=whole @ wrench, load=load).value
    np.testing.assert_allclose(found, plain, rtol=1e-10)
    stiff = js.statics.stiffness(turned, there, actuator_stiffness=100.0, wrench=whole @ wrench, load=load)
    np.testing.assert_allclose(stiff.matrix, whole @ plain_stiff.matrix @ whole.T, rtol=1e-9, atol=1e-9)


def test_singular_and_impossible_poses_say_so_and_leave_their_neighbors_alone():
    robot = js.NavaroII.prototype(mode=8)
    loose = [45.0, 15 * np.sqrt(3), 0.0]  # similar triangles, not turned
    poses = jnp.array([[45.0, 26.0, 0.3], loose, [np.nan, 0.0, 0.0], [0.0, 0.0, 0.0]])
    poses = poses.at[3].set(jnp.array([15.0, 5 * np.sqrt(3), 0.0]))  # the first leg of no length

    def lanes(robot, poses):
        found = jax.vmap(lambda pose: js.statics.actuator_forces(robot, pose, wrench=jnp.ones(3)))(poses)
        return jnp.sum(jnp.where(found.ok[:, None], found.value, 0)), found

    (_, found), slopes = jax.jit(jax.value_and_grad(lanes, has_aux=True))(robot, poses)
    assert found.status.tolist()[:3] == [js.Status.CONVERGED, js.Status.SINGULAR, js.Status.NONFINITE]
    assert not found.ok[3] and jnp.isnan(found.value[1:]).all() and jnp.isnan(found.legs[1:]).all()
    alone = js.statics.actuator_forces(robot, poses[0], wrench=jnp.ones(3))
    np.testing.assert_allclose(found.value[0], alone.value, rtol=1e-12)
    assert all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(slopes))
    assert float(jnp.abs(slopes.base).max()) > 0
    with pytest.raises(ValueError, match="Got force_limit of shape"):
        js.statics.payload(robot, poses[0], force_limit=[1.0, 2.0])


def test_at_the_greatest_payload_one_actuator_is_at_its_limit(rng):
    """And a little more is too much; a robot that cannot hold itself has a negative one; the horizontal an infinite."""
    robot, limit = LinearDelta.example(), jnp.array([75.0, 80.0, 85.0])
    poses = poses_near_home(robot, 8, rng)
    load = Load(payload=55.0, platform_mass=1.5)

    @jax.jit
    @jax.vmap
    def both(pose, wrench):
        most = js.statics.payload(robot, pose, force_limit=limit, wrench=wrench, load=load, section=FLAT)
        held = dataclasses.replace(load, payload=0 * most)
        shares = [
            js.statics.actuator_forces(
                robot, pose, wrench=wrench, load=dataclasses.replace(held, payload=part * most), section=FLAT
            ).value
            / limit
            for part in (1.0, 1.001)
        ]
        return most, jnp.stack(shares)

    most, shares = both(poses, jnp.asarray(3 * rng.normal(size=poses.shape)))
    assert (np.asarray(most) > 5).all() and len({int(i) for i in jnp.argmax(jnp.abs(shares[:, 0]), axis=1)}) > 1
    np.testing.assert_allclose(jnp.abs(shares[:, 0]).max(axis=1), 1, rtol=1e-12)
    assert (jnp.abs(shares[:, 1]).max(axis=1) > 1).all()
    heavy = js.statics.payload(robot, poses[0], force_limit=limit, load=Load(platform_mass=1000.0))
    light = js.statics.payload(robot, poses[0], force_limit=limit)
    assert float(heavy) == pytest.approx(float(light) - 1000.0, rel=1e-9) and heavy < 0
    navaro = js.NavaroII.prototype()
    assert js.statics.payload(navaro, navaro.home()[0], force_limit=1.0) == jnp.inf
    assert jnp.isnan(js.statics.payload(navaro, navaro.home()[0], force_limit=1.0, wrench=[1e4, 0.0, 0.0]))


def test_corners_and_ellipsoids_are_what_the_actuators_can_do():
    robot = Planar3RPR.example()
    pose, limit = robot.home()[0] + jnp.array([0.05, 0.02, 0.1]), np.array([2.0, 3.0, 5.0])
    load = Load(payload=0.3, payload_center=[0.1, 0.2, 0.0], gravity=[0.0, -9.81, 0.0])
    found = js.statics.force_capability(robot, pose, force_limit=limit, load=load)
    corners = [np.asarray(js.statics.actuator_forces(robot, pose, wrench=w, load=load).value) for w in found.vertices]
    assert {tuple(np.round(corner / limit, 9)) for corner in corners} == {
        (a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)
    }
    jacobian = np.asarray(js.inverse_jacobian(robot, pose, rates="twist"))
    shares = np.linalg.inv(jacobian).T / limit[:, None]
    np.testing.assert_allclose(found.translation, shares[:, :2].T @ shares[:, :2], rtol=1e-10)
    np.testing.assert_allclose(found.translation_radii, 1 / np.linalg.svd(shares[:, :2])[1], rtol=1e-10)
    np.testing.assert_allclose(found.rotation_radii, 1 / np.linalg.norm(shares[:, 2]), rtol=1e-10)
    moving = js.statics.velocity_capability(robot, pose, speed_limit=limit)
    np.testing.assert_allclose(np.abs(moving.vertices @ jacobian.T), np.tile(limit, (8, 1)), rtol=1e-10)
    np.testing.assert_allclose(moving.translation_radii, 1 / np.linalg.svd(jacobian[:, :2] / limit[:, None])[1])
    bound = ALL["three_prs"]()
    with pytest.raises(ValueError, match="pose has constraints"):
        js.statics.velocity_capability(bound, bound.home()[0], speed_limit=1.0)


def test_derivatives_by_the_robot_are_differences_and_float32_stays_so():
    pose, load = jnp.array([0.1, -0.05, 0.02]), slanted()

    def numbers(robot, load, section, pose):
        held = js.statics.actuator_forces(robot, pose, wrench=jnp.ones(3, pose.dtype), load=load, section=section)
        most = js.statics.payload(robot, pose, force_limit=500.0, load=load, section=section)
        return jnp.append(held.value, most), held

    @jax.jit
    def along(step):
        return jax.jvp(lambda s: numbers(LinearDelta(0.5 + 0.3 * s, 1.0 - s), load, FLAT, pose)[0], (step,), (1.0,))

    slope, difference = along(0.0)[1], (along(1e-5)[0] - along(-1e-5)[0]) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7 * np.abs(difference).max())
    single = LinearDelta(jnp.float32(0.5), jnp.float32(1.0))
    values, held = jax.jit(numbers)(single, load, FLAT, pose.astype(jnp.float32))
    assert values.dtype == held.legs.dtype == jnp.float32
    np.testing.assert_allclose(values, along(0.0)[0], rtol=2e-4)
