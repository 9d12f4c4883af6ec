"""What every robot owes the library, written once and run for each of them."""

import dataclasses
import itertools

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.mechanisms._contract import join_joints, legs_of, split_joints
from tests.toys import Planar3RPR

DIFFERENCE = 1e-6
LANES = 8  # of every batch, so that all tests of a robot share their programs
ENDLESS = (js.NavaroII, js.StewartGough, Planar3RPR)  # robots whose legs reach any pose, strokes aside


@jax.jit
def forward(robot, joints):
    return js.forward_kinematics(robot, joints).value


FORWARD_MODE = jax.jit(jax.jacfwd(forward, 1))
REVERSE_MODE = jax.jit(jax.jacrev(forward, 1))
forward_batch = jax.jit(jax.vmap(js.forward_kinematics, (None, 0)))
inverse_batch = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))


def shaken_joints(robot, rng, size=0.03):
    """Actuated joints near home, which the robot can take."""
    home = np.asarray(robot.actuated(robot.home()[1]))
    angular = robot.legs().angular or (False,) * len(robot.actuation()[0])
    units = join_joints(robot, [[1.0 if a else robot.length for a in angular]] * len(robot.actuation()))
    return jnp.asarray(home + np.asarray(robot.actuated(units)) * size * rng.uniform(-1, 1, (LANES, len(home))))


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
    assert np.abs(js.residual(robot, joints, pose)).max() < 1e-12
    solution = js.inverse_kinematics(robot, pose)
    assert bool(solution.converged) and close(solution.value, joints, 1e-12)
    assert float(js.feasibility(robot, pose).margin) > 0


def test_shapes_are_those_documented(robot):
    pose, joints = robot.home()
    d, n, m = robot.space.dimension, len(robot.home()[1]), len(robot.actuated(robot.home()[1]))
    rows = js.residual(robot, joints, pose).shape[0]
    assert pose.shape == (d,) and joints.shape == (n,)
    a, b = js.closure_jacobians(robot, joints, pose)
    assert a.shape == (rows, d) and b.shape == (rows, n)
    assert js.inverse_jacobian(robot, pose).shape == (m, d)
    assert js.inverse_kinematics(robot, pose).value.shape == (n,)
    assert js.forward_kinematics(robot, robot.actuated(joints)).value.shape == (d,)
    assert js.feasibility(robot, pose).margin.shape == ()
    assert js.gear_ratios(robot, pose).translation.shape == (robot.space.translations,)


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
    a, b = js.closure_jacobians(robot, joints, pose)
    assert close(a, central_differences(lambda p: js.residual(robot, joints, p), pose), 1e-8)
    assert close(b, central_differences(lambda q: js.residual(robot, q, pose), joints), 1e-8)


