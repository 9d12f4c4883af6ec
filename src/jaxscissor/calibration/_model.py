"""What a robot with changed dimensions would show at measured joints, with derivatives, of one program.

The program evaluates closure and measure; Newton's method on the platform and the linear algebra are NumPy's, so that
there is little to compile.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._engine.numerics import default_tol
from jaxscissor._engine.programs import run_once
from jaxscissor._engine.pytree import as_floats, broadcast, float_dtype
from jaxscissor._engine.types import Numbers, PyTree
from jaxscissor.calibration._measures import Measure, deviation, parts_of, pose_of, shown
from jaxscissor.calibration._unknowns import Nominal, Unknowns, unknowns_of
from jaxscissor.kinematics import Solution, Status, inverse_kinematics
from jaxscissor.kinematics._platform import State, all_joints
from jaxscissor.robots._contract import (
    Mechanism,
    actuated_mask,
    checked_freedoms,
    closure,
)

_MAX_STEPS = 50
_LEAST_STEP = 1e-6  # share of a Newton step below which a lane is given up


_shown = jax.jit(shown, static_argnums=0)  # only for its shape, which it keeps


class _Evaluated(NamedTuple):
    """The program's results, on a leading axis of one entry per measurement."""

    closure: Any  # its residual
    closure_slopes: tuple[Any, Any]  # its derivatives by pose and passive joints, and by the unknowns
    deviation: Any  # measured less shown
    slopes: tuple[Any, Any]  # derivatives of the deviation, as those of the closure

    @property
    def error(self) -> np.ndarray:
        """Norm of the closure, ``nan`` if it is."""
        return np.linalg.norm(self.closure, axis=1)


class Starts(NamedTuple):
    """Pose and passive joints ``(n, d + q)`` from which the platform is assembled, and the sign that names the mode.

    The sign is that of the closure's determinant; ``nan`` where there is nothing to assemble.
    """

    states: np.ndarray
    signs: np.ndarray


class Linear(NamedTuple):
    """Deviations in units of ``sigma`` ``(n, k)``, derivatives by unknowns in units of the prior ``(n, k, p)``."""

    deviations: np.ndarray
    jacobian: np.ndarray
    starts: Starts
    status: np.ndarray  # (n,)


@dataclasses.dataclass(frozen=True)
class Model:
    """Measurements of a robot, and what is known beforehand.

    Attributes:
      nominal: robot, offsets and measure.
      unknowns: what of them is calibrated.
      function: the measure without its numbers.
      readings: ``(n, m)`` the actuated joints as their sensors show them.
      targets: ``(n, k)`` what was measured, ``nan`` where nothing was.
      sigma: ``(n, k)`` its standard deviations.
    """

    nominal: Nominal
    unknowns: Unknowns
    function: Callable[..., jax.Array]
    readings: np.ndarray
    targets: np.ndarray
    sigma: np.ndarray

    @property
    def missing(self) -> np.ndarray:
        """Which numbers ``(n, k)`` were not measured; of an orientation, all angles if one is missing."""
        missing = ~np.isfinite(self.targets)
        if self.function is pose_of:
            linear = self.nominal.robot.space.translations
            missing[:, linear:] |= missing[:, linear:].any(axis=1, keepdims=True)
        return missing

    def at(self, values: np.ndarray, starts: Starts) -> Linear:
        """Deviations and their derivatives with the unknowns so many priors away from nominal.

        1. The platform is assembled by Newton's method with the joints read, from the starts.
        2. There closure F and deviation r are differentiated by the state x and the unknowns v.
        3. By the implicit function theorem dr/dv = r_v - r_x F_x^-1 F_v.
        """
        tol = default_tol(self.nominal.offsets.dtype)
        states, found = self._assembled(values, starts, tol)
        signs, _ = np.linalg.slogdet(np.where(np.isfinite(found.closure_slopes[0]), found.closure_slopes[0], 0))
        status = np.where(found.error <= tol, Status.CONVERGED, Status.MAX_STEPS)
        status = np.where((status == Status.CONVERGED) & (signs * starts.signs < 0), Status.OTHER_MODE, status)
        status = np.where(signs == 0, Status.SINGULAR, status)
        status = np.where(np.isfinite(self.readings).all(axis=1), status, Status.NONFINITE).astype(np.int32)
        good = status == Status.CONVERGED
        moved = _solved(found.closure_slopes[0], found.closure_slopes[1], good)
        jacobian = (found.slopes[1] - found.slopes[0] @ moved) / self.sigma[..., None]
        return Linear(found.deviation / self.sigma, jacobian, Starts(states, np.where(good, signs, np.nan)), status)

    def _assembled(self, values: np.ndarray, starts: Starts, tol: float) -> tuple[np.ndarray, _Evaluated]:
        """States that close the loops, by Newton steps that are halved while they do not reduce the residual."""
        states, found = starts.states, self.evaluated(values, starts.states)
        damping = np.ones(len(states))
        for _ in range(_MAX_STEPS):
            error = found.error
            active = (error > tol) & np.isfinite(starts.signs) & (damping > _LEAST_STEP)
            if not active.any():
                break
            step = _solved(found.closure_slopes[0], found.closure[..., None], active)[..., 0]
            trial = states - np.where(active, damping, 0)[:, None] * step
            there = self.evaluated(values, trial)
            better = active & (there.error < error)
            states, found = jax.tree.map(
                lambda new, old, better=better: np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old),
                (trial, there),
                (states, found),
            )
            damping = np.where(better, np.minimum(2 * damping, 1), damping / 2)
        return states, found

    def evaluated(self, values: np.ndarray, states: np.ndarray) -> _Evaluated:
        """The program's results as numbers."""
        dtype = self.nominal.offsets.dtype
        inputs = self.unknowns.prior, values, self.readings, self.targets, states
        arrays = [jnp.asarray(np.asarray(part, dtype)) for part in inputs]
        found = _evaluate(self.function, self.nominal, jnp.asarray(self.unknowns.places), *arrays)
        return jax.tree.map(lambda leaf: np.asarray(leaf, float), found)


