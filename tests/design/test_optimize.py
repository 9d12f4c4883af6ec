"""Design optimization on problems with known answers, and pictures that show what they should."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
import pytest

import jaxscissor as js
from jaxscissor.design import _run


def test_a_bounded_minimum_is_found_at_the_bound_and_inside():
    result = js.design.optimize(
        lambda x: jnp.sum((x - jnp.array([0.3, 2.0])) ** 2),
        jnp.array([0.9, 0.1]),
        bounds=(jnp.zeros(2), jnp.ones(2)),
        steps=150,
    )
    assert np.abs(result.params - np.array([0.3, 1.0])).max() < 2e-3
    assert result.status is js.Status.IMPROVED
    assert result.history.objective.shape == (151, 1)


def test_a_constraint_is_kept_and_its_multiplier_is_the_price():
    """min (x-1)^2 + (y-1)^2 with x + y <= 1: x = y = 1/2, multiplier 1."""
    result = js.design.optimize(
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

    one = js.design.optimize(valleys, -0.8, bounds=(-1.0, 1.0), steps=100)
    many = js.design.optimize(
        valleys, -0.8, bounds=(-1.0, 1.0), steps=100, starts=6, method=js.design.AugmentedLagrangian(optax.adam(0.02))
    )
    assert abs(one.params + 0.7) < 1e-2 and abs(many.params - 0.7) < 1e-2
    assert many.starts.objective.shape == (6,) and many.history.objective.shape == (101, 6)


def test_failures_are_named():
    impossible = js.design.optimize(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=5, constraints=[lambda x: -1 - x])
    assert impossible.status is js.Status.INFEASIBLE
    broken = js.design.optimize(lambda x: x * jnp.nan, 0.5, bounds=(0.0, 1.0), steps=5)
    assert broken.status is js.Status.NONFINITE
    settled = js.design.optimize(lambda x: x, 0.0, bounds=(0.0, 1.0), steps=5)
    assert settled.status is js.Status.NOT_IMPROVED
    for bounds, message in [((0.0, jnp.inf), "finite"), ((0.6, 1.0), "outside"), ((1.0, 0.0), "low <= high")]:
        with pytest.raises(ValueError, match=message):
            js.design.optimize(lambda x: x, 0.5, bounds=bounds, steps=5)
    with pytest.raises(ValueError, match="at least one"):
        js.design.optimize(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=0)
    with pytest.raises(ValueError, match="expected poses"):
        js.design.optimize(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=5, batch_size=3)
    with pytest.raises(ValueError, match="cannot be compared"):
        js.design.optimize(lambda x: x, 0.5, bounds=(0.0, 1.0), steps=5, poses=[[1.0]], batch_size=1, tolerance=0.1)
    with pytest.raises(ValueError, match="structure"):
        js.design.optimize(lambda x: x["a"], {"a": 0.5}, bounds=(0.0, 1.0), steps=5)


def test_a_start_that_is_no_robot_is_refused_and_an_end_that_is_none_is_returned():
    def build(k1):
        return js.TripleScissorExtender.from_ratios(k1, 0.5, 0.01, 0.1, scissor_angle=(0.2, 1.2))

    def tuned(k1, constraint):
        return js.design.optimize(
            lambda robot: robot.link_lengths[0], k1, build=build, bounds=(0.0, 0.5), steps=5, constraints=[constraint]
        )

    with pytest.raises(ValueError, match="expected 0 < k1"):
        tuned(0.0, lambda robot: 1.0)
    ended = tuned(0.3, lambda robot: -1.0 - robot.link_lengths[0])
    assert ended.status is js.Status.INFEASIBLE and float(ended.params) < 1e-6


def test_a_whole_robot_can_be_the_parameters(prototype):
    sample = js.Cylinder(prototype.length / 2, prototype.length).quasi_random(500)
    free = ("actuator_angle", "actuator_radius")

    def bound(shift):
        values = {name: getattr(prototype, name) + shift * (name in free) for name in prototype.__dataclass_fields__}
        values["stroke"] = jnp.array([0.0, 5.0])
        return type(prototype)(**values)

    result = js.design.optimize(
        lambda robot: -js.workspace.soft_fraction(robot, sample, sharpness=30.0),
        bound(0.0),
        bounds=(bound(-0.03), bound(0.1)),
        steps=10,
    )
    assert isinstance(result.robot, js.TripleScissorExtender)
    assert result.status is js.Status.IMPROVED
    assert float(result.robot.top_radius) == pytest.approx(float(prototype.top_radius))


def test_cloud_and_slice_show_the_workspace(prototype):
    length = float(prototype.length)
    poses = js.Cylinder(length / 2, length).quasi_random(500)
    ax = js.plot.workspace(prototype, poses)
    shown = len(ax.collections[0].get_offsets())
    assert shown == round(float(js.workspace.fraction(prototype, poses)) * 500)
    ax = js.plot.workspace_slice(prototype, np.zeros(6), low=(-0.8, 0.0), high=(0.8, 1.7), resolution=60)
    assert ax.get_ylabel() == "z (m)" and ax.get_aspect() == 1
    with pytest.raises(ValueError, match="expected two of"):
        js.plot.workspace_slice(prototype, np.zeros(6), ("x", "w"), low=(0, 0), high=(1, 1))
    result = js.design.optimize(lambda x: x**2, 0.5, bounds=(0.0, 1.0), steps=5)
    assert len(js.plot.history(result).lines) == 2
    plt.close("all")


def test_gradient_history_is_reproducible():
    runs = [js.design.optimize(lambda x: (x - 0.2) ** 2, 0.9, bounds=(0.0, 1.0), steps=20, starts=3) for _ in range(2)]
    assert (runs[0].history.objective == runs[1].history.objective).all()
    assert jax.tree.structure(runs[0]) == jax.tree.structure(runs[1])


def valley(p):
    """Rosenbrock's function: its minimum, 0 at (1, 1), lies at the end of a bent valley."""
    return (1 - p[0]) ** 2 + 10 * (p[1] - p[0] ** 2) ** 2


