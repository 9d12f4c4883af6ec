"""Pictures of design: compromises, what each dimension does, before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.types import PyTree
from jaxscissor.design._pareto import ParetoFront
from jaxscissor.design._result import DesignResult
from jaxscissor.plot._robot import LEG_COLORS
from jaxscissor.plot._slices import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HATCHES = "", "///", "...", "xxx"  # which tell metrics apart in grey
_NEGLIGIBLE = 1e-3  # share of the largest elasticity below which a dimension is left out


def front(front: ParetoFront, *, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Axes:
    """Compromises between two or three metrics, all to be minimized; what lies above and right is dominated.

    Args:
      front: of ``design.pareto_front``.
      labels: names of the metrics, with units.
      ax: axes to draw on, three-dimensional for three metrics; default: new ones.

    Returns:
      The axes. Of two metrics, the dominated part is grey.

    Raises:
      ValueError: an empty front, or one of more than three metrics.

    Example:
      >>> import jaxscissor as js
      >>> metrics = [lambda x: x**2, lambda x: (x - 1.0) ** 2]
      >>> found = js.design.pareto_front(metrics, 0.3, bounds=(-2.0, 2.0), steps=20, designs=10)
      >>> js.plot.front(found, labels=["to zero", "to one"]).get_ylabel()
      'to one'
    """
    values = np.asarray(front.values)
    if not len(values) or values.shape[1] not in (2, 3):
        raise ValueError(f"Got a front of shape {values.shape}; expected some designs with two or three metrics.")
    ax = new_axes(ax, spatial=values.shape[1] == 3)
    if values.shape[1] == 2:
        order = values[np.argsort(values[:, 0])]
        edge = np.vstack([order, [values[:, 0].max(), order[-1, 1]]])
        ax.fill_between(edge[:, 0], edge[:, 1], values[:, 1].max(), step="post", color="0.9", linewidth=0)
    ax.plot(*values.T, "o", color=LEG_COLORS[0], markersize=4)
    for axis, name in zip("xyz", labels or [f"metric {i + 1}" for i in range(values.shape[1])], strict=False):
        getattr(ax, f"set_{axis}label")(name)
    return ax


def sensitivity(robot: Any, metrics: Mapping[str, Callable[[Any], Any]], *, ax: Axes | None = None) -> Axes:
    """Elasticities of metrics: by how many per cent each changes where a dimension grows by one per cent.

    d ln(metric) / d ln(dimension) = dimension / metric * d metric / d dimension; of angles too, which are measured
    from zero. Dimensions that are zero or change nothing are left out.

    Args:
      robot: the robot, or any pytree of dimensions.
      metrics: by name, functions of it that are not zero there.
      ax: axes to draw on; default: new ones.

    Returns:
      The axes: a group of bars for every dimension, the largest on top.

    Raises:
      ValueError: no metrics, or one that is zero or not finite, or has such a derivative.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> ax = js.plot.sensitivity(robot, {"home height": lambda robot: robot.home()[0][2]})
      >>> len(ax.get_yticklabels()) > 3
      True
    """
    if not metrics:
        raise ValueError("Got no metrics; expected at least one, by name.")
    rows = dict(zip(metrics, (_elasticities(name, metric, robot) for name, metric in metrics.items()), strict=True))
    table = np.array([list(row.values()) for row in rows.values()])  # (metrics, dimensions)
    largest = np.abs(table).max(axis=0)
    names = np.array(list(next(iter(rows.values()))))
    shown = [i for i in np.argsort(largest) if largest[i] > _NEGLIGIBLE * largest.max()]
    ax = new_axes(ax, spatial=False)
    height = 0.8 / len(rows)
    for number, (name, values) in enumerate(zip(rows, table, strict=True)):
        color, hatch = LEG_COLORS[number % len(LEG_COLORS)], _HATCHES[number % len(_HATCHES)]
        places = np.arange(len(shown)) + 0.4 - (number + 0.5) * height
        ax.barh(places, values[shown], height, label=name, edgecolor="white", color=color, hatch=hatch)
    ax.axvline(0, color="black", linewidth=0.8)
    ax.set_axisbelow(True)
    ax.set_yticks(np.arange(len(shown)), names[shown])
    ax.set_xlabel("change of the metric by 1 % of the dimension (%)")
    ax.legend(frameon=False)
    return ax


def before_after(
    result: DesignResult, draw: Callable[[Any, Axes], Any], *, axes: Sequence[Axes] | None = None, spatial: bool = False
) -> Sequence[Axes]:
    """The robot given and the best one side by side, drawn alike and to the same scales.

    Args:
      result: of ``design.optimize``.
      draw: draws a robot on axes, such as ``lambda robot, ax: js.plot.robot(robot, ax=ax)``.
      axes: two axes to draw on; default: new ones.
      spatial: whether new axes are three-dimensional.

    Returns:
      The two axes, titled with the objective.

    Example:
      >>> import jaxscissor as js
      >>> result = js.design.optimize(lambda x: x**2, 0.5, bounds=(-1.0, 1.0), steps=3)
      >>> [ax.get_title() for ax in js.plot.before_after(result, lambda x, ax: ax.plot([0, x], [0, 1]))]
      ['before: 0.25', 'after: 0']
    """
    if axes is None:
        import matplotlib.pyplot as plt

        figure = plt.figure(layout="constrained")
        axes = [figure.add_subplot(1, 2, i, projection="3d" if spatial else None) for i in (1, 2)]
    cases = zip(axes, ("before", "after"), (result.initial, result.robot), result.objective, strict=True)
    for ax, name, robot, objective in cases:
        draw(robot, ax)
        ax.set_title(f"{name}: {float(objective):.4g}", fontsize="medium")
    for axis in ("x", "y", "z")[: 3 if axes[0].name == "3d" else 2]:
        limits = np.array([getattr(ax, f"get_{axis}lim")() for ax in axes])
        for ax in axes:
            getattr(ax, f"set_{axis}lim")(limits.min(), limits.max())
    return axes


def _elasticities(name: str, metric: Callable[[Any], Any], robot: PyTree) -> dict[str, float]:
    """Of every number of the robot, by name."""
    value, gradient = jax.value_and_grad(lambda robot: jnp.asarray(metric(robot)))(robot)
    parts = jax.tree_util.tree_leaves_with_path(gradient)
    leaves = [np.asarray(leaf, float) for leaf in jax.tree.leaves(robot)]
    if not float(value) or not np.isfinite([float(value), *(np.sum(part) for _, part in parts)]).all():
        raise ValueError(f"Got the metric {name!r} with value {float(value)}; expected one that is finite, not zero.")
    found = {}
    for (path, part), leaf in zip(parts, leaves, strict=True):
        stem = jax.tree_util.keystr(path).lstrip(".").replace("_", " ") or "parameter"
        for place, slope in np.ndenumerate(np.asarray(part, float)):
            size = leaf[place] if np.isfinite(leaf[place]) else 0.0  # a stroke without end
            found[f"{stem} {', '.join(str(i + 1) for i in place)}".rstrip()] = float(slope * size / value)
    return found
