"""Pose errors against other people's solvers, against differences, and against robots drawn at random."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

import jaxscissor as js
from tests.conftest import exhaustive
from tests.kinematics.test_contract import close
from tests.toys import LinearDelta, Planar3RPR, ThreePRS

SENSITIVITY = jax.jit(js.design.pose_sensitivity)
TILTED = np.array([0.05, -0.03, 0.1, 0.1, -0.15, 0.1])


def matrix(pose):
    return Rotation.from_euler("XYZ", pose[3:]).as_matrix()


def tse_closure(pose, slides, links, angle, radius, top, azimuth):
    """The two closure equations of a scissor leg, after facts of [RAL17 eqs. 10 and 13], written anew."""
    outward, tangent = np.array([np.cos(azimuth), np.sin(azimuth), 0]), np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    a, b = (
        outward * radius + s * (side * np.cos(angle) * tangent + np.sin(angle) * outward)
        for s, side in zip(slides, (1, -1), strict=True)
    )
    apex = pose[:3] + matrix(pose) @ (top * np.array([np.cos(azimuth), np.sin(azimuth), 0]))
    up, across, length = apex - (a + b) / 2, a - b, links[0] + 2 * sum(links[1:])
    return [up @ across, up @ up / length**2 + across @ across / (4 * links[0] ** 2) - 1]


def twist(pose, other):
    turn = Rotation.from_matrix(matrix(other) @ matrix(pose).T).as_rotvec()
    return np.concatenate([other[:3] - pose[:3], turn])


def differences(closure, pose, numbers, step=1e-5):
    """Twist by each number, by central differences of scipy's solutions."""
    columns = []
    for e in np.eye(len(numbers)) * step:
        ends = [fsolve(lambda p, n=numbers + s * e: closure(p, n), pose, xtol=1e-13) for s in (1, -1)]
        columns.append((twist(pose, ends[0]) - twist(pose, ends[1])) / (2 * step))
    return np.stack(columns, axis=-1)


def test_sensitivity_of_the_triple_scissor_is_that_of_scipys_solutions(prototype):
    pose = np.asarray(prototype.home()[0]) + TILTED
    slides = np.asarray(js.inverse_kinematics(prototype, pose).value).reshape(3, 2)
    names = ("link_lengths", "actuator_angle", "actuator_radius", "top_radius")
    own = [np.ravel(getattr(prototype, name)) for name in names]
    azimuths = np.asarray(prototype.azimuths)
    dims = np.tile(np.concatenate(own), (3, 1))

    def closure(p, numbers):
        legs = zip(slides, numbers.reshape(3, -1), azimuths, strict=True)
        return np.concatenate([tse_closure(p, s, n[:3], *n[3:], azimuth) for s, n, azimuth in legs])

    expected = differences(closure, pose, dims.ravel()).reshape(6, 3, -1)
    found = SENSITIVITY(prototype, pose)
    ours = np.concatenate([np.reshape(getattr(found, name), (6, 3, -1)) for name in names], axis=-1)
    assert close(ours, expected, 1e-6) and np.abs(expected).min(axis=(0, 1)).max() > 0.01


def test_sensitivity_of_the_hexapod_is_that_of_scipys_solutions():
    robot = js.StewartGough.prototype()
    pose = np.asarray(robot.home()[0]) + TILTED
    lengths = np.asarray(js.inverse_kinematics(robot, pose).value)

    def closure(p, numbers):
        base, platform = numbers.reshape(2, 6, 3)
        return np.linalg.norm(p[:3] + platform @ matrix(p).T - base, axis=1) - lengths

    numbers = np.concatenate([np.ravel(robot.base), np.ravel(robot.platform)])
    expected = differences(closure, pose, numbers).reshape(6, 2, 6, 3)
    found = SENSITIVITY(robot, pose)
    for k, own in enumerate((found.base, found.platform)):  # (d, legs, 6, 3): leg i has base and platform joint i
        assert close(np.stack([own[:, i, i] for i in range(6)], axis=1), expected[:, k], 1e-6)
        assert all(np.abs(own[:, i, j]).max() < 1e-13 for i in range(6) for j in range(6) if i != j)
    assert (found.stroke == 0).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [Planar3RPR.example, LinearDelta.example, *exhaustive(ThreePRS.example)])