def test_forward_kinematics_differentiates_alike_in_both_modes_and_by_differences(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    one_way, other_way = FORWARD_MODE(robot, joints), REVERSE_MODE(robot, joints)
    assert close(one_way, other_way, 1e-12)
    assert close(one_way, central_differences(lambda q: forward(robot, q), joints), 1e-7)


def test_inverse_jacobian_inverts_the_forward_one(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    pose, jacobian = forward(robot, joints), FORWARD_MODE(robot, joints)
    assert close(js.inverse_jacobian(robot, pose) @ jacobian, np.eye(len(joints)), 1e-9)
    rates = robot.space.rates_to_twist(pose)
    assert close(js.inverse_jacobian(robot, pose, rates="twist") @ rates @ jacobian, np.eye(len(joints)), 1e-9)


def test_every_dimension_has_the_derivative_of_the_differences(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    numbers, rebuild = jax.flatten_util.ravel_pytree(robot)

    @jax.jit
    def solve(numbers):
        return js.forward_kinematics(rebuild(numbers), joints).value

    one_way, other_way = jax.jit(jax.jacfwd(solve))(numbers), jax.jit(jax.jacrev(solve))(numbers)
    assert close(one_way, other_way, 1e-11)
    assert close(one_way, central_differences(solve, numbers), 1e-7)
    assert np.abs(one_way).max() > 0.1


def test_second_derivatives_agree_with_differences_of_the_first(robot, rng):
    joints = shaken_joints(robot, rng)[0]

    def scalar(q):
        return jnp.sum(js.forward_kinematics(robot, q).value ** 2)

    hessian = jax.jit(jax.hessian(scalar))(joints)
    assert close(hessian, hessian.T, 1e-10)
    assert close(hessian, central_differences(jax.jit(jax.grad(scalar)), joints), 1e-5)


def test_jit_equals_eager_and_vmap_equals_a_loop(robot, rng):
    poses = reachable_poses(robot, rng)
    eager = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
    for pose, value, alike in zip(poses, inverse_batch(robot, poses).value, eager.value, strict=True):
        assert close(js.inverse_kinematics(robot, pose).value, value, 1e-13) and close(alike, value, 1e-13)


def test_a_failed_lane_neither_raises_nor_leaks(robot, rng):
    poses = reachable_poses(robot, rng).at[1, 0].add(100 * robot.length).at[2].set(jnp.nan)

    def masked(robot):
        solution = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
        return jnp.sum(jnp.where(solution.converged[:, None], solution.value, 0))

    solution = inverse_batch(robot, poses)
    assert solution.status[0] == js.Status.CONVERGED
    endless = isinstance(robot, ENDLESS)
    assert solution.status[1] in ((js.Status.CONVERGED,) if endless else (js.Status.NO_SOLUTION, js.Status.MAX_STEPS))
    assert solution.status[2] == js.Status.NONFINITE
    gradient = jax.jit(jax.grad(masked))(robot)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradient))
    assert js.feasibility(robot, poses[2]).margin == -jnp.inf


def test_float32_stays_float32_and_agrees_with_float64(robot, rng):
    joints = shaken_joints(robot, rng)[0]
    functions = [
        lambda robot, pose, joints: js.inverse_kinematics(robot, pose).value,
        lambda robot, pose, joints: js.forward_kinematics(robot, joints).value,
        lambda robot, pose, joints: js.inverse_jacobian(robot, pose),
        lambda robot, pose, joints: js.feasibility(robot, pose).margin,
        lambda robot, pose, joints: js.gear_ratios(robot, pose).translation,
        lambda robot, pose, joints: js.singularity(robot, pose).type1,
        lambda robot, pose, joints: FORWARD_MODE(robot, joints),
        lambda robot, pose, joints: REVERSE_MODE(robot, joints),
    ]
    double = (robot, forward(robot, joints), joints)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), double)
    for function in functions:
        value = function(*single)
        assert value.dtype == jnp.float32
        assert close(value, function(*double), 2e-3)
    solution = js.inverse_kinematics(*single[:2])
    assert bool(solution.converged) and solution.residual_norm < 1e-5


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
        js.workspace_fraction(robot, empty)


def test_the_margin_is_continuous_and_changes_sign_at_the_boundary(robot, rng):
    home = robot.home()[0]
    margins = jax.jit(jax.vmap(lambda pose: js.feasibility(robot, pose).margin))
    if robot.constraints(*robot.space.place(home)):  # leaves its poses in every direction but its own
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


def test_the_least_of_all_margins_is_that_of_feasibility(robot, rng):
    poses = reachable_poses(robot, rng)[:4]
    each, margin = jax.vmap(lambda p: (js.margins(robot, p), js.feasibility(robot, p).margin))(poses)
    names = robot.legs().limits
    assert each.shape == (4, len(robot.actuation()), 1 + len(names or each[0, 0, 1:]))
    np.testing.assert_allclose(each.min(axis=(1, 2)), margin, rtol=1e-12)
    slopes = [
        jax.jit(jax.vmap(jax.grad(f)))(poses)
        for f in (lambda p: js.margins(robot, p).min(), lambda p: js.feasibility(robot, p).margin)
    ]
    assert close(*slopes, 1e-9)


