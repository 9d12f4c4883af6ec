"""What every robot owes the library, written once and run for each of them."""

import dataclasses
import itertools
from functools import partial

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import actuated_mask, angular_joints, constraints_on, joints_by_leg, joints_together
from jaxscissor.robots._over_legs import one_by_one
from tests.conftest import ALL, as_users, exhaustive
from tests.toys import Planar3RPR

DIFFERENCE = 1e-6
LANES = 8  # of every batch, so that all tests of a robot share their programs
ENDLESS = (js.NavaroII, js.StewartGough, Planar3RPR)  # robots whose legs reach any pose, strokes aside


def forward(robot, joints):
    return js.forward_kinematics(robot, joints).value


def flat(tree):
    """Derivatives of a vector by every number of a tree, side by side."""
    return np.concatenate([np.reshape(leaf, (len(leaf), -1)) for leaf in jax.tree.leaves(tree)], axis=1)


# of module level and with the robot as an argument, so that robots of one shape share their programs
forward_batch = as_users(jax.vmap(js.forward_kinematics, (None, 0)))
inverse_batch = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))
margin_batch = as_users(jax.vmap(lambda robot, pose: js.feasibility(robot, pose).margin, (None, 0)))
forward_mode = jax.jit(jax.jacfwd(forward, (0, 1)))  # by every dimension and by the joints
reverse_mode = jax.jit(jax.jacrev(forward, (0, 1)))


def shaken_joints(robot, rng, size=0.03):
    """Actuated joints near home, which the robot can take."""
    home = np.asarray(robot.actuated(robot.home()[1]))
    turns = [one for one, actuated in zip(angular_joints(robot), actuated_mask(robot), strict=True) if actuated]
    units = np.where(turns, 1.0, float(robot.length))
    return jnp.asarray(home + units * size * rng.uniform(-1, 1, (LANES, len(home))))


def reachable_poses(robot, rng):
    solution = forward_batch(robot, shaken_joints(robot, rng))
    assert bool(solution.converged.all())
    return solution.value


