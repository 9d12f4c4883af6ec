"""What inexact dimensions do to the pose: sensitivity, first-order error, Monte Carlo."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from jaxscissor._engine.cpu.chunks import in_chunks
from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import inverse, is_regular
from jaxscissor._engine.numerics import Scalar, default_tol, safe_sqrt
from jaxscissor._engine.programs import one_pose, program
from jaxscissor._engine.pytree import as_floats, broadcast, pytree, with_fields
from jaxscissor._engine.types import Numbers, PoseLike, PyTree
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._legs import MAX_STEPS, place, solve_legs
from jaxscissor.kinematics._platform import all_joints, assemble, assembly_sign, legs_close, state_at
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Mechanism,
    actuated_mask,
    angular_joints,
    checked_pose,
    closure,
    joint_places,
    joints_together,
)
from jaxscissor.robots._per_leg import PerLeg, copies_of
from jaxscissor.singularities._measures import closure_matrix, passive_columns

_LANES = 4096  # samples solved together


def tolerances(robot: Mechanism, **deviations: Any) -> Any:
    """Standard deviations of a robot's dimensions, leg by leg; zero, which is exact, where none is given.

    Args:
      robot: any robot.
      **deviations: fields of the robot by name, in the field's unit: a number, an array of the field's
        shape, or one for each leg, ``(legs, *shape)``.

    Returns:
      A container like the robot whose arrays have the shapes ``(legs, *shape)``.

    Raises:
      ValueError: a name that is no field of the robot, or values that do not broadcast.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> made = js.design.tolerances(robot, link_lengths=1e-4, actuator_angle=1e-4, top_radius=1e-4)
      >>> made.link_lengths.shape, made.stroke.max().item()
      ((3, 3), 0.0)
    """
    return with_fields(jax.tree.map(jnp.zeros_like, copies_of(robot)), deviations)


@pytree
class PoseError:
    """First-order error of the pose, as a twist: translation, rotation vector, in the base frame.

    Attributes:
      covariance: ``(d, d)``.
      translation: root mean square length of the translation.
      rotation: root mean square angle of the rotation, in radians; zero for robots that do not turn.
    """

    covariance: jax.Array
    translation: jax.Array
    rotation: jax.Array


@pytree
class PoseErrorSamples:
    """Errors of the pose of randomly drawn robots, as twists in the base frame.

    Attributes:
      errors: ``(samples, d)`` translation and rotation vector, ``nan`` where the status is not ``CONVERGED``.
      status: ``(samples,)`` a ``Status`` code each; see ``forward_kinematics``.
    """

    errors: jax.Array
    status: jax.Array


class _Sensitivity(NamedTuple):
    """Derivatives of the twist by each leg's copy of the robot and by the actuated joints; zero if not usable."""

    usable: Scalar
    copies: Any
    joints: jax.Array


@one_pose()
def pose_sensitivity(robot: Mechanism, pose: PoseLike) -> Any:
    """Derivative of the pose with respect to each leg's own copy of every dimension, actuators held.

    The actuated joints stay at the values that the robot as designed has at the pose, in the home mode. By
    the implicit function theorem on the closure equations, the passive joints eliminated; one reverse pass
    per pose coordinate, whatever the number of dimensions.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      A container like the robot whose arrays have the shapes ``(d, legs, *shape)``: per unit of dimension
      the twist (translation, rotation vector), in the base frame. ``nan`` where the home mode does not
      reach the pose, or the pose is singular. Dimensions in ``constraints`` count as those of the mean of
      the legs' copies: see ``robots.PerLeg``.

    Raises:
      ValueError: wrong shape of the pose.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sensitivity = js.design.pose_sensitivity(robot, robot.home()[0])
      >>> sensitivity.top_radius.shape, sensitivity.link_lengths.shape
      ((6, 3), (6, 3, 3))
    """
    robot, pose = checked_pose(robot, pose)
    found = _sensitivity(robot, pose)
    return jax.tree.map(lambda leaf: jnp.where(found.usable, leaf, jnp.nan), found.copies)


