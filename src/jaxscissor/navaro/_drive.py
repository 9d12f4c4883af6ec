"""The drive of a NaVARo II leg: one motor, which two clutches connect to the leg's turn and to its screw [NAV19 2]."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity, unchecked
from jaxscissor._engine.types import JointsLike, PyTree
from jaxscissor.robots._navaro import ACTUATION_MODES
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._topology import Topology


class Clutch(enum.IntEnum):
    """Which of a leg's two clutches are engaged: the four actuation schemes of [NAV19 2].

    Clutch 1 connects the motor to the leg's turn theta, clutch 2 to the screw that stretches its scissor; the
    numbers are their bits, ``1`` and ``2``.

    Example:
      >>> Clutch(Clutch.REVOLUTE | Clutch.PRISMATIC).name
      'COUPLED'
    """

    FREE = 0
    REVOLUTE = 1
    PRISMATIC = 2
    COUPLED = 3


@pytree
class DriveTrain:
    """The two gear trains of one leg, from the motor to theta and, by the screw at mu, to rho.

    The screw narrows the scissor by ``lead`` per turn, so that a positive motor angle stretches the leg.
    Joints are (theta, rho); the passive ones keep the values they are given. Limits are the robot's.

    Args:
      scissor: of the leg, open; ``NavaroII.scissor`` has it. Its width is the screw's position mu.
      turn_ratio: motor angle per theta.
      screw_ratio: motor angle per angle of the screw.
      lead: advance of the screw per turn, in the scissor's unit of length.

    Raises:
      ValueError: a ratio or lead that is not one number, or not positive and finite.

    Example:
      >>> import jaxscissor as js
      >>> drive = DriveTrain(js.NavaroII.prototype().scissor, turn_ratio=50.0, screw_ratio=1.0, lead=0.5)
      >>> theta, rho = drive.joints(Clutch.REVOLUTE, jnp.pi * 25, [0.0, 40.0])  # motor radians
      >>> round(float(theta), 4), float(rho)
      (1.5708, 40.0)
    """

    scissor: Scissor
    turn_ratio: Any = quantity("")
    screw_ratio: Any = quantity("")
    lead: Any = quantity("")

    def __post_init__(self):
        names = ("turn_ratio", "screw_ratio", "lead")
        *_, lengths = values = as_arrays(*(getattr(self, name) for name in names), self.scissor.link_lengths)
        object.__setattr__(self, "scissor", unchecked(Scissor, link_lengths=lengths, end=self.scissor.end))
        for name, value in zip(names, values, strict=False):
            object.__setattr__(self, name, value)
            if value.shape != ():
                raise ValueError(
                    f"Got {name} of shape {value.shape}; expected one number. Map over legs with jax.vmap."
                )
            if is_concrete(value) and not (np.isfinite(value) and value > 0):
                raise ValueError(f"Got {name} = {value}; expected a positive, finite number.")

    @property
    def advance(self) -> Scalar:
        """How far the screw moves per radian of the motor."""
        return self.lead / (2 * math.pi * self.screw_ratio)

    def joints(self, clutch: Clutch | jax.Array, motor: Scalar, start: PyTree) -> jax.Array:
        """Joints after the motor has turned.

        Args:
          clutch: a ``navaro.Clutch``, or its number as an integer array.
          motor: angle of the motor since the clutches engaged, in radians.
          start: ``(2,)`` (theta, rho) at that moment; a passive joint at its present value instead.

        Returns:
          ``(2,)`` (theta, rho). ``FREE`` gives the start back.
        """
        motor, start = as_arrays(motor, start)
        turns, stretches = _engaged(clutch)
        theta, rho = start
        stretched = self.scissor.height(self.scissor.width(rho) - self.advance * motor)
        turned = theta + motor / self.turn_ratio
        return jnp.stack([jnp.where(turns, turned, theta), jnp.where(stretches, stretched, rho)])

    def tip(self, clutch: Clutch | jax.Array, motor: Scalar, start: PyTree) -> jax.Array:
        """Position ``(2,)`` of the leg's end B from its anchor A, with the arguments of ``joints``.

        With the passive joint at rest the end draws an arc (``REVOLUTE``), a straight line (``PRISMATIC``) or a
        spiral (``COUPLED``).
        """
        theta, rho = self.joints(clutch, motor, start)
        return rho * jnp.stack([jnp.cos(theta), jnp.sin(theta)])

    def gears(self, joints: JointsLike) -> jax.Array:
        """d(theta, rho) / d motor angle ``(2,)`` with both clutches engaged, at joints ``(2,)``."""
        (joints,) = as_arrays(joints)
        stretch = -self.scissor.gain(self.scissor.width(joints[1])) * self.advance
        return jnp.stack([1 / self.turn_ratio, stretch])

    def rates(self, clutch: Clutch | jax.Array, joints: JointsLike, motor_rate: Any) -> jax.Array:
        """Rates ``(2,)`` that the motor gives to (theta, rho); zero for a passive joint, whose rate is open."""
        return jnp.where(jnp.stack(_engaged(clutch)), self.gears(joints) * as_arrays(motor_rate)[0], 0)

    def motor_rates(self, joints: JointsLike, rates: Any) -> jax.Array:
        """Rates ``(2,)`` at which joint rates ``(2,)`` turn the motor's side of the two trains.

        An engaged clutch makes its rate the motor's; the difference to the motor's rate is the slip of one
        that is about to engage. With both engaged, only joint rates with equal entries are possible.
        """
        return as_arrays(rates)[0] / self.gears(joints)

    def with_equal_speeds(self, turning_at: Any, stretching_at: Any) -> DriveTrain:
        """The drive with the turn ratio that lets a motor rate move the leg's end equally fast in both schemes.

        [NAV19 2] wants similar maximum speeds and prints no ratio. Per radian of the motor the end moves by
        rho / turn_ratio as the leg turns, which grows with rho, and by (n^2 mu / rho) advance as it stretches,
        which falls. They are equal at one rho; equal maxima over a stroke are those at its greatest and its
        least length, for which the turn ratio is h / advance, with h the height of a bar.

        Args:
          turning_at: rho at which the turning leg is compared.
          stretching_at: rho at which the stretching leg is compared.
        """
        turning, stretching = as_arrays(turning_at, stretching_at)
        speed = self.gears(jnp.stack([jnp.zeros_like(stretching), stretching]))[1]
        fields = dict(scissor=self.scissor, screw_ratio=self.screw_ratio, lead=self.lead)
        return unchecked(DriveTrain, turn_ratio=turning / speed, **fields)


class DriveMobility(NamedTuple):
    """Degrees of freedom of NaVARo II's platform, counted; fewer than none means that many closures too many.

    Attributes:
      motors_free: with the motors turning as they like; every coupled leg takes one of three.
      motors_held: with the motors held; zero where the motors alone determine the pose.
    """

    motors_free: int
    motors_held: int


def drive_mobility(clutches: Sequence[int]) -> DriveMobility:
    """Mobility of NaVARo II under the clutch schemes of its three legs, by the Kutzbach criterion.

    It counts 8 links and 9 joints in the plane; an engaged clutch with its motor held locks a joint, and both
    clutches of a leg with its motor turning make one freedom of its two. The count holds at regular poses.

    Args:
      clutches: one ``navaro.Clutch`` per leg.

    Raises:
      ValueError: not three schemes, or an unknown one.

    Example:
      >>> drive_mobility([Clutch.FREE] * 3)
      DriveMobility(motors_free=3, motors_held=3)
      >>> drive_mobility([Clutch.REVOLUTE, Clutch.PRISMATIC, Clutch.PRISMATIC])
      DriveMobility(motors_free=3, motors_held=0)
      >>> drive_mobility([Clutch.COUPLED] * 3)
      DriveMobility(motors_free=0, motors_held=-3)
    """
    schemes = _checked(clutches)
    freely = [f for scheme in schemes for f in ((1, 0) if scheme == Clutch.COUPLED else (1, 1))]
    held = [0 if scheme & joint else 1 for scheme in schemes for joint in (Clutch.REVOLUTE, Clutch.PRISMATIC)]
    return DriveMobility(*(Topology(8, (*f, 1, 1, 1), dimension=3).mobility for f in (freely, held)))


def drive_mode(clutches: Sequence[int]) -> int | None:
    """The actuation mode 1 to 8 of NaVARo II that three clutch schemes are [NAV19 table 1], or ``None``.

    Args:
      clutches: one ``navaro.Clutch`` per leg; each leg of an actuation mode has one clutch engaged.

    Raises:
      ValueError: not three schemes, or an unknown one.

    Example:
      >>> drive_mode([Clutch.PRISMATIC, Clutch.PRISMATIC, Clutch.REVOLUTE])
      6
    """
    names = {Clutch.REVOLUTE: "theta", Clutch.PRISMATIC: "rho"}
    wanted = tuple(names.get(scheme) for scheme in _checked(clutches))
    return next((mode for mode, held in ACTUATION_MODES.items() if held == wanted), None)


def _engaged(clutch: Clutch | jax.Array) -> tuple[jax.Array, jax.Array]:
    number = jnp.asarray(clutch if hasattr(clutch, "dtype") else int(clutch))
    return (number & int(Clutch.REVOLUTE)) > 0, (number & int(Clutch.PRISMATIC)) > 0


def _checked(clutches: Sequence[int]) -> list[Clutch]:
    if len(clutches) != 3 or not all(int(clutch) in (0, 1, 2, 3) for clutch in clutches):
        raise ValueError(f"Got clutches={list(clutches)}; expected one Clutch (0 to 3) for each of three legs.")
    return [Clutch(int(clutch)) for clutch in clutches]
