"""The platform and the passive joints at given actuated joints: one system, its solution and its derivative."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import determinant_sign, solve_regular
from jaxscissor._engine.newton import implicit, newton, norm, normal_equations, value_and_jacobian
from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._triangle_on_circles import (
    TriangleOnCircles,
    assembly_sign_by_angles,
    differentiable_corners,
    solved_corners,
    triangle_on_circles,
)
from jaxscissor.robots._contract import (
    Joints,
    Mechanism,
    actuated_mask,
    closure,
    joints_by_leg,
)
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots._spaces import fit_triangle


class State(NamedTuple):
    """What the actuated joints leave open."""

    position: Vec
    rotation: Rotation
    passive: Joints


def state_at(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> State:
    """The state of a pose and all joints."""
    passive = tuple(q for q, a in zip(joints, actuated_mask(robot), strict=True) if not a)
    return State(*robot.space.place(pose), passive)


def all_joints(robot: Mechanism, actuated: jax.Array, state: State) -> jax.Array:
    """The array of all joints, from the actuated ones and the passive ones of a state."""
    taken, free = iter(actuated), iter(state.passive)
    return jnp.stack([next(taken) if a else next(free) for a in actuated_mask(robot)])


def assemble(
    robot: Mechanism,
    actuated: jax.Array,
    start: State,
    tol: Scalar,
    max_steps: Scalar,
    triangle: TriangleOnCircles | None = None,
) -> tuple[State, Scalar, Scalar]:
    """Newton's method from a state, stepping on the rotation group: state, residual and number of steps.

    Of corners that swing on circles it is Newton's method on their angles.
    """
    robot, actuated, start, tol, max_steps = lax.stop_gradient((robot, actuated, start, tol, max_steps))
    triangle = triangle or triangle_on_circles(robot, actuated)
    if triangle is not None:
        points, count = solved_corners(triangle, _corners(robot, start), tol, max_steps)
        position, rotation = fence(_placed(triangle.corners, points, robot))
        state = State(position, rotation, ())
        return state, norm(_state_residual(state, (robot, robot.legs(), actuated))), count
    args = (robot, robot.legs(), actuated)
    retract, nudge = (_stepping(robot, step) for step in (robot.space.retract, robot.space.nudge))
    steps = {"tol": tol, "max_steps": max_steps, "retract": retract, "nudge": nudge}
    return newton(_state_residual, start, args, unknowns=_unknowns(robot), **steps)


def differentiable_pose(robot: Mechanism, actuated: jax.Array, state: State, ok: Scalar) -> tuple[jax.Array, Joints]:
    """Pose coordinates and passive joints of a solution, with the implicit function's derivative where ok."""
    triangle = triangle_on_circles(robot, actuated)
    if triangle is not None:
        points = differentiable_corners(fence(triangle), _corners(robot, state), ok)
        pose = jnp.stack(robot.space.coordinates(*_placed(triangle.corners, points, robot)))
        return jnp.where(ok, pose, lax.stop_gradient(pose)), ()
    coordinates = (*robot.space.coordinates(state.position, state.rotation), *state.passive)
    root = implicit(_pose_residual, coordinates, ok, (robot, robot.legs(), actuated))
    size = robot.space.dimension
    return jnp.stack(root[:size]), root[size:]


def _corners(robot: Mechanism, state: State) -> list[Vec]:
    """The points of the platform that the legs hold, in lengths of the robot."""
    return [corner * (1 / robot.length) for corner in robot.attachments(state.position, state.rotation)]


def _placed(corners: Sequence[Vec], points: Sequence[Vec], robot: Mechanism) -> tuple[Vec, Rotation]:
    """The place of the platform with its corners at points, both in lengths of the robot."""
    position, rotation = fit_triangle(corners, points)
    return position * robot.length, rotation


def legs_close(robot: Mechanism, joints: jax.Array) -> Scalar:
    """Whether every leg can be assembled with these joints, wherever the platform is."""
    cases = one_by_one(robot.legs(), joints_by_leg(robot, joints))
    return functools.reduce(jnp.logical_and, [leg.closes(q) for leg, q in cases])


@jax.jit
def assembly_sign(
    robot: Mechanism, actuated: jax.Array, state: State, triangle: TriangleOnCircles | None = None
) -> Scalar:
    """Sign of det d residual / d (twist, passive joints), which names the assembly mode; zero on a singularity.

    Of a robot with more actuated joints than freedoms that of det J^T J: such joints name no modes.
    """
    robot, actuated, state = lax.stop_gradient((robot, actuated, state))
    triangle = triangle or triangle_on_circles(robot, actuated)
    if triangle is not None:
        return assembly_sign_by_angles(triangle, _corners(robot, state))
    rows, values = _system(robot, actuated, state)
    return determinant_sign(normal_equations(rows, values)[0])


@jax.jit
def contradiction(robot: Mechanism, actuated: jax.Array, state: State) -> Scalar:
    """Size of the next step of Gauss and Newton from a state: next to nothing where the residual is least."""
    rows, values = _system(*lax.stop_gradient((robot, actuated, state)))
    step, regular = solve_regular(*normal_equations(rows, values))
    return jnp.where(regular, norm(step), jnp.inf)


def _system(robot: Mechanism, actuated: jax.Array, state: State) -> tuple[Sequence[Sequence[Scalar]], Joints]:
    """The closure's rows by (twist, passive joints) at a state, and its values."""
    args, nudge = (robot, robot.legs(), actuated), _stepping(robot, robot.space.nudge)
    zero = (jnp.zeros_like(actuated[0]),) * _unknowns(robot)
    values, rows = value_and_jacobian(lambda d: _state_residual(nudge(state, d), args), zero)
    return rows, values


def _unknowns(robot: Mechanism) -> int:
    """Coordinates of the pose and passive joints."""
    return robot.space.dimension + actuated_mask(robot).count(False)


def _state_residual(state: State, args: PyTree) -> Joints:
    """Closure equations of a state at given (robot, legs, actuated joints)."""
    robot, legs, actuated = args
    return closure(robot, legs, all_joints(robot, actuated, state), state.position, state.rotation)


def _pose_residual(unknowns: Joints, args: PyTree) -> Joints:
    """The same with the pose as coordinates."""
    robot = args[0]
    size = robot.space.dimension
    position, rotation = robot.space.place(jnp.stack(unknowns[:size]))
    return _state_residual(State(position, rotation, unknowns[size:]), args)


def _stepping(robot: Mechanism, step_pose: Callable[[Vec, Rotation, Joints], tuple[Vec, Rotation]]) -> Callable:
    """Step of the state: lengths in units of the robot's length, angles on the group."""
    size, linear = robot.space.dimension, robot.space.translations
    scale = lax.stop_gradient(robot.length)

    def move(state: State, step: Joints) -> State:
        twist = tuple(scale * d if i < linear else d for i, d in enumerate(step[:size]))
        moved = step_pose(state.position, state.rotation, twist)
        return State(*moved, tuple(q + d for q, d in zip(state.passive, step[size:], strict=True)))

    return move