@one_pose()
def pose_error(robot: Mechanism, pose: PoseLike, tolerances: PyTree, *, joints: Numbers = 0.0) -> PoseError:
    """What manufacturing tolerances do to the pose, to first order.

    The dimensions of each leg deviate independently of one another and of those of the other legs.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      tolerances: container like the robot of standard deviations, as made by ``design.tolerances``; arrays broadcast
        to ``(legs, *shape)``. Zero is exact, also for infinite dimensions.
      joints: standard deviations of the actuated joints, ``(m,)`` or one for all.

    Returns:
      ``design.PoseError``; ``nan`` where the home mode does not reach the pose, or the pose is singular.

    Raises:
      ValueError: wrong shapes, or tolerances of another structure than the robot.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> made = js.design.tolerances(robot, base=1e-4, platform=1e-4)  # 0.1 mm
      >>> error = js.design.pose_error(robot, robot.home()[0], made)
      >>> bool(1e-5 < error.translation < 1e-3), error.covariance.shape
      (True, (6, 6))
    """
    robot, pose = checked_pose(robot, pose)
    robot, pose, deviations, joints = _checked(robot, pose, tolerances, joints)
    return _pose_error(robot, pose, deviations, joints)


@program("samples")
def sample_pose_errors(
    robot: Mechanism,
    pose: PoseLike,
    tolerances: PyTree,
    key: jax.Array,
    samples: int = 100_000,
    *,
    joints: Numbers = 0.0,
) -> PoseErrorSamples:
    """Errors of the pose of robots drawn at random, each assembled by Newton's method: Monte Carlo.

    Every dimension of every leg is drawn from its normal distribution, the actuated joints are held at the
    values (plus their own errors) that the robot as designed has at the pose, and the pose is solved for
    from there. Samples are solved in chunks, and only their errors are kept. Use double precision: in
    single, what counts as closed is no smaller than usual tolerances.

    Args:
      robot: the robot as designed.
      pose: ``(d,)`` in the base frame.
      tolerances: container like the robot of standard deviations; see ``design.pose_error``.
      key: of ``jax.random``. The same key gives the same robots.
      samples: number of robots drawn.
      joints: standard deviations of the actuated joints, ``(m,)`` or one for all.

    Returns:
      ``design.PoseErrorSamples``. ``OTHER_MODE`` where the drawn robot closes beyond a singularity, ``MAX_STEPS``
      where it was not found to close; the status of the pose itself where the robot as designed does not
      reach it.

    Raises:
      ValueError: wrong shapes, tolerances of another structure than the robot, or no samples.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> made = js.design.tolerances(robot, base=0.01, platform=0.01)
      >>> drawn = js.design.sample_pose_errors(robot, robot.home()[0], made, jax.random.key(0), 100)
      >>> drawn.errors.shape, int((drawn.status == js.Status.CONVERGED).sum())
      ((100, 3), 100)
    """
    if samples < 1:
        raise ValueError(f"Got samples={samples}; expected at least one.")
    robot, pose = checked_pose(robot, pose)
    robot, pose, deviations, joints = _checked(robot, pose, tolerances, joints)
    return _sample(robot, pose, deviations, joints, key, samples)


def _checked(
    robot: Mechanism, pose: PoseLike, deviations: PyTree, joints: Numbers
) -> tuple[Mechanism, jax.Array, PyTree, jax.Array]:
    """One dtype; deviations leg by leg, and one for each actuated joint."""
    wanted = copies_of(robot)
    if jax.tree.structure(deviations) != jax.tree.structure(wanted):
        raise ValueError(
            f"Got tolerances of structure {jax.tree.structure(deviations)}; expected that of the robot, as made by "
            "js.design.tolerances."
        )
    robot, pose = checked_pose(robot, pose)
    robot, pose, deviations, given = as_floats(robot, pose, deviations, jnp.asarray(joints))
    deviations = jax.tree.map(lambda t, leaf: broadcast("a tolerance", t, leaf.shape), deviations, wanted)
    return robot, pose, deviations, broadcast("joints", given, (sum(actuated_mask(robot)),))


