"""The optimizers to choose from."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import TYPE_CHECKING

from jaxscissor.design._augmented_lagrangian import lagrangian_init, lagrangian_step
from jaxscissor.design._problem import Evaluate, Solver
from jaxscissor.design._scaling import sampled_slopes
from jaxscissor.design._sqp import linearizer, sqp_init, sqp_step

if TYPE_CHECKING:
    import optax


@dataclasses.dataclass(frozen=True)
class SQP:
    """Sequential quadratic programming with exact first derivatives of every constraint, and a BFGS Hessian.

    It ends on the constraints that bind, within rounding, after some tens of steps. Each parameter costs one forward
    derivative of objective and constraints, so that it suits up to about a hundred of them.

    Example:
      >>> import jaxscissor as js
      >>> result = js.design.optimize(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=9, method=SQP())
      >>> round(float(result.params), 6)
      1.0
    """

    def solver(self, evaluate: Evaluate, steps: int, comparable: bool) -> Solver:
        """The programs for a problem."""
        linearize = linearizer(evaluate)
        return Solver(linearize, partial(sqp_init, evaluate=evaluate), sqp_step(linearize))


@dataclasses.dataclass(frozen=True)
class AugmentedLagrangian:
    """An augmented Lagrangian, whose gradient is given to an optimizer of optax; steps are projected onto the bounds.

    Args:
      optimizer: of optax, acting on parameters scaled to [0, 1]; ``optax.lbfgs()`` will do. Default: Adam, with a
        learning rate that decays from 0.03 by a cosine over the steps.

    Raises:
      ValueError: an optimizer that is not one of optax.

    Example:
      >>> import jaxscissor as js, optax
      >>> method = AugmentedLagrangian(optax.adam(0.05))
      >>> result = js.design.optimize(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50, method=method)
      >>> round(float(result.params), 3)
      1.0
    """

    optimizer: optax.GradientTransformation | None = None

    def __post_init__(self):
        if self.optimizer is not None and not hasattr(self.optimizer, "update"):
            raise ValueError(f"Got optimizer={self.optimizer!r}; expected one of optax, such as optax.adam(0.01).")

    def solver(self, evaluate: Evaluate, steps: int, comparable: bool) -> Solver:
        """The programs for a problem."""
        import optax

        optimizer = self.optimizer or optax.adam(optax.cosine_decay_schedule(0.03, steps, 0.02))
        init = partial(lagrangian_init, optimizer=optimizer, evaluate=evaluate)
        return Solver(sampled_slopes(evaluate), init, lagrangian_step(evaluate, optimizer, comparable=comparable))


Method = SQP | AugmentedLagrangian


def checked_method(method: Method | None, default: Method) -> Method:
    """The method, or the default if none is given.

    Raises:
      ValueError: something else, such as an optimizer of optax by itself.
    """
    if method is None:
        return default
    if not isinstance(method, SQP | AugmentedLagrangian):
        raise ValueError(
            f"Got method={method!r}; expected design.SQP(), or design.AugmentedLagrangian(optimizer) with an "
            "optimizer of optax."
        )
    return method
