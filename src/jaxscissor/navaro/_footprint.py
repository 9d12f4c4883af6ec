"""Encumbrance: the ground that the legs of NaVARo II sweep, with scissors and with prismatic legs."""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.pytree import pytree
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.regions._samples import PosesLike
from jaxscissor.robots._navaro import NavaroII


@pytree
class SweptArea:
    """Ground swept by each leg, seen from above: a star-shaped region about its anchor.

    Attributes:
      directions: ``(k,)`` about the anchor, radians.
      reach: ``(3, k)`` how far from its anchor each leg comes in each of them; zero where it never does.
      areas: ``(3,)`` in the squared unit of length.
    """

    directions: np.ndarray
    reach: np.ndarray
    areas: np.ndarray


def swept_area(
    robot: NavaroII, poses: PosesLike, leg: Literal["scissor", "prismatic"] = "scissor", *, directions: int = 360
) -> SweptArea:
    """Ground that the axes of the legs sweep over a set of poses, seen along the axis of rotation.

    The scissors of NaVARo II stand upright [NAV19 1], so that from above a leg is the line from its anchor to the
    platform. A prismatic leg of the same range has a rod as long as the greatest length, which slides through a
    block that turns on the anchor: what is not in front of the anchor sticks out behind. Widths are left out.

    Args:
      robot: with a stroke that ends.
      poses: ``(n, 3)`` poses or a sample of a region, many per direction: the reach is the largest one met.
      leg: what the legs are.
      directions: sectors about each anchor; each counts as far as its largest reach, so that few overestimate.

    Returns:
      ``navaro.SweptArea``.

    Raises:
      ValueError: an unknown leg, or a stroke without end.

    Example:
      >>> import jaxscissor as js, numpy as np
      >>> robot = js.NavaroII.prototype()
      >>> poses = js.Disc([45.0, 15 * np.sqrt(3)], 25.0, -np.pi / 2, np.pi / 2).quasi_random(20_000)
      >>> scissor, prismatic = (js.navaro.swept_area(robot, poses, leg).areas.sum() for leg in ("scissor", "prismatic"))
      >>> bool(prismatic > 1.3 * scissor)
      True
    """
    if leg not in ("scissor", "prismatic"):
        raise ValueError(f"Got leg={leg!r}; expected 'scissor' or 'prismatic'.")
    rod = float(robot.stroke[1])
    if not np.isfinite(rod):
        raise ValueError("Got a stroke without end; the rod of a prismatic leg needs a greatest length.")
    joints = np.asarray(jax.vmap(inverse_kinematics, (None, 0))(robot, jnp.asarray(poses)).value)
    reach = np.zeros((3, directions))
    for number, (turns, lengths) in enumerate(zip(joints[:, 0::2].T, joints[:, 1::2].T, strict=True)):
        _widen(reach[number], turns, lengths)
        if leg == "prismatic":
            _widen(reach[number], turns + np.pi, rod - lengths)
    middles = (np.arange(directions) + 0.5) * 2 * np.pi / directions
    return SweptArea(middles, reach, np.sum(reach**2, axis=1) * np.pi / directions)


def _widen(reach: np.ndarray, turns: np.ndarray, lengths: np.ndarray) -> None:
    sectors = (turns % (2 * np.pi) * len(reach) / (2 * np.pi)).astype(int) % len(reach)
    np.maximum.at(reach, sectors, lengths)
