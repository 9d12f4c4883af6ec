"""What happened in an optimization, in some ten lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

if TYPE_CHECKING:
    from jaxscissor.design._result import DesignResult

_SHOWN = 3  # of everything that binds, those with the largest multipliers


def summary(result: DesignResult) -> str:
    """Objective before and after, what binds it and at what price, why it stopped, and how long it took."""
    return "\n".join(f"{head:<13}{text}" for head, text in _lines(result))


def _lines(result: DesignResult) -> Iterator[tuple[str, str]]:
    before, after = map(float, result.objective)
    first, others = result.seconds.first, result.seconds.others
    steps = len(result.history.objective)
    yield result.status.name, result.status.message
    share = f" ({100 * (after - before) / abs(before):+.3g} %)" if before and np.isfinite([before, after]).all() else ""
    yield "objective", f"{before:.6g} -> {after:.6g}{share}"
    yield "steps", f"{steps}, {'until the objective no longer fell' if result.settled else 'all that were done'}"
    yield "seconds", f"{first:.3g} until the first step was done, compilation included; {others:.3g} for the others"
    if result.entries:
        yield "violation", f"{_violation(result):.2g} at the best design"
    yield from _block("constraints", list(_constraints(result)))
    yield from _block("bounds", list(_bounds(result)))
    for found in result.worst:
        yield (
            "throughout",
            f"least {float(found.value):.3g}, found at the pose {np.asarray(found.pose).round(4).tolist()}",
        )
    yield "stationarity", f"{float(result.multipliers.stationarity):.2g}, zero at a minimum"
    if result.message:
        yield "note", result.message


def _violation(result: DesignResult) -> float:
    best = np.where(np.asarray(result.starts.objective) == float(result.objective[1]), result.starts.violation, np.inf)
    return float(np.min(best))


def _constraints(result: DesignResult) -> Iterator[tuple[float, str]]:
    """Price and name of every entry that binds."""
    values = iter(np.asarray(result.multipliers.constraints))
    for name, size in result.entries:
        for entry in range(size):
            price = float(next(values))
            if price > 0:
                yield price, f"{name}[{entry}]" if size > 1 else name


def _bounds(result: DesignResult) -> Iterator[tuple[float, str]]:
    for side, tree in (("low", result.multipliers.low), ("high", result.multipliers.high)):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            name = jax.tree_util.keystr(path).lstrip(".") or "parameter"
            for place, price in np.ndenumerate(np.asarray(leaf)):
                if price > 0:
                    yield float(price), f"{name}{list(place) if place else ''} {side}"


def _block(head: str, binding: Sequence[tuple[float, Any]]) -> Iterator[tuple[str, str]]:
    """The dearest of what binds: what the objective would fall by per unit."""
    if not binding:
        return
    dearest = sorted(binding, reverse=True)
    shown = "; ".join(f"{name}, {price:.3g} per unit" for price, name in dearest[:_SHOWN])
    yield head, shown + (f"; {len(dearest) - _SHOWN} more" if len(dearest) > _SHOWN else "")
