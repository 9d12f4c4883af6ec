"""Tri-Scott and MICABO: the Scott linkage, the paper's closed forms, decoupling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxscissor as js

ROBOTS = [js.TriScott, js.Micabo]


@given(st.floats(0.05, 0.95))
def test_crank_of_half_the_link_draws_a_straight_line(share):
    link = 1.7
    radius, height = js.Scott(link).end(share * link)
    assert abs(float(height)) < 1e-12
    assert float(radius) == pytest.approx(link * np.sqrt(1 - share**2))


@given(st.floats(0.4, 0.9), st.floats(0.3, 0.6), st.floats(0.3, 0.9))
def test_other_cranks_draw_another_curve_that_the_linkage_closes(crank, pin, slider):
    linkage = js.Scott(1.0, crank, pin)
    if not abs(crank - pin) < slider < crank + pin:
        return
    radius, height = linkage.end(slider)
    assert np.abs(linkage.residual(radius**2, slider, height)).max() < 1e-12
    ways = [(float(d), float(h)) for d, h in linkage.sliders(radius)]
    assert min(abs(d - slider) + abs(h - float(height)) for d, h in ways) < 1e-6
    for d, h in ways:
        assert np.abs(linkage.residual(radius**2, d, h)).max() < 1e-12
    if abs(crank - pin) > 0.05:
        slope = float(jax.grad(lambda d: linkage.end(d)[1])(slider))
        assert abs(slope) > 1e-3, "straight although the crank is not half the link"


@pytest.mark.parametrize("cls", ROBOTS)
def test_inverse_kinematics_is_the_papers(cls, rng):
    robot = cls.prototype()
    home = np.asarray(robot.home()[0])
    for pose in home + rng.uniform(-0.2, 0.2, (200, 6)) * [1, 1, 1, 1, 1, 1]:
        solution = js.inverse_kinematics(robot, pose)
        points = np.array([p.array() for p in robot.attachments(*js.SE3.place(jnp.asarray(pose)))])
        squares = np.asarray(robot.link_lengths) ** 2 - np.sum((points[:, :2] - np.asarray(robot.masts)) ** 2, axis=1)
        assert bool(solution.converged) == bool((squares >= 0).all())
        if bool(solution.converged):
            spreads = np.sqrt(squares) + (points[:, 2] if cls is js.Micabo else 0)  # [TRI eqs. 2-6]
            assert np.abs(solution.value - np.concatenate([points[:, 2], spreads])).max() < 1e-12


def test_planar_motion_and_lift_are_decoupled_in_twist_coordinates(rng):
    """d(rho1..3)/d(v_x, v_y, omega_z) = 0 at every pose; d(rho4..6)/d(v_z, omega_x, omega_y) = 0 level, Tri-Scott's."""
    for cls in ROBOTS:
        robot = cls.prototype()
        home = np.asarray(robot.home()[0])
        planar, lift = [0, 1, 5], [2, 3, 4]
        for shift in rng.uniform(-0.15, 0.15, (20, 6)):
            tilted = np.asarray(js.inverse_jacobian(robot, home + shift, rates="twist"))
            assert np.abs(tilted[:3][:, planar]).max() < 1e-12
            level = np.asarray(js.inverse_jacobian(robot, home + shift * [1, 1, 1, 0, 0, 1], rates="twist"))
            coupled = np.abs(level[3:][:, lift]).max()
            assert coupled < 1e-12 if cls is js.TriScott else coupled > 0.9
            assert np.abs(tilted[3:][:, lift]).max() > 1e-4


def test_mobility_is_six_by_the_count():
    assert js.TriScott.topology.mobility == 6 and js.Micabo.topology.mobility == 6  # [TRI eq. 1]
    assert js.StewartGough.topology.mobility == 6


def test_other_cranks_couple_lift_and_planar_motion():
    masts, platform = _triangles()
    robot = js.TriScott(masts, [0.8] * 3, platform, crank_lengths=[0.45] * 3)
    pose, joints = robot.home()
    heights = np.array([p.z for p in robot.attachments(*js.SE3.place(pose))])
    assert np.abs(joints[:3] - heights).min() > 1e-3, "the lower sliders should no longer be level with the platform"
    lifted = js.inverse_jacobian(robot, pose, rates="twist")[:3, :2]
    assert np.abs(lifted).max() > 1e-3


def _triangles():
    return [[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]], [[-0.2, -0.1], [0.25, -0.1], [0.0, 0.2]]


BAD = [
    (dict(masts=[[0, 0], [0, 0], [1, 0]]), "coincide"),
    (dict(platform=[[0, 0], [1, 1], [2, 2]]), "one line"),
    (dict(link_lengths=[0.1] * 3), "must bridge"),
    (dict(link_lengths=[0.8, -0.8, 0.8]), "positive"),
    (dict(stroke=[[1, 0], [0, 1]]), "least < greatest"),
    (dict(stroke=[0, 1]), r"stroke of shape \(2,\)"),
    (dict(crank_pins=[0.9] * 3), "between its ends"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_impossible_geometry_is_refused(change, message):
    masts, platform = _triangles()
    with pytest.raises(ValueError, match=message):
        js.TriScott(**(dict(masts=masts, link_lengths=[0.8] * 3, platform=platform) | change))
