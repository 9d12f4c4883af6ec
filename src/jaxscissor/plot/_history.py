"""The course of an optimization."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jaxscissor.design._optimize import DesignResult
from jaxscissor.plot._robot import LEG_COLORS
from jaxscissor.plot._slices import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def history(result: DesignResult, *, ax: Axes | None = None, label: str = "objective") -> Axes:
    """Objective over the steps of an optimization, a line per start; hollow where constraints are violated.

    Args:
      result: of ``design.optimize``.
      ax: axes to draw on; default: new ones.
      label: of the vertical axis.

    Returns:
      The axes.

    Example:
      >>> import jaxscissor as js
      >>> result = js.design.optimize(lambda x: x**2, 0.5, bounds=(-1.0, 1.0), steps=3)
      >>> len(history(result).lines)  # what keeps the constraints, and what does not
      2
    """
    ax = new_axes(ax, spatial=False)
    values, violated = np.asarray(result.history.objective), np.asarray(result.history.violation) > 1e-3
    steps = np.arange(len(values))
    for start, (column, off) in enumerate(zip(values.T, violated.T, strict=True)):
        color = LEG_COLORS[start % len(LEG_COLORS)]
        ax.plot(steps, column, color=color, linewidth=1.2)
        ax.plot(steps[off], column[off], "o", color=color, markerfacecolor="white", markersize=4)
    ax.set_xlabel("step")
    ax.set_ylabel(label)
    return ax