def test_the_table_of_dimensions_names_every_field(robot):
    text = repr(robot)
    assert all(field.name in text for field in dataclasses.fields(robot))


def matrix_of(robot, pose):
    position, rotation = robot.space.place(jnp.asarray(pose))
    turned = jnp.broadcast_to(rotation.array(), (len(position.components),) * 2)
    return np.concatenate([position.array() / robot.length, turned.ravel()])


def test_the_generating_pose_is_among_the_assembly_modes(robot, rng):
    joints = shaken_joints(robot, rng)
    poses = forward_batch(robot, joints)
    assert bool(poses.converged.all())
    modes = jax.vmap(lambda q: js.forward_kinematics_all(robot, q, starts=500))(joints)
    for i, pose in enumerate(poses.value[:2]):
        found = [matrix_of(robot, value) for value in modes.values[i][modes.valid[i]]]
        assert len(found) == int(modes.count[i])
        assert min(np.abs(one - matrix_of(robot, pose)).max() for one in found) < 1e-8
        apart = [np.abs(a - b).max() for n, a in enumerate(found) for b in found[:n]]
        assert min(apart, default=1) > 1e-6
        for pose, full in zip(modes.values[i][modes.valid[i]], modes.joints[i][modes.valid[i]], strict=True):
            assert np.abs(js.residual(robot, full, pose)).max() < 1e-10
            assert close(robot.actuated(full), joints[i], 1e-15)
    assert not js.forward_kinematics_all(robot, joints[0] * jnp.nan, starts=500).valid.any()


def test_every_working_mode_closes_and_home_is_among_them(robot):
    pose, joints = robot.home()
    if legs_of(robot)[0].solutions(robot.attachments(*robot.space.place(pose))[0]) is None:
        with pytest.raises(ValueError, match="does not know all its solutions"):
            js.inverse_kinematics_all(robot, pose)
        return
    modes = js.inverse_kinematics_all(robot, pose)
    values, valid = np.asarray(modes.values), np.asarray(modes.valid)
    for i, home in enumerate(split_joints(robot, joints)):
        assert np.abs(values[i][valid[i]] - np.array(home)).max(axis=1).min() < 1e-9 * float(robot.length)
    for choice in itertools.islice(itertools.product(*(one[ok] for one, ok in zip(values, valid, strict=True))), 64):
        assert np.abs(js.residual(robot, join_joints(robot, choice), pose)).max() < 1e-12


def test_singularity_measures_are_pure_numbers_and_smooth(robot, rng):
    home, _ = robot.home()
    measures = js.singularity(robot, home)
    assert 0 < np.abs(measures.type1).min() and np.abs(measures.type1).max() <= 1
    assert 0 < abs(float(measures.type2)) <= 1 and 0 < float(measures.type3) <= 2

    larger = dataclasses.replace(robot)
    for field in dataclasses.fields(robot):
        if field.metadata.get("unit") != "rad" and not field.metadata.get("static"):
            object.__setattr__(larger, field.name, 1000 * getattr(robot, field.name))
    scaled = jnp.where(jnp.arange(len(home)) < robot.space.translations, 1000, 1) * home
    again = js.singularity(larger, scaled)
    assert close(again.type1, measures.type1, 1e-9) and abs(float(again.type2 / measures.type2) - 1) < 1e-9

    pose = reachable_poses(robot, rng)[0]

    @jax.jit
    def both(pose):
        measures = js.singularity(robot, js.constrained_pose(robot, pose).value)
        return jnp.append(measures.type1, measures.type2)

    assert close(jax.jit(jax.jacfwd(both))(pose), central_differences(both, pose), 1e-7)


def test_the_margin_has_a_finite_gradient_at_home(robot):
    """Level and symmetric poses put zeros under square roots."""
    gradient = jax.jit(jax.grad(lambda robot, pose: js.feasibility(robot, pose).margin, (0, 1)))(robot, robot.home()[0])
    leaves = jax.tree.leaves(gradient)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in leaves)
    assert max(float(jnp.abs(leaf).max()) for leaf in leaves) > 0
