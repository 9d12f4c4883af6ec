"""Constraints over whole regions, on problems whose worst poses move with the design."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.design import _run

INTERVAL = js.Box(jnp.array([-1.0]), jnp.array([1.0]))


def room(line, x):
    """How much less than the third number a line differs from exp at x."""
    return line[2] - jnp.abs(jnp.exp(x[0]) - line[0] - line[1] * x[0])


def fitted(room, **options):
    bounds = jnp.array([-3.0, -3.0, 0.0]), jnp.full(3, 3.0)
    limit = js.design.Throughout(room, INTERVAL, poses=8, tolerance=1e-7)
    options = {"params": jnp.array([1.0, 1.0, 2.0]), "bounds": bounds, "steps": 30, "constraints": [limit]} | options
    return js.design.optimize(lambda line: line[2], **options)


def test_the_best_line_touches_its_bound_at_three_points():
    """Chebyshev's: its slope is the secant's, and its error is equal at both ends and where it is parallel."""
    result = fitted(room)
    slope = np.sinh(1)
    offset = (np.e - slope * np.log(slope)) / 2
    error = (np.exp(-1) + slope * np.log(slope)) / 2
    assert result.status is js.Status.IMPROVED
    np.testing.assert_allclose(result.params, [offset, slope, error], atol=1e-7)
    (worst,) = result.worst
    assert abs(float(worst.value)) < 1e-7
    assert "room" in str(result) and "throughout" in str(result)
    assert len(result.history.objective) > 62  # several optimizations


def test_a_design_that_is_best_and_keeps_its_limits_is_not_improved():
    best = fitted(room).params + jnp.array([0.0, 0.0, 1e-8])
    again = fitted(room, params=best, bounds=(best, best))
    assert again.status is js.Status.NOT_IMPROVED
    assert fitted(room, params=best.at[2].add(-0.1), bounds=(best.at[2].add(-0.1), best)).status is js.Status.IMPROVED


def test_what_cannot_hold_throughout_is_told_with_the_pose():
    result = fitted(lambda line, x: jnp.where(x[0] > 0.99, -1.0 - x[0], room(line, x)))
    assert result.status is js.Status.INFEASIBLE and not result.ok
    assert "is -2 at the pose [1.0]" in result.message


def test_what_is_not_defined_somewhere_does_not_hold_there():
    result = fitted(lambda line, x: jnp.where(x[0] > 0.5, jnp.nan, room(line, x)))
    assert result.status is js.Status.INFEASIBLE


def test_what_cannot_be_a_limit_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a region"):
        js.design.Throughout(room, jnp.zeros((3, 1)))
    with pytest.raises(ValueError, match="at least 2 and 1"):
        js.design.Throughout(room, INTERVAL, poses=1)
    with pytest.raises(ValueError, match="a checkpoint and a Throughout"):
        fitted(room, checkpoint=tmp_path / "design.npz")
    with pytest.raises(ValueError, match=r"only design\.optimize"):
        fitted(room).validate(lambda line: line[2], [js.design.Throughout(room, INTERVAL)])


def test_an_interruption_ends_all_rounds(monkeypatch):
    def until_five(numbers, *_):
        yield from range(5)
        raise KeyboardInterrupt

    monkeypatch.setattr(_run, "progress", until_five)
    stopped = fitted(room)
    assert len(stopped.history.objective) == 5
    assert stopped.status in (js.Status.INTERRUPTED, js.Status.INFEASIBLE)
