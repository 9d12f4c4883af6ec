"""Planning of actuation modes: which joints drive a robot along a path, so that it keeps clear of singularities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.types import Numbers
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism
from jaxscissor.singularities._aspects import between, least_between, usable_type2


@pytree
class ModePlan:
    """Modes along a path ``(n, d)``.

    Attributes:
      status: ``PLANNED``, ``NO_CLEAR_MODE`` or ``OUT_OF_REACH``.
      modes: ``(n,)`` the mode in which each pose is left, and the last one reached; ``(0,)`` unless ``PLANNED``.
      switches: ``(k,)`` numbers of the poses at which the mode changes; both modes are clear there.
      worst: least magnitude of the type-2 measure of the modes in use; ``nan`` unless ``PLANNED``.
      blocked: ``(b,)`` numbers of the poses from which no mode leads clearly to the next.
      attainable: the largest min_type2 for which a plan exists; ``nan`` if the path is out of reach.
      type2: ``(n, modes)`` the measure of every mode, in the order given; ``nan`` out of reach.
    """

    status: Status = static()
    modes: np.ndarray
    switches: np.ndarray
    worst: float
    blocked: np.ndarray
    attainable: float
    type2: np.ndarray


def plan_modes(robots: Mapping[int, Mechanism], path: Numbers, *, min_type2: float) -> ModePlan:
    """The sequence of actuation modes with the fewest switches that keeps a path clear of type-2 singularities.

    Among plans with equally few switches the one with the largest worst measure is chosen; both are exact, by
    dynamic programming. A mode may be used from one pose to the next if its measure has one sign and at least the
    min_type2 at both, in the middle between them, and on the parabola through the three; so sample the path
    densely. Modes change at poses, where both are clear and the platform may rest while the clutches work.

    Args:
      robots: the robot in each of its modes, by the mode's number.
      path: ``(n, d)`` poses, at least two, joined by straight lines in their coordinates.
      min_type2: least magnitude of the type-2 measure, positive.

    Returns:
      ``singularities.ModePlan``.

    Raises:
      ValueError: no robots, a path of fewer than two poses or of the wrong shape, or a min_type2 that is not positive.

    Example:
      Straight through alpha = 0 over the middle, where mode 8 is singular [NAV19 eq. 38]:

      >>> import numpy as np, jaxscissor as js
      >>> path = np.linspace([45.0, 26.0, 0.6], [45.0, 26.0, -0.6], 25)
      >>> robots = {mode: js.NavaroII.prototype(mode) for mode in (1, 8)}
      >>> plan = js.singularities.plan_modes(robots, path, min_type2=0.05)
      >>> plan.status.name, plan.modes[0].item(), len(plan.switches)
      ('PLANNED', 1, 0)
    """
    path = np.asarray(path, float)
    if not robots:
        raise ValueError("Got no robots; expected the robot in each of its modes, as {mode: robot}.")
    dimension = next(iter(robots.values())).space.dimension
    if path.ndim != 2 or len(path) < 2 or path.shape[1] != dimension:
        raise ValueError(f"Got a path of shape {path.shape}; expected (n, {dimension}) with at least two poses.")
    if not min_type2 > 0:
        raise ValueError(f"Got min_type2={min_type2}; expected a positive number: singular poses have zero.")
    values = np.stack([usable_type2(robot, between(path, 2)) for robot in robots.values()], axis=1)
    start, middle, end = values[:-1:2], values[1::2], values[2::2]
    sign = np.sign(start)
    worth = np.nan_to_num(least_between(sign * start, sign * end, sign * middle), nan=-np.inf)
    blocked = np.flatnonzero(worth.max(axis=1) < min_type2)
    lost = bool(np.isnan(values).all(axis=1).any())
    attainable = np.nan if lost else max(float(worth.max(axis=1).min()), 0.0)
    none = np.zeros(0, int)
    if lost or blocked.size:
        status = Status.OUT_OF_REACH if lost else Status.NO_CLEAR_MODE
        return ModePlan(status, none, none, np.nan, blocked, attainable, values[::2])
    columns, worst = fewest_switches(worth, min_type2)
    modes = np.array(list(robots))[np.append(columns, columns[-1])]
    switches = np.flatnonzero(np.diff(modes)) + 1
    return ModePlan(Status.PLANNED, modes, switches, worst, none, attainable, values[::2])


def fewest_switches(worth: np.ndarray, min_type2: float) -> tuple[np.ndarray, float]:
    """Column of each row ``(n, modes)`` with entries >= min_type2, of fewest changes, then of largest least entry.

    Every row has such an entry. Both aims are those of the last row given the ones before, so that the best way to
    each column is enough to know: fewer changes win, and a larger least entry never harms.
    """
    usable = worth >= min_type2
    columns = np.arange(worth.shape[1])
    changes, least = np.where(usable[0], 0, len(worth)), worth[0]
    came = np.zeros(worth.shape, int)
    for row in range(1, len(worth)):
        best = _best(changes, least)
        stay = (changes < changes[best] + 1) | ((changes == changes[best] + 1) & (least >= least[best]))
        came[row] = np.where(stay, columns, best)
        changes = np.where(usable[row], np.where(stay, changes, changes[best] + 1), len(worth))
        least = np.minimum(least[came[row]], worth[row])
    column = _best(changes, least)
    chosen = [column]
    for row in range(len(worth) - 1, 0, -1):
        chosen.append(came[row, chosen[-1]])
    return np.array(chosen[::-1]), float(least[column])


def _best(changes: np.ndarray, least: np.ndarray) -> int:
    return int(np.lexsort((-least, changes))[0])
