"""What measurements can tell about a robot's dimensions, and what they cannot, by name."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import qr

from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.types import Numbers, PyTree
from jaxscissor.calibration._measures import Measure
from jaxscissor.calibration._model import Linear, Model, modeled, starts_of
from jaxscissor.kinematics import Status
from jaxscissor.robots._contract import Mechanism

_NEGLIGIBLE = 0.05  # a dimension's share of a direction that is not worth naming
_LISTED = 4  # rows of a printed table


@pytree
class Identifiability:
    """What measurements tell about the dimensions, in units of what is known of them beforehand.

    Attributes:
      prior: ``(p,)`` standard deviations beforehand.
      singular_values: ``(p,)`` of the measured numbers by the dimensions, largest first: noise over prior is one over
        them. A combination of dimensions is seen where its value is above one (and above rounding).
      directions: ``(p, p)`` the combinations, a row each, in units of the prior.
      deviations: ``(p,)`` standard deviations of the dimensions after the measurement; combinations that are not
        seen are as uncertain as beforehand.
      status: ``(n,)`` a ``Status`` code for every measurement, of which only those that ``CONVERGED`` count.
      names: of the dimensions.
      rank: how many combinations are seen.
      unseen: the others, each as a sum of dimensions in units of their prior. They are chosen so that each has a
        dimension of its own: hold that one at its value, and the rest is seen.
    """

    prior: Any
    singular_values: Any
    directions: Any
    deviations: Any
    status: Any
    names: tuple[str, ...] = static()
    rank: int = static()
    unseen: tuple[str, ...] = static()

    def __repr__(self) -> str:
        """What is seen, what is not, and the dimensions that are known worst compared with beforehand."""
        if not isinstance(self.singular_values, np.ndarray):
            return f"Identifiability(names={self.names})"
        good, values = int(np.sum(self.status == Status.CONVERGED)), self.singular_values
        least = f", the least {values[self.rank - 1]:.3g}" if self.rank else ""
        lines = [
            f"Identifiability: {self.rank} of {len(self.names)} combinations are seen in {good} of {len(self.status)} "
            f"poses; the greatest singular value is {values[0]:.3g}{least}",
            *listed("not seen", together(self.unseen)),
        ]
        share = self.deviations / self.prior
        order = [int(i) for i in np.argsort(-share, kind="stable") if share[i] < 1 - 1e-9]
        shown = [f"{self.names[i]} to {self.deviations[i]:.2g} ({share[i]:.1%} of the prior)" for i in order]
        return "\n".join([*lines, *listed("seen worst", shown)])


def identifiability(
    robot: Mechanism,
    joints: Numbers,
    *,
    prior: PyTree = None,
    sigma: Numbers,
    offsets: Numbers = 0.0,
    measure: Measure | None = None,
    guess: Numbers | None = None,
) -> Identifiability:
    """What measurements at given joints would tell about the dimensions: rank, singular values, what is not seen.

    The derivatives of the measured numbers by the dimensions, in units of noise and prior, are decomposed into singular
    values [Golub and Van Loan, Matrix computations, 5.5]; every pose gives as many equations as numbers are measured,
    whatever the loops of the robot [Hollerbach and Wampler, The calibration index, IJRR 15, 1996]. Runs on the host, as
    ``identify`` does.

    Args:
      robot, prior, sigma, offsets, measure, guess: as of ``identify``.
      joints: ``(n, m)`` actuated joints.

    Returns:
      ``calibration.Identifiability``; print it for a summary.

    Raises:
      ValueError: as ``identify``.

    Example:
      >>> import numpy as np, jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> near = robot.home()[1][None] + 0.1 * np.sin(np.arange(30)).reshape(5, 6)
      >>> found = js.calibration.identifiability(robot, near, offsets=1e-3, sigma=1e-4)
      >>> found.rank, found.names[0]
      (6, 'offsets[0]')
    """
    model = modeled(robot, joints, None, prior=prior, sigma=sigma, offsets=offsets, measure=measure)
    linear = model.at(np.zeros(len(model.unknowns.names)), starts_of(model, guess))
    counted = np.ones_like(model.missing) & (linear.status == Status.CONVERGED)[:, None]
    return decomposed(model, linear, counted.astype(float))


def decomposed(model: Model, linear: Linear, weights: np.ndarray) -> Identifiability:
    """Singular values and directions of the weighted numbers ``(n, k)``."""
    rows = rows_of(linear.jacobian, weights)
    count = rows.shape[1]
    size = max(rows.shape)
    rows = np.concatenate([rows, np.zeros((max(count - len(rows), 0), count))])  # of few equations, too, all directions
    _, values, directions = np.linalg.svd(np.linalg.qr(rows, mode="r"))
    rounding = 16 * size * float(np.finfo(model.nominal.offsets.dtype).eps) * values[0]
    rank = int(np.sum(values > max(1.0, rounding)))
    spread = np.where(np.arange(count) < rank, 1 / np.where(values > 0, values, 1), 1.0)
    names = model.unknowns.names
    return Identifiability(
        prior=model.unknowns.prior,
        singular_values=values,
        directions=directions,
        deviations=model.unknowns.prior * np.sqrt(np.sum((spread[:, None] * directions) ** 2, axis=0)),
        status=linear.status,
        names=names,
        rank=rank,
        unseen=_named(directions[rank:], names),
    )


def rows_of(jacobian: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The derivatives ``(equations, p)`` of the numbers that count."""
    counted = weights > 0
    return jacobian[counted] * np.sqrt(weights[counted])[:, None]


def listed(title: str, rows: list[str] | tuple[str, ...]) -> list[str]:
    """Lines with the first few of the rows."""
    more = [f"    and {len(rows) - _LISTED} more"] if len(rows) > _LISTED else []
    return [f"  {title}:", *(f"    {row}" for row in rows[:_LISTED]), *more] if rows else []


def together(unseen: tuple[str, ...]) -> list[str]:
    """Rows of a table of what is not seen, single dimensions in one."""
    alone = [name for name in unseen if " + " not in name and " - " not in name]
    return [name for name in unseen if name not in alone] + ([", ".join(alone)] if alone else [])


def _named(unseen: np.ndarray, names: tuple[str, ...]) -> tuple[str, ...]:
    """The directions ``(q, p)`` as sums of few dimensions.

    Any basis of what is not seen is as good as another. This one, by elimination with the pivots of a QR decomposition,
    has in every direction one dimension that no other has [Gautier, Numerical calculation of the base inertial
    parameters, 1991].
    """
    if not len(unseen):
        return ()
    order = np.asarray(qr(unseen, mode="r", pivoting=True)[-1])
    own = np.sort(order[: len(unseen)])
    basis = np.linalg.solve(unseen[:, own], unseen)
    return tuple(_sum_of(direction, names) for direction in basis)


def _sum_of(direction: np.ndarray, names: tuple[str, ...]) -> str:
    """Such as ``link_lengths[1] - 0.5 link_lengths[2]``."""
    shares = direction / np.abs(direction).max()
    large = [(share, name) for share, name in zip(shares, names, strict=True) if abs(share) > _NEGLIGIBLE]
    text = ""
    for share, name in large:
        sign = "" if not text else " + " if share * large[0][0] > 0 else " - "
        text += sign + ("" if abs(abs(share) - 1) < 0.005 else f"{abs(share):.2g} ") + name
    return text