def central_differences(function, at, step=DIFFERENCE):
    columns = [(function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(len(at))]
    return np.stack(columns, axis=-1)


def close(a, b, tol):
    a, b = np.asarray(a), np.asarray(b)
    return np.abs(a - b).max() <= tol * max(1.0, np.abs(b).max())


def test_home_closes_and_is_found_again(robot):
    pose, joints = robot.home()
    assert np.abs(js.residual(robot, pose, joints=joints)).max() < 1e-12
    solution = js.inverse_kinematics(robot, pose)
    assert bool(solution.converged) and close(solution.value, joints, 1e-12)
    assert float(js.feasibility(robot, pose).margin) > 0


def test_shapes_are_those_documented(robot):
    pose, joints = robot.home()
    d, n, m = robot.space.dimension, len(joints), len(robot.actuated(joints))
    rows = js.residual(robot, pose, joints=joints).shape[0]
    assert pose.shape == (d,) and joints.shape == (n,)
    a, b = jax.eval_shape(lambda robot: js.closure_jacobians(robot, pose, joints=joints), robot)
    assert a.shape == (rows, d) and b.shape == (rows, n)
    assert jax.eval_shape(js.inverse_jacobian, robot, pose).shape == (m, d)
    assert jax.eval_shape(js.inverse_kinematics, robot, pose).value.shape == (n,)
    assert jax.eval_shape(js.forward_kinematics, robot, robot.actuated(joints)).value.shape == (d,)
    assert jax.eval_shape(js.feasibility, robot, pose).margin.shape == ()
    assert jax.eval_shape(js.gear_ratios, robot, pose).translation.shape == (robot.space.translations,)


def test_inverse_of_forward_is_identity(robot, rng):
    joints = shaken_joints(robot, rng)
    poses = forward_batch(robot, joints)
    assert bool(poses.converged.all())
    back = inverse_batch(robot, poses.value)
    assert bool(back.converged.all())
    assert close(robot.actuated(back.value), joints, 1e-11)
    assert float(back.residual_norm.max()) < 1e-12


def test_closure_jacobians_are_the_differences_of_the_residual(robot, rng):
    pose = reachable_poses(robot, rng)[0]
    joints = js.inverse_kinematics(robot, pose).value
    a, b = js.closure_jacobians(robot, pose, joints=joints)
    assert close(a, central_differences(lambda p: js.residual(robot, p, joints=joints), pose), 1e-8)
    assert close(b, central_differences(lambda q: js.residual(robot, pose, joints=q), joints), 1e-8)


def test_forward_kinematics_differentiates_alike_in_both_modes_and_by_differences(robot_of_a_kind, rng):
    robot = robot_of_a_kind
    """By every dimension of the robot, and by the joints."""
    joints = shaken_joints(robot, rng)[0]
    one_way, other_way = forward_mode(robot, joints), reverse_mode(robot, joints)
    numbers, rebuild = jax.flatten_util.ravel_pytree(robot)
    differences = (
        central_differences(lambda numbers: forward(rebuild(numbers), joints), numbers),
        central_differences(lambda q: forward(robot, q), joints),
    )
    for one, other, expected, tol in zip(one_way, other_way, differences, (1e-11, 1e-12), strict=True):
        assert close(flat(one), flat(other), tol)
        assert close(flat(one), expected, 1e-7)
        assert np.abs(expected).max() > 0.1


def test_inverse_jacobian_inverts_the_forward_one(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    pose, (_, jacobian) = forward(robot, joints), forward_mode(robot, joints)
    assert close(js.inverse_jacobian(robot, pose) @ jacobian, np.eye(len(joints)), 1e-9)
    rates = robot.space.rates_to_twist(pose)
    assert close(js.inverse_jacobian(robot, pose, rates="twist") @ rates @ jacobian, np.eye(len(joints)), 1e-9)


@jax.jit
@partial(jax.hessian, argnums=1)
def second_derivatives(robot, joints):
    return squares(robot, joints)


@jax.jit
@partial(jax.grad, argnums=1)
def first_derivatives(robot, joints):
    return squares(robot, joints)


def squares(robot, joints):
    return jnp.sum(forward(robot, joints) ** 2)


@pytest.mark.parametrize("name", ["navaro_mode_8", *exhaustive(*(name for name in ALL if name != "navaro_mode_8"))])
def test_second_derivatives_agree_with_differences_of_the_first(name, rng):
    robot = ALL[name]()
    joints = shaken_joints(robot, rng)[0]
    hessian = second_derivatives(robot, joints)
    assert close(hessian, hessian.T, 1e-10)
    assert close(hessian, central_differences(partial(first_derivatives, robot), joints), 1e-5)


def test_jit_equals_eager_and_vmap_equals_a_loop(robot, rng):
    poses = reachable_poses(robot, rng)
    eager = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
    for pose, value, alike in zip(poses, inverse_batch(robot, poses).value, eager.value, strict=True):
        assert close(js.inverse_kinematics(robot, pose).value, value, 1e-13) and close(alike, value, 1e-13)


@jax.jit
@jax.grad
def masked_gradient(robot, poses):
    solution = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
    return jnp.sum(jnp.where(solution.converged[:, None], solution.value, 0))


def test_a_failed_lane_neither_raises_nor_leaks(robot, rng):
    poses = reachable_poses(robot, rng).at[1, 0].add(100 * robot.length).at[2].set(jnp.nan)
    solution = inverse_batch(robot, poses)
    assert solution.status[0] == js.Status.CONVERGED
    endless = isinstance(robot, ENDLESS)
    assert solution.status[1] in ((js.Status.CONVERGED,) if endless else (js.Status.NO_SOLUTION, js.Status.MAX_STEPS))
    assert solution.status[2] == js.Status.NONFINITE
    gradient = masked_gradient(robot, poses)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradient))
    assert js.feasibility(robot, poses[2]).margin == -jnp.inf


def test_float32_stays_float32_and_agrees_with_float64(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    double = robot, forward(robot, joints), joints
    robot, pose, joints = single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), double)
    shapes = [
        jax.eval_shape(function, *single)
        for function in (
            lambda robot, pose, joints: js.inverse_jacobian(robot, pose),
            lambda robot, pose, joints: js.feasibility(robot, pose).margin,
            lambda robot, pose, joints: js.margins(robot, pose),
            lambda robot, pose, joints: js.gear_ratios(robot, pose).translation,
            lambda robot, pose, joints: js.singularities.measures(robot, pose).type1,
            lambda robot, pose, joints: js.forward_kinematics_all(robot, joints).values,
        )
    ]
    assert {leaf.dtype for leaf in jax.tree.leaves(shapes)} == {jnp.dtype(jnp.float32)}
    inverse, ahead = js.inverse_kinematics(robot, pose), js.forward_kinematics(robot, joints)
    assert inverse.value.dtype == ahead.value.dtype == jnp.float32
    assert bool(inverse.converged) and bool(ahead.converged) and inverse.residual_norm < 1e-5
    assert close(inverse.value, js.inverse_kinematics(*double[:2]).value, 2e-3) and close(ahead.value, double[1], 2e-3)