def test_lbfgs_follows_a_bent_valley_and_stops_when_it_has_settled():
    result = js.design.optimize(
        valley,
        jnp.array([-0.8, 0.9]),
        bounds=(-2 * jnp.ones(2), 2 * jnp.ones(2)),
        steps=300,
        method=js.design.AugmentedLagrangian(optax.lbfgs()),
        starts=3,
        tolerance=1e-12,
    )
    assert np.abs(result.params - 1).max() < 1e-6
    assert result.settled and len(result.history.objective) < 300
    assert float(result.multipliers.stationarity) < 1e-5


def test_lbfgs_slides_along_a_bound():
    result = js.design.optimize(
        valley,
        jnp.array([-0.8, 0.9]),
        bounds=(-jnp.ones(2), jnp.array([0.5, 1.0])),
        steps=40,
        method=js.design.AugmentedLagrangian(optax.lbfgs()),
    )
    np.testing.assert_allclose(result.params, [0.5, 0.25], atol=1e-7)
    np.testing.assert_allclose(result.multipliers.high, [1.0, 0.0], atol=1e-5)  # 2 (1 - x), at the valley's floor


def test_multipliers_are_the_derivatives_of_the_optimum():
    """min x + 2 y with y >= 1/(4 x) and x <= 1/4: y = 1, and its price is 2; dy/dx = -4, so that of x is 8 - 1."""

    def best(loosened, edge):
        return js.design.optimize(
            lambda p: p[0] + 2 * p[1],
            jnp.array([0.2, 1.9]),
            bounds=(jnp.array([0.01, 0.0]), jnp.array([edge, 2.0])),
            constraints=[lambda p: p[1] - 0.25 / p[0] + loosened],
            steps=400,
            method=js.design.AugmentedLagrangian(optax.lbfgs()),
        )

    result, loosened, widened = best(0.0, 0.25), best(0.01, 0.25), best(0.0, 0.26)
    np.testing.assert_allclose(result.params, [0.25, 1.0], atol=1e-4)
    assert float(result.multipliers.constraints[0]) == pytest.approx(2, rel=1e-3)
    assert float(result.multipliers.high[0]) == pytest.approx(7, rel=1e-3)
    objective = [float(r.starts.objective[0]) for r in (result, loosened, widened)]
    assert objective[0] - objective[1] == pytest.approx(0.01 * 2, rel=0.02)
    assert objective[0] - objective[2] == pytest.approx(0.01 * 7, rel=0.1)


