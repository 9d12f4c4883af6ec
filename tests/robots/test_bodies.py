"""The rigid bodies of the legs: where they hang together, how they can move, and which motions the joints are."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._bodies import BASE, PLATFORM
from jaxscissor.robots._contract import joints_by_leg, joints_together, seen_by_legs
from jaxscissor.robots._over_legs import one_by_one
from tests.conftest import tri_scott_skewed, tse_clockwise
from tests.toys import LinearDelta

ROBOTS = {
    "tse": js.TripleScissorExtender.prototype,
    "tse_clockwise": tse_clockwise,
    "tse_without_stages": partial(js.TripleScissorExtender, [1.0], 0.3, 0.05, 0.2),
    "navaro_mode_1": partial(js.NavaroII.prototype, 1),
    "tri_scott_skewed": tri_scott_skewed,
    "micabo": js.Micabo.prototype,
    "stewart_gough": js.StewartGough.prototype,
}


@jax.jit
def described(robot, pose, joints):
    """Bars, connections and point of the platform, leg by leg."""
    cases = one_by_one(robot.legs(), joints_by_leg(robot, joints), seen_by_legs(robot, *robot.space.place(pose)))
    return [(leg.bars(q, seen), leg.connections(q, seen), seen) for leg, q, seen in cases]


def in_space(vector):
    return np.array([*np.asarray(vector.array()), 0.0])[:3]


@pytest.fixture(scope="module", params=ROBOTS)
def case(request):
    """A robot at a pose of no symmetry, its joints there, and its legs."""
    robot = ROBOTS[request.param]()
    unit = np.where(np.arange(robot.space.dimension) < robot.space.translations, float(robot.length), 1)
    step = np.random.default_rng(len(request.param)).uniform(-0.04, 0.04, len(unit))
    pose = jnp.asarray(np.asarray(robot.home()[0]) + unit * step)
    solution = js.inverse_kinematics(robot, pose)
    assert solution.converged
    return robot, pose, solution.value, described(robot, pose, solution.value)


def test_every_connection_is_a_point_of_both_parts(case):
    robot, _, _, legs = case
    near = 1e-12 * float(robot.length)
    for bars, connections, seen in legs:
        assert {BASE, PLATFORM, *range(len(bars))} == {part for c in connections for part in (c.first, c.second)}
        np.testing.assert_allclose(in_space(connections[-1].point), in_space(seen), rtol=0, atol=near)
        for connection in connections:
            point = in_space(connection.point)
            for part in {connection.first, connection.second} - {BASE, PLATFORM}:
                start, end = map(in_space, bars[part])
                length = np.linalg.norm(end - start)
                share = (point - start) @ (end - start) / length**2
                np.testing.assert_allclose(point, start + share * (end - start), rtol=0, atol=near)
                assert -near <= share * length <= length + near


class Motions:
    """All velocities that the connections leave, as a basis of columns, by linear algebra on rigid bodies.

    Unknown are the twists (v at the origin, omega) of the platform and of all bars, and the rates of the freedoms.
    """

    def __init__(self, legs, bound):
        self.bars = {
            name: i + 1 for i, name in enumerate((a, b) for a, leg in enumerate(legs) for b in range(len(leg[0])))
        }
        held = [(a, c) for a, leg in enumerate(legs) for c in leg[1]]
        freedoms = [(a, freedom) for a, c in held for freedom in c.freedoms if freedom.kind != "ball"]
        self.rates = {id(freedom): 6 * (len(self.bars) + 1) + i for i, (_, freedom) in enumerate(freedoms)}
        self.width = 6 * (len(self.bars) + 1) + len(freedoms)
        rows = [bound @ self.twist(0, PLATFORM), *(row for a, c in held for row in self.held(a, c))]
        for a in range(len(legs)):
            geared = [self.rates[id(f)] for b, f in freedoms if b == a and f.geared is not None]
            rows += [(np.eye(self.width)[one] - np.eye(self.width)[geared[0]])[None] for one in geared[1:]]
        _, sizes, basis = np.linalg.svd(np.vstack(rows))
        self.basis = basis[np.count_nonzero(sizes > 1e-9 * sizes[0]) :].T

    def twist(self, leg, part):
        block = np.zeros((6, self.width))
        if part != BASE:
            start = 6 * self.bars.get((leg, part), 0)
            block[:, start : start + 6] = np.eye(6)
        return block

    def held(self, leg, connection):
        relative = self.twist(leg, connection.second) - self.twist(leg, connection.first)
        moving = velocity_at(relative, in_space(connection.point))
        turning = relative[3:]
        for freedom in connection.freedoms:
            if freedom.kind != "ball":
                (moving if freedom.kind == "slide" else turning)[:, self.rates[id(freedom)]] -= in_space(freedom.axis)
        return [moving] if any(freedom.kind == "ball" for freedom in connection.freedoms) else [moving, turning]

    def joint_rates(self, leg, bars, connections, count):
        """Rates of a leg's joints, ``(count, motions)``."""
        found = {f.joints: self.basis[self.rates[id(f)]] for c in connections for f in c.freedoms if f.joints}
        if (0, 1) in found:  # the height of Tri-Scott's upper slider is the sum of both joints
            found[1,] = found[0, 1] - found[0,]
        if (count - 1,) not in found:  # a joint that no freedom names is a distance
            foot, tip = in_space(connections[0].point), in_space(connections[-1].point)
            along = (tip - foot) / np.linalg.norm(tip - foot)
            found[count - 1,] = along @ velocity_at(self.twist(leg, PLATFORM) @ self.basis, tip)
        return [found[i,] for i in range(count)]


def velocity_at(twists, point):
    """Velocities ``(3, n)`` of a point that moves with bodies of twists ``(6, n)``."""
    return twists[:3] + np.cross(twists[3:].T, point).T


def test_bars_move_as_the_closure_says(case):
    robot, pose, joints, legs = case
    planar = robot.space is js.SE2
    motions = Motions(legs, np.eye(6)[[2, 3, 4]] if planar else np.zeros((0, 6)))  # a plane carries the platform
    assert motions.basis.shape[1] == robot.space.dimension  # no bar is loose, and none is bound too much
    position = in_space(robot.space.place(pose)[0])
    platform = motions.twist(0, PLATFORM) @ motions.basis
    twists = np.vstack([velocity_at(platform, position), platform[3:]])[[0, 1, 5] if planar else slice(None)]
    rates = [motions.joint_rates(i, *leg[:2], len(robot.actuation()[i])) for i, leg in enumerate(legs)]
    rates = np.asarray(joints_together(robot, tuple(map(jnp.stack, zip(*rates, strict=True)))))
    by_pose, by_joints = map(np.asarray, js.closure_jacobians(robot, pose, joints=joints))
    moved = by_pose @ np.linalg.solve(np.asarray(robot.space.rates_to_twist(pose)), twists)
    assert np.abs(moved).max() > 1e-3
    np.testing.assert_allclose(moved + by_joints @ rates, 0, atol=1e-11)


def test_a_robot_that_does_not_say_how_its_bars_hang_together_has_no_connections():
    robot = LinearDelta.example()
    assert all(not connections for _, connections, _ in described(robot, *robot.home()))


def test_connections_that_are_none_are_refused():
    class Loose(js.robots.Leg):
        def connections(self, joints, attachment):
            return [attachment]

    with pytest.raises(ValueError, match=r"Loose.connections\(joints, attachment\) gave .*; expected a list of robots"):
        Loose().connections((1.0,), js.Vec(0.0, 0.0, 0.0))