@pytest.mark.parametrize("name", ["navaro_mode_8", *exhaustive(*(name for name in ALL if name != "navaro_mode_8"))])
def test_derivatives_in_float32_agree_with_float64(name, rng):
    robot = ALL[name]()
    joints = shaken_joints(robot, rng)[0]
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), (robot, joints))
    for derivative in (forward_mode, reverse_mode):
        for one, expected in zip(derivative(*single), derivative(robot, joints), strict=True):
            assert {leaf.dtype for leaf in jax.tree.leaves(one)} == {jnp.dtype(jnp.float32)}
            assert close(flat(one), flat(expected), 2e-3)


def test_integers_become_floats(robot):
    whole = js.inverse_kinematics(robot, np.zeros(robot.space.dimension, int)).value
    assert whole.dtype == jnp.result_type(float)


def test_another_design_does_not_trace_again(robot):
    count = 0

    @jax.jit
    def solve(robot, pose):
        nonlocal count
        count += 1
        return js.inverse_kinematics(robot, pose).value

    pose = robot.home()[0]
    for factor in (1.0, 1.001, 1.002):
        solve(jax.tree.map(lambda leaf, f=factor: leaf * jnp.asarray(f, leaf.dtype), robot), pose)
    assert count == 1


def test_wrong_shapes_are_refused_with_what_was_expected(robot):
    d = robot.space.dimension
    with pytest.raises(ValueError, match=rf"shape \({d + 1},\).*expects \({d},\)"):
        js.inverse_kinematics(robot, np.zeros(d + 1))
    with pytest.raises(ValueError, match=r"jax\.vmap"):
        js.inverse_kinematics(robot, np.zeros((2, d)))
    with pytest.raises(ValueError, match="actuated joints of shape"):
        js.forward_kinematics(robot, np.zeros(17))
    with pytest.raises(ValueError, match="joints of shape"):
        js.inverse_kinematics(robot, robot.home()[0], guess=np.zeros(17))


def test_an_empty_batch_gives_an_empty_answer(robot):
    empty = jnp.zeros((0, robot.space.dimension))
    assert jax.vmap(js.inverse_kinematics, (None, 0))(robot, empty).value.shape[0] == 0
    with pytest.raises(ValueError, match="no poses"):
        js.workspace.fraction(robot, empty)


def test_the_margin_is_continuous_and_changes_sign_at_the_boundary(robot, rng):
    home = robot.home()[0]
    margins = partial(margin_batch, robot)
    if constraints_on(robot, *robot.space.place(home)):  # leaves its poses in every direction but its own
        aside = np.asarray(home) + np.linspace(0.001, 1, 50)[:, None] * np.eye(6)[0]
        assert (np.asarray(margins(aside)) < 0).all() and margins(home[None])[0] > 0
        return
    for _ in range(6):
        way = np.zeros(len(home))
        way[: robot.space.translations] = rng.normal(size=robot.space.translations)
        way *= 1.5 * float(robot.length) / np.linalg.norm(way)
        line = np.asarray(margins(np.asarray(home) + np.linspace(0, 1, 4001)[:, None] * way))
        assert line[0] > 0 > line[-1]
        assert np.abs(np.diff(line)).max() < 0.03, "a jump"


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
@partial(jax.grad, argnums=1)
def least_margin_slopes(robot, pose):
    return js.margins(robot, pose).min()


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
@partial(jax.grad, argnums=(0, 1))
def margin_slopes(robot, pose):
    return js.feasibility(robot, pose).margin