def test_batches_tune_what_the_whole_sample_measures():
    robot = js.NavaroII.prototype()
    sample = js.Box([0.0, 0.0, 0.0], [90.0, 80.0, 0.0]).quasi_random(1000)

    def tuned(batch_size):
        return js.design.optimize(
            lambda robot, poses: -js.workspace.soft_fraction(robot, poses, sharpness=20.0),
            jnp.array(0.8),
            build=lambda size: js.NavaroII(robot.base, size * robot.platform, robot.stroke, mode=8),
            bounds=(jnp.array(0.5), jnp.array(1.5)),
            steps=40,
            poses=sample,
            batch_size=batch_size,
            method=js.design.AugmentedLagrangian(optax.adam(optax.cosine_decay_schedule(0.03, 40, 0.02))),
        )

    whole, batches = tuned(None), tuned(100)
    assert float(batches.starts.objective[0]) == pytest.approx(
        -float(js.workspace.soft_fraction(batches.robot, sample, sharpness=20.0)), rel=1e-12
    )
    assert float(whole.starts.objective[0]) <= float(batches.starts.objective[0]) + 1e-9
    assert float(batches.starts.objective[0]) == pytest.approx(float(whole.starts.objective[0]), abs=2e-3)
    assert batches.status is js.Status.IMPROVED


class Stopped(Exception):
    pass


def test_the_default_ends_on_what_binds_in_a_few_steps():
    """min x^2 + 2 y^2 + z with z >= x^2 + y^2 - 1, x + y >= 1/2, x <= 0.2: x = 0.2, y = 0.3, z = -0.87."""
    result = js.design.optimize(
        lambda p: p[0] ** 2 + 2 * p[1] ** 2 + p[2],
        jnp.array([-0.5, -0.5, 0.0]),
        bounds=(-jnp.ones(3), jnp.array([0.2, 1.0, 1.0])),
        constraints=[lambda p: jnp.stack([p[2] - p[0] ** 2 - p[1] ** 2 + 1, p[0] + p[1] - 0.5])],
        steps=15,
    )
    np.testing.assert_allclose(result.params, [0.2, 0.3, -0.87], atol=1e-9)
    assert float(result.starts.violation[0]) < 1e-8
    np.testing.assert_allclose(result.multipliers.constraints, [1.0, 1.8], atol=1e-6)  # the latter is 4 y + 2 y
    np.testing.assert_allclose(result.multipliers.high, [1.0, 0.0, 0.0], atol=1e-6)  # 1.8 - 2 x - 2 x
    assert float(result.multipliers.stationarity) < 1e-6


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(js.design.SQP(), id="sqp"),
        pytest.param(js.design.AugmentedLagrangian(optax.adam(0.03)), id="adam"),
        pytest.param(js.design.AugmentedLagrangian(optax.lbfgs()), id="lbfgs", marks=pytest.mark.exhaustive),
    ],
)
def test_an_optimization_that_was_stopped_ends_as_if_it_had_not_been(method, tmp_path, monkeypatch):
    def tuned(**options):
        return js.design.optimize(
            valley,
            jnp.array([-0.8, 0.9]),
            bounds=(-2 * jnp.ones(2), 2 * jnp.ones(2)),
            constraints=[lambda p: 1.5 - p[0] - p[1]],
            steps=35,
            starts=2,
            method=method,
            **options,
        )

    path, save, calls = tmp_path / "design.npz", _run.save, []

    def save_twice(*args):
        save(*args)
        calls.append(args)
        if len(calls) == 2:
            raise Stopped

    monkeypatch.setattr(_run, "save", save_twice)
    with pytest.raises(Stopped):
        tuned(checkpoint=path)
    resumed = tuned(checkpoint=path)
    assert len(calls) == 4
    finished = tuned(checkpoint=path)
    assert len(calls) == 4
    for other in (resumed, finished):
        for a, b in zip(jax.tree.leaves(tuned()), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="checkpoint of a job with another objective"):
        js.design.optimize(
            lambda p: 2 * valley(p),
            jnp.array([-0.8, 0.9]),
            bounds=(-2 * jnp.ones(2), 2 * jnp.ones(2)),
            constraints=[lambda p: 1.5 - p[0] - p[1]],
            steps=35,
            starts=2,
            method=method,
            checkpoint=path,
        )