def test_legs_that_err_alike_err_as_the_robot_does(make):
    """Summed over the legs, the sensitivity is the derivative of forward kinematics by the shared dimension."""
    robot = make()
    joints = robot.actuated(robot.home()[1])
    joints = joints * (1 + 0.05 * np.sin(np.arange(len(joints))))
    pose = js.forward_kinematics(robot, joints).value
    rates = robot.space.rates_to_twist(pose)
    by_dimension, by_joints = jax.jit(jax.jacrev(lambda *at: js.forward_kinematics(*at, guess=pose).value, (0, 1)))(
        robot, joints
    )
    found = SENSITIVITY(robot, pose)
    for shared, own in zip(jax.tree.leaves(by_dimension), jax.tree.leaves(found), strict=True):
        assert close(jnp.sum(own, axis=1), jnp.tensordot(rates, shared, 1), 1e-9)
    spread = np.linspace(1e-4, 2e-4, len(joints))
    covariance = js.design.pose_error(robot, pose, js.design.tolerances(robot), joints=spread).covariance
    columns = np.asarray(rates @ by_joints) * spread
    assert np.abs(covariance - columns @ columns.T).max() < 1e-10 * np.abs(covariance).max()


CASES = {
    "tse": (
        js.TripleScissorExtender.prototype,
        TILTED,
        ("link_lengths", "actuator_radius", "top_radius"),
        ("actuator_angle",),
    ),
    "navaro": (lambda: js.NavaroII.prototype(6), [3.0, -2.0, 0.1], ("base", "platform"), ()),
    "tri_scott": (js.TriScott.prototype, TILTED / 2, ("masts", "link_lengths", "platform", "crank_lengths"), ()),
    "hexapod": (js.StewartGough.prototype, TILTED, ("base", "platform"), ()),
}


@pytest.mark.parametrize("name", ["navaro", *exhaustive("hexapod", "tse", "tri_scott")])
def test_first_order_is_what_robots_drawn_at_random_do(name):
    make, aside, lengths, angles = CASES[name]
    robot = make()
    pose = robot.home()[0] + jnp.asarray(aside)
    small = 1e-4 * float(robot.length)
    made = js.design.tolerances(robot, **dict.fromkeys(lengths, small), **dict.fromkeys(angles, 1e-4))
    error = js.design.pose_error(robot, pose, made, joints=small / 2)
    drawn = js.design.sample_pose_errors(robot, pose, made, jax.random.key(1), 12_000, joints=small / 2)
    assert (drawn.status == js.Status.CONVERGED).all()
    errors, linear = np.asarray(drawn.errors), robot.space.translations
    sampled = errors.T @ errors / len(errors)
    assert np.abs(np.diag(sampled) / np.diag(error.covariance) - 1).max() < 0.05
    deviations = np.sqrt(np.diag(sampled))
    assert np.abs((sampled - error.covariance) / np.outer(deviations, deviations)).max() < 0.05
    assert abs(np.sqrt(np.sum(errors[:, :linear] ** 2) / len(errors)) / error.translation - 1) < 0.03
    assert abs(np.sqrt(np.sum(errors[:, linear:] ** 2) / len(errors)) / error.rotation - 1) < 0.03


def test_error_follows_the_design_and_the_pose(prototype):
    made = js.design.tolerances(prototype, link_lengths=1e-3, top_radius=1e-3)
    pose = prototype.home()[0] + TILTED

    @jax.jit
    def error(robot, pose):
        found = js.design.pose_error(robot, pose, made)
        return found.translation + found.rotation

    by_robot, by_pose = jax.jit(jax.grad(error, (0, 1)))(prototype, pose)
    assert all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(by_robot))
    step = 1e-5
    for j, e in enumerate(np.eye(6) * step):
        assert abs(by_pose[j] - (error(prototype, pose + e) - error(prototype, pose - e)) / (2 * step)) < 1e-7

    def with_top(change):
        return js.TripleScissorExtender(
            prototype.link_lengths,
            prototype.actuator_angle,
            prototype.actuator_radius,
            prototype.top_radius + change,
            scissor_angle=prototype.scissor_angle,
        )

    slope = (error(with_top(step), pose) - error(with_top(-step), pose)) / (2 * step)
    assert abs(by_robot.top_radius - slope) < 1e-7 and abs(slope) > 1e-4