def _pose_error(robot: Mechanism, pose: jax.Array, deviations: PyTree, joints: jax.Array) -> PoseError:
    found, linear = _sensitivity(robot, pose), robot.space.translations

    def scaled(derivative: jax.Array, deviation: jax.Array):
        exact = deviation == 0  # zero times whatever an infinite dimension gives
        product = jnp.where(exact[None], 0, derivative) * deviation[None]
        return product.reshape(len(pose), -1)

    columns = jax.tree.map(scaled, (found.copies, found.joints), (deviations, joints))
    matrix = jnp.concatenate(jax.tree.leaves(columns), axis=1)
    covariance = matrix @ matrix.T
    variances = jnp.diagonal(covariance)
    error = PoseError(covariance, safe_sqrt(jnp.sum(variances[:linear])), safe_sqrt(jnp.sum(variances[linear:])))
    return jax.tree.map(lambda leaf: jnp.where(found.usable, leaf, jnp.nan), error)


def _sensitivity(robot: Mechanism, pose: jax.Array) -> _Sensitivity:
    placed, size = place(robot, pose), robot.space.dimension
    results, _ = solve_legs(robot, placed, None, default_tol(pose.dtype), MAX_STEPS)
    joints = joints_together(robot, results.value)
    matrix = closure_matrix(robot, placed.position, placed.rotation, joints)
    unknown = matrix[:, jnp.array([*range(size), *passive_columns(robot)])]
    usable = placed.finite & jnp.all(results.solved) & is_regular([list(row) for row in unknown])
    unit = jnp.eye(len(unknown), dtype=unknown.dtype)
    scale = jnp.where(jnp.arange(size) < robot.space.translations, robot.length, 1)[:, None]
    # row j: how much the closure's residuals move coordinate j of the twist; zero where the pose is not usable
    adjoint = -scale * jnp.where(usable, inverse(jnp.where(usable, unknown, unit))[:size], 0)

    def residuals(copies: jax.Array):
        crooked = PerLeg(copies)
        return jnp.stack(closure(crooked, crooked.legs(), joints, placed.position, placed.rotation))

    _, pull = jax.vjp(residuals, copies_of(robot))
    (by_copies,) = jax.vmap(pull)(fence(adjoint))  # without: a third more, the inverse anew for every row
    return _Sensitivity(usable, by_copies, adjoint @ _driven(robot, matrix))


def _driven(robot: Mechanism, matrix: jax.Array) -> jax.Array:
    """Derivative of the closure by the actuated joints, in their order and units."""
    column_of = {joint: robot.space.dimension + i for i, joint in enumerate(joint_places(robot).ravel())}
    units = [1 if angle else robot.length for angle in angular_joints(robot)]
    driven = [i for i, actuated in enumerate(actuated_mask(robot)) if actuated]
    return jnp.stack([matrix[:, column_of[i]] / units[i] for i in driven], axis=1)


def _sample(
    robot: Mechanism, pose: jax.Array, deviations: PyTree, joint_deviations: jax.Array, key: jax.Array, samples: int
) -> PoseErrorSamples:
    solution = inverse_kinematics(robot, pose)
    home_pose, home_joints = robot.home()
    pose = jnp.where(solution.converged, pose, home_pose)
    joints = jnp.where(solution.converged, solution.value, home_joints)
    start, actuated, tol = state_at(robot, pose, joints), robot.actuated(joints), default_tol(pose.dtype)
    sign = assembly_sign(robot, actuated, start)
    nominal, rebuild = ravel_pytree((copies_of(robot), actuated))
    spread, _ = ravel_pytree((deviations, joint_deviations))

    def one(number: jax.Array):
        drawn = jax.random.normal(jax.random.fold_in(key, number), nominal.shape, nominal.dtype)
        copies, held = rebuild(nominal + spread * drawn)
        crooked = PerLeg(copies)
        state, error, _ = assemble(crooked, held, start, tol, 50)
        same = assembly_sign(crooked, held, state) == sign
        status = jnp.where(error <= tol, jnp.where(same, Status.CONVERGED, Status.OTHER_MODE), Status.MAX_STEPS)
        status = jnp.where(legs_close(crooked, all_joints(robot, held, state)), status, Status.NO_SOLUTION)
        return robot.space.between((start.position, start.rotation), (state.position, state.rotation)), status

    errors, status = in_chunks(jax.vmap(one), jnp.arange(samples), samples, _LANES)
    status = jnp.where(solution.converged, status, solution.status).astype(jnp.int32)
    return PoseErrorSamples(jnp.where((status == Status.CONVERGED)[:, None], errors, jnp.nan), status)