def modeled(
    robot: Mechanism,
    readings: Numbers,
    measured: Numbers | None,
    *,
    prior: PyTree,
    sigma: Numbers,
    offsets: Numbers,
    measure: Measure | None,
) -> Model:
    """The model of some measurements, or of joints at which some would be made.

    Raises:
      ValueError: as ``identify``.
    """
    checked_freedoms(robot)
    function, numbers = parts_of(measure)
    count = sum(actuated_mask(robot))
    robot, numbers = as_floats(robot, numbers)
    zeros = jnp.zeros(count, float_dtype(robot))
    nominal = Nominal(robot, zeros, numbers)
    given = np.asarray(readings, float)
    if given.ndim != 2 or given.shape[1] != count or not len(given):
        raise ValueError(
            f"Got joints of shape {given.shape}; expected (n, {count}), the actuated joints of a "
            f"{type(robot).__name__} at n measurements."
        )
    pose = jax.ShapeDtypeStruct((robot.space.dimension,), zeros.dtype)
    size = _shown.eval_shape(function, numbers, robot, pose).shape
    if len(size) != 1:
        raise ValueError(f"Got a measure that gives numbers of shape {size}; expected () or (k,).")
    shape = (len(given), *size)
    targets = np.full(shape, np.nan) if measured is None else np.array(measured, float)
    if targets.shape == shape[:1] and size == (1,):
        targets = targets[:, None]
    if targets.shape != shape:
        raise ValueError(f"Got measured numbers of shape {targets.shape}; expected {shape}; nan is not measured.")
    spread = np.array(broadcast("sigma", jnp.asarray(np.asarray(sigma, float)), shape))
    if not np.all(spread > 0):
        raise ValueError("Got a sigma that is not positive; expected the standard deviations of what is measured.")
    return Model(nominal, unknowns_of(nominal, prior, offsets), function, given, targets, spread)


def starts_of(model: Model, guess: Numbers | None) -> Starts:
    """From where to assemble: the guess, else the measured poses, else home; with the joints of the home mode.

    The sign of the closure's determinant there names the assembly mode that is kept.
    """
    robot = model.nominal.robot
    pose, joints = (np.asarray(part, float) for part in robot.home())
    count = len(model.readings)
    poses, every = np.tile(pose, (count, 1)), np.tile(joints, (count, 1))
    if guess is None and model.function is pose_of and np.isfinite(model.targets).any():
        guess = model.targets
    if guess is not None:
        wanted = broadcast("a guess", jnp.asarray(guess, model.nominal.offsets.dtype), poses.shape)
        found = joints_at(robot, wanted)
        there = np.asarray(found.converged)[:, None]
        poses, every = np.where(there, wanted, poses), np.where(there, np.asarray(found.value, float), every)
    mask = np.array(actuated_mask(robot))
    states = np.concatenate([poses, every[:, ~mask]], axis=1)
    own = dataclasses.replace(model, readings=every[:, mask])
    slopes = own.evaluated(np.zeros(len(model.unknowns.names)), states).closure_slopes[0]
    usable = np.isfinite(model.readings).all(axis=1)
    return Starts(states, np.where(usable, np.linalg.slogdet(slopes)[0], np.nan))


@run_once
def joints_at(robot: Mechanism, poses: jax.Array) -> Solution:
    """Inverse kinematics of poses ``(n, d)``."""
    return jax.vmap(partial(inverse_kinematics, robot))(poses)


def _solved(matrices: np.ndarray, right: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Solutions of many small systems where they are wanted and there is one, else zero."""
    regular = where & (np.linalg.slogdet(np.where(where[:, None, None], matrices, 0))[0] != 0)
    safe = np.where(regular[:, None, None], matrices, np.eye(matrices.shape[1]))
    return np.where(regular[:, None, None], np.linalg.solve(safe, np.where(regular[:, None, None], right, 0)), 0)


@partial(run_once, static_argnames="function")
def _evaluate(
    function: Callable[..., jax.Array],
    nominal: Nominal,
    places: jax.Array,
    prior: jax.Array,
    values: jax.Array,
    readings: jax.Array,
    targets: jax.Array,
    states: jax.Array,
) -> _Evaluated:
    """Residual of the closure and deviation at given states, with their derivatives by state and unknowns."""
    flat, rebuild = ravel_pytree(nominal)
    size = nominal.robot.space.dimension

    def one(readings: jax.Array, target: jax.Array, state: jax.Array) -> _Evaluated:
        now = rebuild(flat.at[places].add(prior * values))
        seen = shown(function, now.measure, now.robot, state[:size])
        target = jnp.where(jnp.isfinite(target), target, seen)  # what is not measured deviates by nothing

        def equations(state: jax.Array, values: jax.Array):
            robot, offsets, measure = rebuild(flat.at[places].add(prior * values))
            position, rotation = robot.space.place(state[:size])
            every = all_joints(robot, readings + offsets, State(position, rotation, tuple(state[size:])))
            closed = closure(robot, robot.legs(), every, position, rotation)
            both = jnp.stack(closed), deviation(function, measure, robot, state[:size], target)
            return both, both

        slopes, both = jax.jacfwd(equations, (0, 1), has_aux=True)(state, values)
        return _Evaluated(both[0], slopes[0], both[1], slopes[1])

    return jax.vmap(one)(readings, targets, states)
