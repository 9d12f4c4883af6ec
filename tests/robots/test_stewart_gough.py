"""The Gough-Stewart platform as a baseline, and the limit in which the TSE becomes a hexapod."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js


@js.pytree
class Rod(js.Leg):
    """A rigid rod from a slide to the platform."""

    origin: js.Vec
    slide: js.Vec
    length: jax.Array
    actuated = (True,)

    def residual(self, joints, attachment):
        rod = attachment - self.origin - self.slide * joints[0]
        return (rod.dot(rod) / self.length**2 - 1,)

    def start(self, attachment):
        reach = attachment - self.origin
        along = reach.dot(self.slide)
        return (along + js.safe_sqrt(along**2 - reach.dot(reach) + self.length**2),), None


def test_scissor_extender_without_scissors_is_a_hexapod_of_rigid_rods(rng):
    """k1 = 1: both closure equations together say |C - A| = |C - B| = L [RAL17 IV-B]."""
    robot = js.TripleScissorExtender.from_ratios(1.0, 0.4, 0.1, 0.15)
    leg = robot.legs()
    for pose in np.asarray(robot.home()[0]) + rng.uniform(-0.1, 0.1, (20, 6)):
        solution = js.inverse_kinematics(robot, pose)
        points = robot.attachments(*js.SE3.place(jnp.asarray(pose)))
        for i, point in enumerate(points):
            origin, a, b = (jax.tree.map(lambda x, i=i: x[i], v) for v in (leg.origin, leg.slide_a, leg.slide_b))
            for j, slide in enumerate((a, b)):
                joint = Rod(origin, slide, jnp.asarray(1.0)).start(point)[0][0]
                assert float(joint) == pytest.approx(float(solution.value[2 * i + j]), abs=1e-12)
    rigid = js.TripleScissorExtender.from_ratios(1.0, 0.4, 0.1, 0.15)
    assert np.asarray(js.height_amplification(rigid, robot, jnp.array([0.4, 0.6]))) == pytest.approx(1)


def highest_over_lowest(robot, heights):
    pose = np.zeros((len(heights), 6))
    pose[:, 2] = heights
    margins = jax.vmap(lambda p: js.feasibility(robot, p).margin)(jnp.asarray(pose))
    inside = heights[np.asarray(margins) >= 0]
    return inside[-1], inside[0]


def test_telescopic_legs_do_not_pass_twice_their_folded_length_and_scissors_do():
    """[ICRA16 I]: a hexapod of folded height h cannot pass 2 h; the prototype's stops give a ratio of 5."""
    hexapod = js.StewartGough.prototype()
    folded = float(hexapod.stroke[0])
    top, _ = highest_over_lowest(hexapod, np.linspace(0.01, 3, 3000))
    assert top < 2 * folded
    prototype = js.TripleScissorExtender.prototype()
    top, bottom = highest_over_lowest(prototype, np.linspace(0.01, 1.8, 3000))
    assert top / bottom > 4.9


def test_lengths_are_distances(rng):
    robot = js.StewartGough.prototype()
    for pose in np.asarray(robot.home()[0]) + rng.uniform(-0.3, 0.3, (20, 6)):
        points = np.array([p.array() for p in robot.attachments(*js.SE3.place(jnp.asarray(pose)))])
        lengths = np.linalg.norm(points - np.asarray(robot.base), axis=1)
        assert np.abs(js.inverse_kinematics(robot, pose).value - lengths).max() < 1e-13


BAD = [
    (dict(base=np.zeros((6, 3))), "one line"),
    (dict(platform=np.outer(np.arange(6), [1, 2, 0])), "one line"),
    (dict(base=np.zeros((6, 2))), r"base of shape \(6, 2\)"),
    (dict(stroke=(2, 1)), "least < greatest"),
    (dict(stroke=(0.1, 0.2)), "Widen the stroke"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_impossible_geometry_is_refused(change, message):
    good = js.StewartGough.prototype()
    fields = dict(base=good.base, platform=good.platform, stroke=good.stroke) | change
    with pytest.raises(ValueError, match=message):
        js.StewartGough(**fields)
