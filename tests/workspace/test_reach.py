"""How far robots go in a direction, and their heights, against closed forms and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.toys import ThreePRS


def assert_same(found, expected, rtol):
    scale = max(float(jnp.max(jnp.abs(leaf))) for leaf in jax.tree.leaves(expected))
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * scale)


def level_heights(theta):
    """Level and central, a scissor leans by the slides' way inwards: h^2 = (y - s sin eta)^2 + z^2, w = 2 s cos eta."""
    k1, eta, k3, k4 = theta[:4]
    stops = theta[4:]
    slides = k1 * jnp.cos(stops) / jnp.cos(eta)
    return jnp.sqrt(jnp.sin(stops) ** 2 - (k4 - k3 - slides * jnp.sin(eta)) ** 2)


@pytest.mark.exhaustive
def test_the_prototype_stands_as_high_as_its_stops_let_its_leaning_scissors():
    theta = jnp.array([0.2647, np.pi / 6, 0.0186, 0.11765, np.arcsin(0.324 / 1.727), np.arcsin(1.619 / 1.727)])

    def heights(theta):
        k1, eta, k3, k4, *stops = theta
        bars = jnp.stack([k1, (1 - k1) / 2 * 14 / 25, (1 - k1) / 2 * 11 / 25])  # the prototype's proportions
        return js.workspace.height_range(js.TripleScissorExtender(bars, eta, k3, k4, scissor_angle=stops))

    np.testing.assert_allclose(heights(theta), level_heights(theta), rtol=1e-13)
    assert_same(jax.jacrev(heights)(theta), jax.jacrev(level_heights)(theta), rtol=1e-9)
    assert_same(
        js.workspace.height_range(js.TripleScissorExtender.prototype()), 1.727 * level_heights(theta), rtol=1e-12
    )


@pytest.mark.exhaustive
def test_a_hexapod_rises_until_its_legs_end():
    def known(robot):
        across2 = jnp.sum((robot.base - robot.platform)[:, :2] ** 2, axis=1)
        low, high = (jnp.sqrt(end**2 - across2) for end in robot.stroke)
        return jnp.stack([jnp.max(low), jnp.min(high)])

    robot = js.StewartGough.prototype()
    assert float(jnp.abs(robot.base[:, 2]).max()) == float(jnp.abs(robot.platform[:, 2]).max()) == 0
    assert_same(js.workspace.height_range(robot), known(robot), rtol=1e-12)
    slopes = jax.jacrev(js.workspace.height_range)(robot).stroke
    assert_same(slopes, jax.jacrev(known)(robot).stroke, rtol=1e-9)


def test_a_planar_robot_goes_until_the_first_leg_ends():
    pose, way = jnp.array([45.0, 26.0, 0.3]), jnp.array([2.0, -1.0, 0.0])

    def known(robot, pose):
        cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
        turn = jnp.stack([jnp.stack([cos, -sin]), jnp.stack([sin, cos])])
        legs = pose[None, :2] + robot.platform @ turn.T - robot.base
        along, speed2 = legs @ way[:2], way[:2] @ way[:2]
        roots = []
        for end in robot.stroke:
            square = along**2 - speed2 * (jnp.sum(legs**2, axis=1) - end**2)
            half = jnp.where(square > 0, js.safe_sqrt(square), jnp.nan)
            roots += [(-along - half) / speed2, (-along + half) / speed2]
        times = jnp.stack(roots)
        return jnp.nanmin(jnp.where(times > 0, times, jnp.nan))

    robot = js.NavaroII.prototype()

    def found(robot, pose):
        return js.workspace.reach_along(robot, pose, way)

    (by_robot, by_pose), (robot_too, pose_too) = (jax.grad(f, (0, 1))(robot, pose) for f in (found, known))
    assert float(found(robot, pose)) == pytest.approx(float(known(robot, pose)), rel=1e-13)
    assert_same((by_robot, by_pose), (robot_too, pose_too), rtol=1e-9)
    batch = jax.jit(jax.vmap(found, (None, 0)))(robot, jnp.stack([pose, pose.at[0].set(500.0)]))
    assert batch[0] == found(robot, pose) and jnp.isnan(batch[1])
    assert js.workspace.reach_along(robot, pose, way, max_distance=1.0) == jnp.inf


@pytest.mark.exhaustive
def test_a_bound_platform_moves_as_its_constraints_let_it():
    """Level and central, a 3-PRS needs no parasitic motion: it ends where the rods stand upright."""
    low, high = js.workspace.height_range(ThreePRS.example())
    assert float(high) == pytest.approx(1.0, abs=1e-12) and float(low) == pytest.approx(-1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda robot, pose: js.workspace.height_range(js.NavaroII.prototype()), "no height"),
        (lambda robot, pose: js.workspace.reach_along(robot, pose, pose[:3]), "Got direction"),
        (lambda robot, pose: js.workspace.reach_along(robot, pose[:3], pose), "pose"),
        (lambda robot, pose: js.workspace.reach_along(robot, pose, pose, cells=0), "at least one"),
    ],
)
def test_what_has_no_reach_is_refused(make, message, prototype):
    with pytest.raises(ValueError, match=message):
        make(prototype, prototype.home()[0])
