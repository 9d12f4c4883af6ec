"""A robot's dimensions and the zeros of its joint sensors, from measurements of its platform."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.types import Numbers, PyTree
from jaxscissor.calibration._identifiability import Identifiability, decomposed, listed, rows_of, together
from jaxscissor.calibration._measures import Measure
from jaxscissor.calibration._model import Linear, Model, modeled, starts_of
from jaxscissor.kinematics import Status
from jaxscissor.robots._contract import Mechanism

_SETTLED = 1e-6  # a step, in standard deviations of what is identified, after which there is no other
_ROUNDING = 1e-2  # a step that does not lower the cost is one of rounding if it is shorter than this


@pytree
class Calibration:
    """A robot as it was made, and how well it is known.

    Attributes:
      robot: the calibrated robot, of the type given.
      offsets: ``(m,)`` what is to be added to the readings of the actuated joints.
      measure: the measure given, its numbers calibrated; ``None`` if it holds none.
      changes: ``(p,)`` what was added to the dimensions.
      covariance: ``(p, p)`` of the dimensions; what is not seen is as uncertain as beforehand.
      residuals: ``(n, k)`` measured less shown by the calibrated robot, in units of ``sigma``; of poses the twist;
        ``nan`` where nothing counts.
      initial_residuals: the same of the robot given.
      weights: ``(n, k)`` zero where missing, one, and less for numbers beyond ``outlier``.
      chi_square: sum of the squared residuals in units of sigma, none counted as more than ``outlier``.
      pose_status: ``(n,)`` a ``Status`` code for every measurement; those at which the robot given was not assembled
        did not count.
      identifiability: what these measurements tell; ``calibration.Identifiability`` at the robot given.
      degrees: degrees of freedom of chi-square: numbers measured less combinations identified.
      steps: taken.
      status: ``CONVERGED``; ``MAX_STEPS``; if nothing that was measured could be used, the largest of ``pose_status``,
        or ``NONFINITE``.
    """

    robot: Any
    offsets: Any
    measure: Any
    changes: Any
    covariance: Any
    residuals: Any
    initial_residuals: Any
    weights: Any
    chi_square: Any
    pose_status: Any
    identifiability: Identifiability
    degrees: int = static()
    steps: int = static()
    status: Status = static()

    @property
    def ok(self) -> bool:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED

    def __repr__(self) -> str:
        """Fit, greatest changes, and what was left as it was."""
        if not isinstance(self.changes, np.ndarray):
            return f"Calibration(names={self.identifiability.names})"
        seen, deviations = self.identifiability, np.sqrt(np.diagonal(self.covariance))
        before, after = (_median(part) for part in (self.initial_residuals, self.residuals))
        used = int(np.sum(self.weights > 0))
        far = int(np.sum((self.weights < 1) & (self.weights > 0)))
        order = [int(i) for i in np.argsort(-np.abs(self.changes / seen.prior), kind="stable") if self.changes[i]]
        changed = [f"{seen.names[i]}: {self.changes[i]:+.4g} +- {deviations[i]:.2g}" for i in order]
        lines = [
            f"Calibration: {self.status.name} in {self.steps} steps; {seen.rank} of {len(seen.names)} combinations of "
            f"dimensions from {used} numbers of {int(np.sum(self.pose_status == Status.CONVERGED))} poses",
            f"  median deviation {before:.3g} sigma before, {after:.3g} after; chi-square {self.chi_square:.4g} for "
            f"{self.degrees} degrees of freedom; {far} numbers count less",
            *listed("greatest changes", changed),
            *listed("not seen, left as they were", together(seen.unseen)),
        ]
        return "\n".join(lines)


def identify(
    robot: Mechanism,
    joints: Numbers,
    measured: Numbers,
    *,
    prior: PyTree = None,
    sigma: Numbers,
    offsets: Numbers = 0.0,
    measure: Measure | None = None,
    guess: Numbers | None = None,
    outlier: float = 3.0,
    max_steps: int = 100,
) -> Calibration:
    """Dimensions of a robot and zeros of its joint sensors that explain what was measured of its platform.

    1. Every dimension is scaled by its prior standard deviation, every measured number by its own. The platform is
       assembled with the joints read, and the measured numbers are differentiated by the implicit function theorem.
    2. Combinations of dimensions whose singular value is below one, which the data tell less well than was known
       beforehand, stay at their nominal values: a truncated singular value decomposition. It is chosen once, at the
       robot given.
    3. The rest is found by the method of Levenberg and Marquardt [Nocedal and Wright, Numerical optimization, 10.3],
       the damping of which begins as the prior itself.
    4. Numbers further from the model than ``outlier`` standard deviations count linearly, which is Huber's loss, by
       weights renewed at every step [Huber, Robust statistics, 7.8].

    Runs on the host, with the derivatives as one compiled program for every shape of the data: not under ``jit``,
    ``vmap`` or a derivative. Use double precision.

    Args:
      robot: as it is known beforehand. For dimensions of each leg give ``js.per_leg(robot)``.
      joints: ``(n, m)`` the actuated joints as their sensors read them.
      measured: ``(n, k)`` what was measured; ``nan`` where nothing was. Readings or numbers that are not finite never
        raise, and count nothing.
      prior: standard deviations of the dimensions, as far as they are to be calibrated: by name, such as
        ``{"top_radius": 1e-3}``, of fields of the robot (of one made by ``per_leg`` those of its copies) or of the
        measure, with values that broadcast; or a container like the robot, of one made by ``per_leg`` as
        ``design.tolerances`` gives it; or one number for all dimensions of the robot.
      sigma: standard deviations of the measured numbers, one, ``(k,)`` or ``(n, k)``; of poses, those of the twist:
        of translation, then of rotation.
      offsets: prior standard deviations of the joint sensors' zeros, ``(m,)`` or one for all; joints are readings plus
        offsets.
      measure: what was measured: a function ``(robot, pose) -> (k,)``, ``calibration.Markers`` or
        ``calibration.heights``; a ``pytree`` with such a ``__call__`` can be calibrated itself. It is kept with its
        program: give the same function again and nothing compiles. Default: poses, compared as twists.
      guess: ``(n, d)`` or ``(d,)`` poses near which the platform was. Default: measured poses, or home. They choose
        the assembly mode.
      outlier: in standard deviations; ``inf`` is plain least squares.
      max_steps: before giving up.

    Returns:
      ``calibration.Calibration``; print it for a summary.

    Raises:
      ValueError: wrong shapes; unknown names in ``prior``; nothing to calibrate; a robot with more or fewer actuated
        joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> pose, joints = robot.home()
      >>> found = js.calibration.identify(robot, joints[None] - 2e-3, pose[None], sigma=1e-4, offsets=1e-2)
      >>> [round(float(offset), 4) for offset in found.offsets]
      [0.002, 0.002, 0.002, 0.002, 0.002, 0.002]
    """
    if not outlier > 0 or max_steps < 1:
        raise ValueError(f"Got outlier={outlier} and max_steps={max_steps}; expected positive numbers.")
    model = modeled(robot, joints, measured, prior=prior, sigma=sigma, offsets=offsets, measure=measure)
    origin = np.zeros(len(model.unknowns.names))
    linear = model.at(origin, starts_of(model, guess))
    counted = (~model.missing & (linear.status == Status.CONVERGED)[:, None]).astype(float)
    seen = decomposed(model, linear, counted)
    basis = seen.directions[: seen.rank].T
    values, end, steps, settled = _fit(model, linear, counted, basis, outlier, max_steps)
    status = Status.CONVERGED if settled else Status.MAX_STEPS
    if not counted.any():
        status = Status(int(np.max(linear.status))) or Status.NONFINITE
    weights = counted * _weights(end, outlier)
    known = model.unknowns.applied(model.nominal, model.unknowns.prior * values)
    return Calibration(
        robot=known.robot,
        offsets=known.offsets,
        measure=known.measure[0] if known.measure else None,
        changes=model.unknowns.prior * values,
        covariance=_covariance(model, end, weights, seen),
        residuals=np.where(counted > 0, end.deviations, np.nan),
        initial_residuals=np.where(counted > 0, linear.deviations, np.nan),
        weights=weights,
        chi_square=np.sum(np.minimum(np.abs(end.deviations[counted > 0]), outlier) ** 2),
        pose_status=linear.status,
        identifiability=seen,
        degrees=int(np.sum(counted)) - seen.rank,
        steps=steps,
        status=status,
    )


def _fit(
    model: Model,
    linear: Linear,
    counted: np.ndarray,
    basis: np.ndarray,
    outlier: float,
    max_steps: int,
) -> tuple[np.ndarray, Linear, int, bool]:
    """Values of the unknowns, the deviations there, number of steps, and whether it settled."""
    values, cost, damping = np.zeros(len(basis)), _cost(linear, counted, outlier), 1.0
    for step in range(1, max_steps + 1):
        weights = counted * _weights(linear, outlier)
        rows = rows_of(linear.jacobian, weights) @ basis
        off = linear.deviations[weights > 0] * np.sqrt(weights[weights > 0])
        damped = np.concatenate([rows, np.sqrt(damping) * np.eye(basis.shape[1])])
        move = np.linalg.lstsq(damped, np.concatenate([-off, np.zeros(basis.shape[1])]), rcond=None)[0]
        size = float(np.linalg.norm(rows @ move))
        trial = model.at(values + basis @ move, linear.starts)
        trial_cost = _cost(trial, counted, outlier)
        better = trial_cost < cost
        if better:
            values, linear, cost, damping = values + basis @ move, trial, trial_cost, damping / 10
        else:
            damping = damping * 10
        if size <= _SETTLED or (not better and size <= _ROUNDING):
            return values, linear, step, True
    return values, linear, max_steps, False


def _weights(linear: Linear, outlier: float) -> np.ndarray:
    """Huber's weights."""
    size = np.abs(linear.deviations)
    return np.minimum(1.0, outlier / np.where(size > 0, size, 1.0)) if np.isfinite(outlier) else np.ones_like(size)


def _cost(linear: Linear, counted: np.ndarray, outlier: float) -> float:
    """Huber's loss; infinite where a pose that counts cannot be assembled any more."""
    counts = counted.any(axis=1)
    if np.any(linear.status[counts] != Status.CONVERGED):
        return np.inf
    size = np.abs(linear.deviations[counted > 0])
    near = np.minimum(size, outlier)
    return float(np.sum(near * size - near**2 / 2))


def _median(residuals: np.ndarray) -> float:
    """Median size of what counts."""
    return float(np.median(np.abs(residuals[np.isfinite(residuals)]))) if np.isfinite(residuals).any() else np.nan


def _covariance(model: Model, linear: Linear, weights: np.ndarray, seen: Identifiability) -> np.ndarray:
    """Of what is seen by the noise, of what is not by the prior."""
    basis, rest = seen.directions[: seen.rank].T, seen.directions[seen.rank :].T
    triangle = np.linalg.qr(rows_of(linear.jacobian, weights) @ basis, mode="r")
    known = basis @ np.linalg.inv(triangle) if seen.rank else np.zeros((len(basis), 0))
    scaled = np.concatenate([known, rest], axis=1) * model.unknowns.prior[:, None]
    return scaled @ scaled.T