def test_poses_that_are_not_reached_or_singular_are_nan_and_leak_nothing():
    robot = js.NavaroII.prototype(8)
    made = js.design.tolerances(robot, base=0.1)
    poses = jnp.array([[45.0, 26.0, 0.4], [45.0, 15 * np.sqrt(3), 0.0], [jnp.nan, 0.0, 0.0]])  # in order, loose, nan
    assert np.isnan(jax.jit(jax.vmap(js.design.pose_sensitivity, (None, 0)))(robot, poses).base[1:]).all()

    def total(robot, poses):
        errors = jax.vmap(lambda pose: js.design.pose_error(robot, pose, made).translation)(poses)
        return jnp.nansum(errors), errors

    slope = jax.jit(jax.grad(total, has_aux=True))
    found, errors = slope(robot, poses)
    assert np.isfinite(errors).tolist() == [True, False, False]
    alone, _ = slope(robot, jnp.stack([poses[0]] * 3))
    for whole, three in zip(jax.tree.leaves(found), jax.tree.leaves(alone), strict=True):
        assert close(whole, three / 3, 1e-12)


@pytest.mark.exhaustive
def test_unreached_poses_and_wild_tolerances_are_statuses(prototype):
    made = js.design.tolerances(prototype, link_lengths=1e-4)
    high = prototype.home()[0].at[2].set(5.0)
    drawn = js.design.sample_pose_errors(prototype, high, made, jax.random.key(0), 4099)
    assert (drawn.status == js.inverse_kinematics(prototype, high).status).all() and np.isnan(drawn.errors).all()
    assert np.isnan(js.design.pose_error(prototype, high, made).covariance).all()

    wild = js.design.tolerances(prototype, link_lengths=0.3)
    drawn = js.design.sample_pose_errors(prototype, prototype.home()[0], wild, jax.random.key(0), 4099)
    failed = drawn.status != js.Status.CONVERGED
    assert drawn.errors.shape == (4099, 6) and 0.05 < failed.mean() < 1
    assert (np.isnan(drawn.errors).all(axis=1) == failed).all()


def test_nothing_given_is_exact_and_infinity_too(prototype):
    assert jnp.isinf(prototype.stroke[1])
    pose = prototype.home()[0]
    error = js.design.pose_error(prototype, pose, js.design.tolerances(prototype))
    assert (error.covariance == 0).all() and error.translation == 0
    drawn = js.design.sample_pose_errors(prototype, pose, js.design.tolerances(prototype), jax.random.key(3), 4099)
    assert np.abs(drawn.errors).max() < 1e-13


def test_tolerances_are_checked(prototype):
    made = js.design.tolerances(prototype, top_radius=[1e-4, 2e-4, 3e-4], link_lengths=[[1e-4], [0.0], [0.0]])
    assert made.link_lengths[1:].max() == 0 and made.link_lengths[0].tolist() == [1e-4] * 3
    with pytest.raises(ValueError, match="Got 'size'"):
        js.design.tolerances(prototype, size=1.0)
    with pytest.raises(ValueError, match="structure"):
        js.design.pose_error(prototype, prototype.home()[0], 1e-4)
    with pytest.raises(ValueError, match=r"joints of shape \(5,\).*\(6,\)"):
        js.design.pose_error(prototype, prototype.home()[0], made, joints=np.ones(5))
    with pytest.raises(ValueError, match="tolerance of shape"):
        js.design.pose_error(prototype, prototype.home()[0], jax.tree.map(lambda leaf: jnp.ones(7), prototype))
    with pytest.raises(ValueError, match="samples=0"):
        js.design.sample_pose_errors(prototype, prototype.home()[0], made, jax.random.key(0), 0)


@pytest.mark.parametrize("angle", [1e-9, 1e-4, 0.3, 1.5, 2.0, 3.0])
def test_the_way_between_two_poses_undoes_a_step(angle, rng):
    pose = jnp.asarray(rng.uniform(-1, 1, 6))
    axis = rng.normal(size=3)
    turn = angle * axis / np.linalg.norm(axis)
    start = js.SE3.place(pose)
    found = js.SE3.between(start, js.SE3.retract(*start, [0.1, -0.2, 0.3, *turn]))
    assert close(found[:3], [0.1, -0.2, 0.3], 1e-14) and np.abs(found[3:] - turn).max() < 1e-14 + 1e-13 * angle
    flat = js.SE2.place(pose[:3])
    assert close(js.SE2.between(flat, js.SE2.retract(*flat, [0.1, 0.2, -angle])), [0.1, 0.2, -angle], 1e-14)