def test_an_interrupted_optimization_returns_its_best_and_goes_on(tmp_path, monkeypatch):
    def tuned(steps=35, **options):
        bounds = (-2 * jnp.ones(2), 2 * jnp.ones(2))
        return js.design.optimize(valley, jnp.array([-0.8, 0.9]), bounds=bounds, steps=steps, **options)

    def until(last):
        def some(numbers, *_):
            for number in numbers:
                if number == last:
                    raise KeyboardInterrupt
                yield number

        return some

    path, whole, shorter = tmp_path / "design.npz", tuned(), tuned(steps=13)
    with monkeypatch.context() as patch:
        patch.setattr(_run, "progress", until(14))
        stopped = tuned(checkpoint=path)
        patch.setattr(_run, "progress", until(0))
        with pytest.raises(KeyboardInterrupt):  # there is nothing to return yet
            tuned()
    assert stopped.status is js.Status.INTERRUPTED and stopped.ok and "stopped by the user" in str(stopped)
    np.testing.assert_array_equal(stopped.params, shorter.params)
    np.testing.assert_array_equal(stopped.history.objective, shorter.history.objective)
    resumed = tuned(checkpoint=path)
    np.testing.assert_array_equal(resumed.history.objective, whole.history.objective)
    longer = tuned(steps=45, checkpoint=path)
    np.testing.assert_array_equal(longer.history.objective, tuned(steps=45).history.objective)


def test_a_printed_result_says_what_binds_at_what_price():
    def room(p):
        return jnp.array([9.0, 1.2 - p[0]])

    def objective(p):
        return (p[0] - 2) ** 2 + 3 * (p[1] + 1)

    bounds, constraints = (jnp.array([-2.0, 0.0]), jnp.array([2.0, 1.0])), [room, lambda p: 5 - p[0]]
    result = js.design.optimize(objective, jnp.array([0.0, 0.5]), bounds=bounds, steps=20, constraints=constraints)
    lines = dict(re.split(r"\s+", line, maxsplit=1) for line in str(result).splitlines())
    assert list(map(float, result.objective)) == pytest.approx([8.5, 3.64], rel=1e-6)
    assert lines["objective"] == "8.5 -> 3.64 (-57.2 %)"
    assert lines["constraints"] == "room[1], 1.6 per unit"
    assert lines["bounds"] == "parameter[1] low, 3 per unit"
    assert lines["steps"] == "21, all that were done" and len(lines) <= 10


def test_a_checkpoint_is_of_one_optimization_only(tmp_path):
    """Each was once resumed as the other: their parameters, first objective and kinds of optimizer state are alike."""
    path = tmp_path / "design.npz"

    def tuned(slope=1.0, rate=0.01, step=1.0, **options):
        return js.design.optimize(
            lambda x: slope * (x - 0.3) ** 2 - slope * 0.04,
            0.5,
            bounds=(0.0, 2.0),
            constraints=[lambda x: step * x + 0.5 * (1 - step)],
            steps=10,
            method=js.design.AugmentedLagrangian(optax.adam(rate)),
            **options,
        )

    first = tuned(checkpoint=path)
    assert float(tuned(checkpoint=path).params) == float(first.params) == float(tuned().params)
    others = {
        "objective": {"slope": -1.0},
        "method": {"rate": 0.3},
        "constraints|objective": {"step": 0.5},
        "settings": {"seed": 1},
    }
    for name, other in others.items():
        with pytest.raises(ValueError, match=f"a job with another .*({name})"):
            tuned(**other, checkpoint=path)