def test_the_least_of_all_margins_is_that_of_feasibility(robot, rng):
    poses = reachable_poses(robot, rng)[:4]
    each, margin = jax.vmap(js.margins, (None, 0))(robot, poses), margin_batch(robot, poses)
    names = robot.legs().limits
    assert each.shape == (4, len(robot.actuation()), 1 + len(names or each[0, 0, 1:]))
    np.testing.assert_allclose(each.min(axis=(1, 2)), margin, rtol=1e-12)
    assert close(least_margin_slopes(robot, poses), margin_slopes(robot, poses)[1], 1e-9)


def test_the_table_of_dimensions_names_every_field(robot):
    text = repr(robot)
    assert all(field.name in text for field in dataclasses.fields(robot))


def matrix_of(robot, pose):
    position, rotation = robot.space.place(jnp.asarray(pose))
    turned = jnp.broadcast_to(rotation.array(), (len(position.components),) * 2)
    return np.concatenate([position.array() / robot.length, turned.ravel()])


@jax.jit
@partial(jax.vmap, in_axes=(None, 0))
def all_modes(robot, joints):
    return js.forward_kinematics_all(robot, joints, starts=500)


@pytest.mark.parametrize("name", ["tse_prototype", *exhaustive(*(name for name in ALL if name != "tse_prototype"))])
def test_the_generating_pose_is_among_the_assembly_modes(name, rng):
    robot = ALL[name]()
    joints = shaken_joints(robot, rng)
    poses = forward_batch(robot, joints)
    assert bool(poses.converged.all())
    modes = all_modes(robot, joints)
    for i, pose in enumerate(poses.value[:2]):
        found = [matrix_of(robot, value) for value in modes.values[i][modes.valid[i]]]
        assert len(found) == int(modes.count[i])
        assert min(np.abs(one - matrix_of(robot, pose)).max() for one in found) < 1e-8
        apart = [np.abs(a - b).max() for n, a in enumerate(found) for b in found[:n]]
        assert min(apart, default=1) > 1e-6
        for pose, full in zip(modes.values[i][modes.valid[i]], modes.joints[i][modes.valid[i]], strict=True):
            assert np.abs(js.residual(robot, pose, joints=full)).max() < 1e-10
            assert close(robot.actuated(full), joints[i], 1e-15)
    assert not all_modes(robot, joints.at[0].set(jnp.nan)).valid[0].any()


def test_every_working_mode_closes_and_home_is_among_them(robot):
    pose, joints = robot.home()
    leg, *_ = next(one_by_one(robot.legs()))
    if leg.solutions(robot.attachments(*robot.space.place(pose))[0]) is None:
        with pytest.raises(ValueError, match="does not know all its solutions"):
            js.inverse_kinematics_all(robot, pose)
        return
    modes = js.inverse_kinematics_all(robot, pose)
    values, valid = np.asarray(modes.values), np.asarray(modes.valid)
    for i, home in enumerate(np.stack(joints_by_leg(robot, joints), axis=1)):
        assert np.abs(values[i][valid[i]] - home).max(axis=1).min() < 1e-9 * float(robot.length)
    for choice in itertools.islice(itertools.product(*(one[ok] for one, ok in zip(values, valid, strict=True))), 64):
        together = joints_together(robot, tuple(np.stack(choice, axis=1)))
        assert np.abs(js.residual(robot, pose, joints=together)).max() < 1e-12


def measured(robot, pose):
    measures = js.singularities.measures(robot, js.constrained_pose(robot, pose).value)
    return jnp.append(measures.type1, measures.type2)


measures_slopes = jax.jit(jax.jacfwd(measured, 1))


def test_singularity_measures_are_pure_numbers_and_smooth(robot, rng):
    home, _ = robot.home()
    measures = js.singularities.measures(robot, home)
    assert 0 < np.abs(measures.type1).min() and np.abs(measures.type1).max() <= 1
    assert 0 < abs(float(measures.type2)) <= 1 and 0 < float(measures.type3) <= 2

    pose = reachable_poses(robot, rng)[0]
    assert close(measures_slopes(robot, pose), central_differences(partial(measured, robot), pose), 1e-7)


def test_the_margin_has_a_finite_gradient_at_home(robot):
    """Level and symmetric poses put zeros under square roots."""
    leaves = jax.tree.leaves(margin_slopes(robot, jnp.stack([robot.home()[0]] * 4)))
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in leaves)
    assert max(float(jnp.abs(leaf).max()) for leaf in leaves) > 0
