"""Names for the types of arguments: what an array holds, and its shape.

The type of a JAX array does not know its shape. These aliases do: ``(d,)`` are the coordinates of a pose, ``(n,)`` all
joints, ``(m,)`` the actuated ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

from jax.typing import ArrayLike

Numbers: TypeAlias = ArrayLike | Sequence[ArrayLike] | Sequence[Sequence[ArrayLike]]
"""Numbers of any shape: an array, or lists of numbers."""
Number: TypeAlias = ArrayLike
"""``()``, one number."""
PoseLike: TypeAlias = ArrayLike | Sequence[ArrayLike]
"""``(d,)``, the coordinates of a pose."""
JointsLike: TypeAlias = ArrayLike | Sequence[ArrayLike]
"""``(n,)``, all joints."""
ActuatedLike: TypeAlias = ArrayLike | Sequence[ArrayLike]
"""``(m,)``, the actuated joints."""
TwistLike: TypeAlias = ArrayLike | Sequence[ArrayLike]
"""``(d,)``, a velocity of the reference point and an angular velocity."""
PyTree: TypeAlias = Any
"""Arrays in containers of any kind, such as a state between two steps, or the totals of a sum."""
