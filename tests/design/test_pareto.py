"""Pareto fronts and choices on problems whose answers are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js


def hollow(p):
    """One metric of Fonseca and Fleming's problem, whose front no weighted sum can find."""
    return 1 - jnp.exp(-jnp.sum((p - 1 / np.sqrt(3)) ** 2))


def other(p):
    return 1 - jnp.exp(-jnp.sum((p + 1 / np.sqrt(3)) ** 2))


def test_a_hollow_front_is_found_from_end_to_end():
    """All numbers equal t: f1 = 1 - exp(-3 (t - a)^2), f2 = 1 - exp(-3 (t + a)^2)."""
    front = js.design.pareto_front([hollow, other], jnp.zeros(3), bounds=(-4 * jnp.ones(3), 4 * jnp.ones(3)), steps=150)
    t = np.linspace(-1, 1, 20001)[:, None] / np.sqrt(3) * np.ones(3)
    known = np.stack([1 - np.exp(-((t - s / np.sqrt(3)) ** 2).sum(axis=1)) for s in (1, -1)], axis=1)
    values = np.asarray(front.values)
    assert len(values) > 60
    off = np.abs(values[:, None] - known[None]).max(axis=2)
    assert off.min(axis=1).max() < 2e-3, "every design lies on the front"
    assert off.min(axis=0).max() < 0.05, "no part of the front is missed"
    assert (np.diff(values[:, 0]) > 0).all() and (np.diff(values[:, 1]) < 0).all()


@pytest.mark.exhaustive
def test_three_metrics_under_a_constraint_share_a_triangle():
    """Distances to three corners: their triangle is efficient, cut at y = 0.2 and with the edge there made whole."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]])
    front = js.design.pareto_front(
        [lambda p, c=c: jnp.sum((p - c) ** 2) for c in corners],
        jnp.array([0.9, 0.9]),
        bounds=(-jnp.ones(2), 2 * jnp.ones(2)),
        constraints=[lambda p: p[1] - 0.2],
        steps=80,
        designs=60,
    )
    x, y = np.asarray(front.params).T
    assert len(x) > 40 and float(front.violation.max()) <= 1e-3
    assert (y > 0.198).all() and (y < 0.81).all()
    inner = y > 0.21
    assert (np.abs(x - 0.5) < 0.5 - y / 1.6 + 1e-2)[inner].all() and 20 < inner.sum() < len(x)
    assert y.max() > 0.78 and x.min() < 0.02 and x.max() > 0.98
    assert x.min() > -1e-2 and x.max() < 1.01


def test_no_front_without_a_design_that_keeps_the_constraints():
    front = js.design.pareto_front(
        [lambda x: x, lambda x: -x], 0.5, bounds=(0.0, 1.0), steps=3, designs=4, constraints=[lambda x: -1 - x]
    )
    assert front.values.shape == (0, 2) and front.params.shape == (0,)
    with pytest.raises(ValueError, match="at least 2, 2 and 1"):
        js.design.pareto_front([lambda x: x], 0.5, bounds=(0.0, 1.0), steps=3)


def test_choices_are_ranked_and_impossible_ones_come_last():
    choices = {
        "impossible": {"constraints": [lambda x: -1 - x**2]},
        "far": {"build": lambda x: x + 3},
        "near": {"build": lambda x: x + 1},
    }
    results = js.design.optimize_variants(lambda x: x**2, choices, params=0.2, bounds=(-0.5, 0.5), steps=60)
    assert list(results) == ["near", "far", "impossible"]
    assert float(results["near"].params) == pytest.approx(-0.5)
    assert results["impossible"].status is js.Status.INFEASIBLE
    with pytest.raises(ValueError, match="no variants"):
        js.design.optimize_variants(lambda x: x, {})


@pytest.mark.exhaustive
def test_actuation_modes_of_navaro_can_be_chosen_among():
    """The mode with the largest worst type-2 measure over a task, by enumeration and by hand."""
    task = js.Disc([45.0, 26.0], 10.0, 0.3, 0.6).quasi_random(64)[:]
    base = js.NavaroII.prototype()

    def build(size, mode):
        return js.NavaroII(base.base, size * base.platform, base.stroke, mode=mode)

    def worst(robot):
        return -js.workspace.worst_over(
            robot, lambda robot, pose: jnp.abs(js.singularities.measures(robot, pose).type2), task
        ).value

    choices = {str(m): {"build": lambda size, m=m: build(size, m)} for m in (1, 8)}
    results = js.design.optimize_variants(worst, choices, params=1.0, bounds=(0.999, 1.001), steps=3)
    by_hand = {str(m): float(worst(build(1.0, m))) for m in (1, 8)}
    assert list(results) == sorted(by_hand, key=by_hand.get)
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(results))
