"""Design optimization on problems with known answers, and pictures that show what they should."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
import pytest

import jaxscissor as js


def test_a_bounded_minimum_is_found_at_the_bound_and_inside():
    result = js.optimize_design(
        lambda x: jnp.sum((x - jnp.array([0.3, 2.0])) ** 2),
        jnp.array([0.9, 0.1]),
        bounds=(jnp.zeros(2), jnp.ones(2)),
        steps=150,
    )
    assert np.abs(result.params - np.array([0.3, 1.0])).max() < 2e-3
    assert result.status is js.DesignStatus.IMPROVED
    assert result.history.objective.shape == (151, 1)


def test_a_constraint_is_kept_and_its_multiplier_is_the_price():
    """min (x-1)^2 + (y-1)^2 with x + y <= 1: x = y = 1/2, multiplier 1."""
    result = js.optimize_design(
        lambda p: (p["x"] - 1) ** 2 + (p["y"] - 1) ** 2,
        {"x": 0.0, "y": 0.2},
        bounds=({"x": -1.0, "y": -1.0}, {"x": 2.0, "y": 2.0}),
        constraints=[lambda p: 1 - p["x"] - p["y"]],
        steps=600,
    )
    assert abs(result.params["x"] - 0.5) < 3e-3 and abs(result.params["y"] - 0.5) < 3e-3
    assert result.starts.violation.max() <= 1e-3
    assert float(result.history.multipliers[-1, 0, 0]) == pytest.approx(1.0, abs=0.1)


def test_several_starts_find_the_deeper_of_two_valleys():
    def valleys(x):
        return jnp.minimum((x + 0.7) ** 2, (x - 0.7) ** 2 - 0.5)

    one = js.optimize_design(valleys, -0.8, bounds=(-1.0, 1.0), steps=100)
    many = js.optimize_design(valleys, -0.8, bounds=(-1.0, 1.0), steps=100, starts=6, optimizer=optax.adam(0.02))
    assert abs(one.params + 0.7) < 1e-2 and abs(many.params - 0.7) < 1e-2
    assert many.starts.objective.shape == (6,) and many.history.objective.shape == (101, 6)


def test_failures_are_named():
    impossible = js.optimize_design(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=5, constraints=[lambda x: -1 - x])
    assert impossible.status is js.DesignStatus.INFEASIBLE
    broken = js.optimize_design(lambda x: x * jnp.nan, 0.5, bounds=(0.0, 1.0), steps=5)
    assert broken.status is js.DesignStatus.NONFINITE
    settled = js.optimize_design(lambda x: x, 0.0, bounds=(0.0, 1.0), steps=5)
    assert settled.status is js.DesignStatus.NOT_IMPROVED
    for bounds, message in [((0.0, jnp.inf), "finite"), ((0.6, 1.0), "outside"), ((1.0, 0.0), "low <= high")]:
        with pytest.raises(ValueError, match=message):
            js.optimize_design(lambda x: x, 0.5, bounds=bounds, steps=5)
    with pytest.raises(ValueError, match="at least one"):
        js.optimize_design(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=0)
    with pytest.raises(ValueError, match="structure"):
        js.optimize_design(lambda x: x["a"], {"a": 0.5}, bounds=(0.0, 1.0), steps=5)


def test_a_whole_robot_can_be_the_parameters(prototype):
    sample = js.Cylinder(prototype.length / 2, prototype.length).quasi_random(500)
    free = ("actuator_angle", "actuator_radius")

    def bound(shift):
        values = {name: getattr(prototype, name) + shift * (name in free) for name in prototype.__dataclass_fields__}
        values["stroke"] = jnp.array([0.0, 5.0])
        return type(prototype)(**values)

    result = js.optimize_design(
        lambda robot: -js.soft_workspace_fraction(robot, sample, sharpness=30.0),
        bound(0.0),
        bounds=(bound(-0.03), bound(0.1)),
        steps=10,
    )
    assert isinstance(result.robot, js.TripleScissorExtender)
    assert result.status is js.DesignStatus.IMPROVED
    assert float(result.robot.top_radius) == pytest.approx(float(prototype.top_radius))


def test_cloud_and_slice_show_the_workspace(prototype):
    length = float(prototype.length)
    poses = js.Cylinder(length / 2, length).quasi_random(500)
    ax = js.plot.workspace(prototype, poses)
    shown = len(ax.collections[0].get_offsets())
    assert shown == round(float(js.workspace_fraction(prototype, poses)) * 500)
    ax = js.plot.workspace_slice(prototype, np.zeros(6), low=(-0.8, 0.0), high=(0.8, 1.7), resolution=60)
    assert ax.get_ylabel() == "z (m)" and ax.get_aspect() == 1
    with pytest.raises(ValueError, match="expected two of"):
        js.plot.workspace_slice(prototype, np.zeros(6), ("x", "w"), low=(0, 0), high=(1, 1))
    result = js.optimize_design(lambda x: x**2, 0.5, bounds=(0.0, 1.0), steps=5)
    assert len(js.plot.history(result).lines) == 2
    plt.close("all")


def test_gradient_history_is_reproducible():
    runs = [js.optimize_design(lambda x: (x - 0.2) ** 2, 0.9, bounds=(0.0, 1.0), steps=20, starts=3) for _ in range(2)]
    assert (runs[0].history.objective == runs[1].history.objective).all()
    assert jax.tree.structure(runs[0]) == jax.tree.structure(runs[1])