def test_a_validation_compares_on_what_the_tuning_did_not_see():
    result = js.design.optimize(valley, jnp.array([-0.8, 0.9]), bounds=(-jnp.ones(2), jnp.ones(2)), steps=50)
    seen = result.validate(lambda p: jnp.abs(p[0] - 1), [lambda p: p - 0.5, lambda p: 2 - p[1]])
    assert float(seen.before) == pytest.approx(1.8)
    assert float(seen.constraints_before) == pytest.approx(-1.3)
    assert float(seen.after) == pytest.approx(1 - float(result.params[0]))
    assert float(seen.constraints_after) == pytest.approx(float(jnp.min(result.params) - 0.5))
    assert float(seen.improvement) == pytest.approx(float(seen.before - seen.after))


def test_constraints_that_are_not_defined_everywhere_count_as_violated_there():
    """sqrt(x) >= 0.5 says nothing below zero, where x itself leads out."""
    result = js.design.optimize(
        lambda x: x**2,
        -0.8,
        bounds=(-1.0, 1.0),
        constraints=[lambda x: x, lambda x: jnp.where(x > 0, js.safe_sqrt(x), jnp.nan) - 0.5],
        steps=200,
    )
    assert result.history.violation[0, 0] == jnp.inf
    assert float(result.params) == pytest.approx(0.25, abs=2e-3)
    assert result.status is js.Status.IMPROVED


@pytest.mark.parametrize("method", [None, js.design.AugmentedLagrangian(optax.adam(0.02))], ids=["default", "adam"])
def test_no_unit_of_objective_or_constraint_matters(method):
    def tuned(one, other):
        return js.design.optimize(
            lambda p: one * jnp.sum((p - 0.2) ** 2),
            jnp.array([0.9, 0.6]),
            bounds=(jnp.zeros(2), jnp.ones(2)),
            constraints=[lambda p: other * (p[0] - 0.5), lambda p: p - 0.1],
            steps=60,
            method=method,
        )

    plain = tuned(1.0, 1.0)
    assert plain.status is js.Status.IMPROVED
    for one, other in ((2.0**-20, 1.0), (2.0**20, 2.0**-20), (1.0, 2.0**20)):
        result = tuned(one, other)
        np.testing.assert_array_equal(result.params, plain.params)
        np.testing.assert_array_equal(result.starts.violation, plain.starts.violation)
        units = jnp.array([one / other, one, one])
        np.testing.assert_allclose(result.multipliers.constraints, plain.multipliers.constraints * units, rtol=1e-12)


def test_what_is_returned_is_never_worse_than_a_feasible_design_that_was_seen():
    steep = js.design.optimize(
        lambda x: 1e4 * (x - 0.2) ** 2, 0.8, bounds=(0.0, 1.0), steps=40, constraints=[lambda x: x - 0.8]
    )
    assert steep.status is js.Status.NOT_IMPROVED and float(steep.params) == 0.8
    assert float(steep.multipliers.constraints[0]) == pytest.approx(1.2e4)

    def bent(p):  # a valley whose floor leaves the feasible side again and again
        return (p[0] - 1) ** 2 + 100 * (p[1] - p[0] ** 2) ** 2

    for limit in (0.3, 0.6, 0.9):
        result = js.design.optimize(
            bent,
            jnp.array([-0.9, 0.9]),
            bounds=(-jnp.ones(2), jnp.ones(2)),
            steps=60,
            constraints=[lambda p, limit=limit: limit - p[0], lambda p: 0.95 - p[1]],
        )
        seen = np.where(result.history.violation <= 1e-3, result.history.objective, np.inf)
        assert float(bent(result.params)) == pytest.approx(seen.min(), rel=1e-12)
        assert result.starts.violation.max() <= 1e-3


