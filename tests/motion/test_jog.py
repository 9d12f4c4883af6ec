"""Jogging against the paper's experiment, and against jogging written out for a linear delta."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import exhaustive
from tests.motion.oracles import jacobian, position, slides
from tests.toys import LinearDelta, Planar3RPR

JOG = 0.00635  # [ICRA16 VI]
HEIGHT = 1.17316
JOGS = 64
START = np.array([0.05, -0.02, 0.0])


WAY = 8 * JOG * np.array([0.6, 0.0, 0.8, 0.0, 0.0, 0.0])
COUNTS = np.array([4, 8, 16, 32, 64])


def ends(control, noise=None):
    """Errors ``(COUNTS, JOGS + 1)`` in metres of the laboratory robot along the way from the paper's central pose.

    After the jogs come pauses, so that all numbers of jogs share one program.
    """
    robot, start = js.TripleScissorExtender.laboratory(), np.array([0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0])
    errors = []
    for count in COUNTS:
        jogs = np.where(np.arange(JOGS)[:, None] < count, WAY / count, 0.0)
        found = js.motion.jog(robot, start, jogs, control=control, noise=noise)
        assert found.ok.all()
        np.testing.assert_allclose(found.commanded[-1], start + WAY, atol=1e-12)
        errors.append(np.linalg.norm((found.poses - found.commanded)[:, :3], axis=1))
    return np.stack(errors)


def test_plain_jogging_of_the_paper_errs_by_the_first_order_of_the_step():
    error = ends("open")[:, -1]
    slopes = np.diff(np.log(error)) / -np.diff(np.log(COUNTS))
    np.testing.assert_allclose(slopes, 1.0, atol=0.1)
    assert abs(slopes[-1] - 1) < 0.01, "and the more so the smaller the step"
    assert 1e-4 < error[1] < 1e-3, "a fraction of a millimetre at the paper's step"


def test_corrected_integration_does_not_drift():
    assert ends("corrected").max() < 1e-9


def test_a_closed_loop_errs_by_one_measurement_and_one_jog_and_no_more(rng):
    noise = np.zeros((JOGS, 6))
    noise[:, :3] = rng.normal(0, 1e-4, (JOGS, 3))
    error = ends("closed", noise)
    worst = np.linalg.norm(noise, axis=1).max()
    step = np.linalg.norm(WAY) / COUNTS
    second = 2.0 * (step + 2 * worst) ** 2  # 2 per metre is more than any curvature of this robot there
    assert (error.max(axis=1) < worst + second).all()
    late = error[:, -8:].mean(axis=1)
    assert (late < 2e-4 + second).all() and (late > 2e-5).all(), "the noise is there to the end"


def loop(model, machine, start, jogs, control, noise):
    """The three controls, as a loop with the delta's closed forms."""
    commanded, joints = np.array(start), slides(start, machine)
    offset = joints - slides(start, model)
    rows = [(commanded, joints, position(joints, machine))]
    for displacement, measured in zip(jogs, noise, strict=True):
        here = rows[-1][2] + measured if control == "closed" else commanded
        joints = joints + jacobian(here, model) @ (commanded + displacement - here)
        commanded = commanded + displacement
        if control == "corrected":
            joints = slides(commanded, model) + offset
        rows.append((commanded, joints, position(joints, machine)))
    return [np.stack(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize("control", ["open", "corrected", "closed"])
def test_each_control_is_what_it_says_also_where_the_machine_is_not_its_model(control, rng):
    jogs = rng.normal(0, 0.02, (15, 3))
    noise = rng.normal(0, 1e-3, (15, 3)) if control == "closed" else np.zeros((15, 3))
    robot = LinearDelta.example()
    given = {"noise": jnp.asarray(noise)} if control == "closed" else {}

    for rod in (1.1, 1.0):
        machine = dataclasses.replace(robot, rod=jnp.asarray(rod))
        found = js.motion.jog(robot, START, jogs, control=control, machine=machine, **given)
        expected = loop(1.0, rod, START, jogs, control, noise)
        for ours, theirs in zip((found.commanded, found.actuated, found.poses), expected, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-12)
        assert found.ok.all() and int(found.covered) == 16


def test_a_closed_loop_takes_away_what_is_wrong_with_the_model():
    robot = LinearDelta.example()
    machine = dataclasses.replace(robot, rod=jnp.asarray(1.2))
    jogs = np.concatenate([np.tile([[0.04, 0.02, -0.02]], (5, 1)), np.zeros((10, 3))])
    off = {
        control: js.motion.jog(robot, START, jogs, control=control, machine=machine)
        for control in ("corrected", "closed")
    }
    error = {control: float(jnp.linalg.norm((e.poses - e.commanded)[-1])) for control, e in off.items()}
    assert error["corrected"] > 1e-2 and error["closed"] < 1e-6


def length_rates(robot, pose, twist):
    """d lengths of the planar 3-RPR by a twist: the speeds of the platform's joints along the legs."""
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    arms = np.asarray(robot.platform) @ turn.T
    legs = pose[:2] + arms - np.asarray(robot.base)
    speeds = twist[:2] + twist[2] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    return (legs * speeds).sum(axis=1) / np.linalg.norm(legs, axis=1)


@pytest.mark.exhaustive
def test_a_plain_jog_is_the_inverse_jacobian_times_the_displacement_in_a_robot_with_passive_joints(rng):
    robot = Planar3RPR.example()
    jogs = rng.normal(0, [0.02, 0.02, 0.05], (4, 3))
    found = js.motion.jog(robot, robot.home()[0], jogs)
    assert found.ok.all()
    for pose, jog, more in zip(np.asarray(found.commanded), jogs, np.diff(found.actuated, axis=0), strict=False):
        np.testing.assert_allclose(more, length_rates(robot, pose, jog), rtol=1e-9, atol=1e-12)


def test_jogging_stops_before_a_limit_and_keeps_what_it_covered():
    robot, up = LinearDelta.example(), np.tile([0.0, 0.0, 0.1], (15, 1))
    run = partial(js.motion.jog, robot, [0.0, 0.0, 0.05], machine=robot)
    found = run(up)
    # slides of twice the rod's length: the platform gets as high as 2 - sqrt(3) / 2
    covered = int((2 - np.sqrt(0.75) - 0.05) / 0.1) + 1
    assert int(found.covered) == covered and js.Status(int(found.reason)) is js.Status.OUT_OF_REACH
    shorter = run(np.where(np.arange(15)[:, None] < covered - 1, up, 0.0))
    assert shorter.reason == js.Status.CONVERGED
    np.testing.assert_array_equal(found.poses[:covered], shorter.poses[:covered])
    assert np.isnan(found.poses[covered:]).all() and np.isnan(found.actuated[covered:]).all()
    free = run(up, min_margin=-np.inf)
    assert free.reason == js.Status.CONVERGED


@pytest.mark.parametrize("control", exhaustive("closed", "open", "corrected"))
def test_the_derivative_of_the_end_by_a_dimension_is_that_of_differences(control):
    robot, jogs = LinearDelta.example(), np.tile([[0.008, -0.005, 0.01]], (15, 1))

    def end(rod):
        changed = dataclasses.replace(robot, rod=jnp.asarray(rod))
        return js.motion.jog(changed, START, jogs, control=control, machine=robot).poses[-1]

    step = 1e-5
    reverse = jax.jit(jax.jacrev(end))(1.0)
    difference = (end(1 + step) - end(1 - step)) / (2 * step)
    assert np.abs(difference).max() > 1e-3
    np.testing.assert_allclose(reverse, difference, rtol=1e-6, atol=1e-8)


@pytest.mark.exhaustive
def test_a_batch_is_a_loop_and_single_precision_stays_so(rng):
    robot = LinearDelta.example()
    single = jax.tree.map(lambda x: x.astype(jnp.float32), robot)
    jogs = rng.normal(0, 0.02, (3, 15, 3))
    jogs[1, 2] = np.nan
    starts = START + rng.normal(0, 0.02, (3, 3))
    batch = jax.jit(jax.vmap(lambda start, jogs: js.motion.jog(single, start, jogs, control="closed")))
    found = batch(jnp.asarray(starts, jnp.float32), jnp.asarray(jogs, jnp.float32))
    for i in range(3):
        one = js.motion.jog(robot, starts[i], jogs[i], control="closed")
        np.testing.assert_array_equal(one.status, found.status[i])
        np.testing.assert_allclose(one.poses, found.poses[i], atol=2e-6)
    assert found.poses.dtype == found.actuated.dtype == found.commanded.dtype == jnp.float32
    assert found.covered.tolist() == [16, 3, 16] and found.reason[1] == js.Status.NONFINITE


def test_wrong_arguments_are_refused():
    robot, jogs = LinearDelta.example(), np.zeros((2, 3))
    refused = {
        "control='none'": {"control": "none"},
        "measures nothing": {"noise": jogs},
        "noise of shape": {"noise": np.zeros((3, 3)), "control": "closed"},
        "same space of poses": {"machine": Planar3RPR.example()},
    }
    for message, given in refused.items():
        with pytest.raises(ValueError, match=message):
            js.motion.jog(robot, START, jogs, **given)
    for shape in ((3,), (0, 3), (2, 6)):
        with pytest.raises(ValueError, match="Got displacements of shape"):
            js.motion.jog(robot, START, np.zeros(shape))