def test_multipliers_are_zero_where_nothing_binds_and_explain_the_slope(rng):
    """Complementary slackness and stationarity, for many constraints of which few bind."""
    normals = rng.normal(size=(2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = rng.uniform(0.4, 1.0, 2000)
    slope = jnp.array([-1.0, -0.5, 0.3])

    def slack(p):
        return offsets - normals @ p

    result = js.design.optimize(
        lambda p: slope @ p + 0.1 * p @ p,
        jnp.zeros(3),
        bounds=(-jnp.ones(3), jnp.ones(3)),
        constraints=[slack],
        steps=60,
    )
    at, multipliers = np.asarray(slack(result.params)), np.asarray(result.multipliers.constraints)
    assert result.status is js.Status.IMPROVED and (multipliers >= 0).all() and multipliers.max() > 0.1
    assert not multipliers[at > 1e-2].any() and (multipliers * at).max() < 1e-8
    pull = np.asarray(slope + 0.2 * result.params) + normals.T @ multipliers
    pull -= np.asarray(result.multipliers.low) - np.asarray(result.multipliers.high)
    assert np.abs(pull).max() < 1e-6 and float(result.multipliers.stationarity) < 1e-6


def test_a_result_is_a_start():
    options = {"bounds": (0.49, 2.65), "steps": 5}
    first = js.design.optimize(lambda x: -x, 1.57, **options)
    assert float(first.params) == 2.65
    again = js.design.optimize(lambda x: -x, first.params, **options)
    assert again.status is js.Status.NOT_IMPROVED and float(again.params) == 2.65


def test_an_optimization_that_cannot_go_on_says_why(prototype):
    bounds = (0.0, 1.0)
    refused = js.design.optimize(
        lambda robot: robot.top_radius,
        0.2,
        build=lambda radius: dataclasses.replace(prototype, top_radius=radius),
        bounds=(-0.1, 0.4),
        steps=20,
    )
    assert refused.status is js.Status.IMPOSSIBLE and "top_radius" in refused.message
    steep = js.design.optimize(jnp.sqrt, 0.0, bounds=bounds, steps=3)
    assert "its derivative is not: by the parameter" in steep.message
    flat = js.design.optimize(lambda x: jnp.floor(4 * x), 0.6, bounds=bounds, steps=3)
    assert flat.status is js.Status.NOT_IMPROVED and "workspace.soft_fraction" in flat.message
    pair = {"a": 0.6, "b": 0.1}, {"a": 0.0, "b": 0.0}, {"a": 1.0, "b": 1.0}
    loose = js.design.optimize(lambda x: x["a"] ** 2, pair[0], bounds=pair[1:], steps=3)
    assert loose.status is js.Status.IMPROVED and "depends on ['b']" in loose.message
    lost = js.design.optimize(
        lambda x: x**2, 0.6, bounds=bounds, steps=3, constraints=[lambda x: x, lambda x: x * jnp.nan]
    )
    assert lost.status is js.Status.INFEASIBLE and "Constraint 1 is nan" in lost.message
    assert not js.design.optimize(lambda x: x**2, 0.6, bounds=bounds, steps=3).message


@pytest.mark.parametrize(
    ("message", "changed"),
    [
        ("constraint 0 of dtype bool", {"constraints": [lambda p: p["a"] > 0]}),
        ("method='adam'; expected design.SQP", {"method": "adam"}),
        ("Got batches and SQP", {"method": js.design.SQP(), "poses": np.zeros((4, 3)), "batch_size": 2}),
        (r"objective of shape \(2,\)", {"objective": lambda p: jnp.stack([p["a"], p["b"]])}),
        (r"objective of shape \(1,\)", {"objective": lambda p: p["a"][None]}),
        (r"bounds 2.0 and 1.0 of \['b'\]", {"bounds": ({"a": 0.0, "b": 2.0}, {"a": 1.0, "b": 1.0})}),
        (r"bounds \['b'\] of shape \(2,\)", {"bounds": ({"a": 0.0, "b": np.zeros(2)}, {"a": 1.0, "b": 1.0})}),
        (r"params 0.6 of \['a'\] outside", {"bounds": ({"a": 0.7, "b": 0.0}, {"a": 1.0, "b": 1.0})}),
    ],
)
def test_what_cannot_be_optimized_is_refused_by_name(message, changed):
    plain = {
        "objective": lambda p: p["a"] ** 2,
        "params": {"a": 0.6, "b": 0.1},
        "bounds": ({"a": 0.0, "b": 0.0}, {"a": 1.0, "b": 1.0}),
        "steps": 3,
    }
    with pytest.raises(ValueError, match=message):
        js.design.optimize(**{**plain, **changed})
