"""Regions, feasibility at the boundary, workspace fractions and their gradients."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.soft_gradient import PROTOTYPE, boundary_derivative, build
from scipy.stats import kstest

import jaxscissor as js
from tests.conftest import as_users
from tests.toys import LinearDelta, Planar3RPR


def test_samples_are_lazy_and_indexed_alike(rng):
    region = js.Cylinder(0.5, 1.0, orientation=([-0.2] * 3, [0.2] * 3))
    sample = region.quasi_random(2_000_000_000)
    assert len(sample) == 2_000_000_000 and sample[1_999_999_990:].shape == (10, 6)
    small = region.quasi_random(100)
    assert (jnp.asarray(small)[40:50] == small[40:50]).all() and np.asarray(small).shape == (100, 6)
    assert not np.allclose(region.quasi_random(10, seed=1)[:], region.quasi_random(10, seed=2)[:])
    with pytest.raises(TypeError, match="slices"):
        small[3]


def test_measures_are_uniform_where_they_say():
    paper = np.asarray(js.Cylinder(2.0, 3.0).quasi_random(4096)[:])
    volume = np.asarray(js.Cylinder(2.0, 3.0, measure="volume").quasi_random(4096)[:])
    disc = np.asarray(js.Disc([1.0, 2.0], 2.0, -0.5, 1.0).quasi_random(4096)[:])
    radius = [np.hypot(*points[:, :2].T) / 2 for points in (paper, volume)]
    cases = [radius[0], radius[1] ** 2, paper[:, 2] / 3, (np.hypot(*(disc[:, :2] - [1, 2]).T) / 2) ** 2]
    cases += [(np.arctan2(*paper[:, :2].T) + np.pi) / (2 * np.pi), (disc[:, 2] + 0.5) / 1.5]
    for uniform in cases:
        assert kstest(uniform, "uniform").statistic < 0.01


def test_grids_are_cell_centres_with_the_last_axis_fastest():
    grid = np.asarray(js.Box([0.0, 10.0], [1.0, 14.0]).grid((2, 4))[:])
    assert (grid[:4] == [[0.25, 10.5], [0.25, 11.5], [0.25, 12.5], [0.25, 13.5]]).all() and len(grid) == 8
    with pytest.raises(ValueError, match="3 positive counts"):
        js.Cylinder(1.0, 1.0).grid((2, 2))


@pytest.mark.parametrize(
    "make",
    [
        lambda: js.Cylinder(-1.0, 1.0),
        lambda: js.Cylinder(1.0, 1.0, orientation=[0.0, 1.0]),
        lambda: js.Cylinder(1.0, 1.0, measure="surface"),
        lambda: js.Box([1.0], [0.0]),
        lambda: js.Box([1.0], [0.0, 1.0]),
        lambda: js.Disc([0.0, 0.0], 0.0, -1.0, 1.0),
        lambda: js.Disc([0.0], 1.0, -1.0, 1.0),
        lambda: js.Box([0.0], [1.0]).quasi_random(0),
        lambda: js.workspace.fraction(js.TripleScissorExtender.prototype(), np.zeros((3, 5))),
    ],
)
def test_impossible_regions_are_refused(make):
    with pytest.raises(ValueError, match="Got"):
        make()


def test_the_prototype_reaches_what_was_measured_elsewhere(prototype):
    """0.2949 with the stops along exact rays, 0.39 without (independent code); the paper prints 0.28."""
    region = js.Cylinder(prototype.length / 2, prototype.length)
    assert float(js.workspace.fraction(prototype, region.quasi_random(400_000))) == pytest.approx(0.2949, abs=1e-3)
    free = js.TripleScissorExtender.from_ratios(*prototype.ratios, length=prototype.length)
    assert float(js.workspace.fraction(free, region.quasi_random(400_000))) == pytest.approx(0.385, abs=2e-3)


def test_chunks_arrays_and_lazy_samples_count_the_same(prototype):
    sample = js.Cylinder(prototype.length / 2, prototype.length).quasi_random(5001)
    fractions = [
        js.workspace.fraction(prototype, sample),
        js.workspace.fraction(prototype, sample[:]),
        js.workspace.fraction(prototype, sample, execution=js.workspace.Execution(chunk_size=700)),
        jax.jit(lambda r: js.workspace.fraction(r, sample, execution=js.workspace.Execution(chunk_size=1000)))(
            prototype
        ),
        int(jax.vmap(lambda p: js.feasibility(prototype, p).feasible)(sample[:]).sum()) / 5001,
    ]
    assert np.ptp(np.asarray(fractions)) < 1e-15
    soft = [
        js.workspace.soft_fraction(prototype, sample, execution=js.workspace.Execution(chunk_size=n))
        for n in (None, 700)
    ]
    assert abs(soft[0] - soft[1]) < 1e-14
    bad = sample[:].at[0].set(jnp.nan)
    assert js.workspace.fraction(prototype, bad) <= fractions[0]


def test_feasible_means_within_every_limit(prototype, random_poses):
    poses = random_poses(prototype, 3000)
    solution = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))(prototype, poses)
    feasible = np.asarray(as_users(jax.vmap(js.feasibility, (None, 0)))(prototype, poses).feasible)
    joints = np.asarray(solution.value).reshape(-1, 3, 2)
    eta = math.pi / 6
    width = np.hypot(joints.sum(-1) * math.cos(eta), (joints[..., 0] - joints[..., 1]) * math.sin(eta))
    alpha = np.arccos(np.clip(width / (2 * 0.2647 * 1.727), -1, 1))
    low, high = np.asarray(prototype.scissor_angle)
    tops = np.asarray(jax.vmap(lambda p: jnp.stack([a.z for a in prototype.attachments(*js.SE3.place(p))]))(poses))
    within = ((alpha >= low) & (alpha <= high) & (tops >= 0)).all(axis=1) & np.asarray(solution.converged)
    assert (within == feasible).all() and 0 < feasible.sum() < len(feasible)


def test_the_margin_crosses_zero_where_the_verdict_changes_folds_included(prototype):
    """Along radial lines: continuous, zero exactly at the change, and about 29 % of the changes are folds."""
    length, rays = float(prototype.length), 400
    unit = np.asarray(js.Box([0.0, 0.0], [1.0, 1.0]).quasi_random(rays)[:])
    radii = np.linspace(1e-6, length / 2, 400)

    def poses(radius, angle, height):
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height, *np.zeros((3, len(angle)))], 1)

    judge = as_users(jax.vmap(js.feasibility, (None, 0)))
    lines = [(np.full(rays, r), 2 * np.pi * unit[:, 0], length * unit[:, 1]) for r in radii]
    margins = np.stack([judge(prototype, poses(*line)).margin for line in lines], axis=1)
    assert np.abs(np.diff(margins, axis=1)).max() < 0.02
    ray, cell = np.nonzero((margins[:, 1:] >= 0) != (margins[:, :-1] >= 0))
    low, high, starts_inside = radii[cell], radii[cell + 1], margins[ray, cell] >= 0
    for _ in range(40):
        middle = (low + high) / 2
        same = np.asarray(judge(prototype, poses(middle, lines[0][1][ray], lines[0][2][ray])).feasible) == starts_inside
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    inside = poses(np.where(starts_inside, low, high), lines[0][1][ray], lines[0][2][ray])
    outside = poses(np.where(starts_inside, high, low), lines[0][1][ray], lines[0][2][ray])
    assert np.abs(judge(prototype, inside).margin).max() < 1e-9, "zero at the change, from inside"
    assert np.abs(judge(prototype, outside).margin).max() < 1e-9, "zero at the change, from outside"
    joints = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))(prototype, inside).value
    lost = np.asarray(judge(prototype, outside).status) != js.Status.CONVERGED
    folds = lost & (np.asarray(joints).min(axis=1) > 1e-6)
    assert 0.24 < folds.mean() < 0.34


def test_fold_margins_agree_from_both_sides_without_a_closed_form():
    """3-RPR: its legs always close, so only limits count; scaled lengths must scale nothing."""
    robot = Planar3RPR.example()
    poses = jnp.asarray(js.Disc([0.45, 0.35], 0.8, -0.5, 0.5).quasi_random(500)[:])
    judged = jax.vmap(js.feasibility, (None, 0))(robot, poses)
    lengths = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses).value[:, 1::2] / robot.length
    assert ((lengths.min(1) >= 0.2) & (lengths.max(1) <= 1.5) == judged.feasible).all()


def test_soft_gradients_differentiate_the_soft_fraction(prototype):
    sample = js.Cylinder(prototype.length / 2, prototype.length).quasi_random(3000)

    def soft(radius):
        import dataclasses

        return js.workspace.soft_fraction(dataclasses.replace(prototype, top_radius=radius), sample, sharpness=30.0)

    at, step = prototype.top_radius, 1e-5
    difference = (soft(at + step) - soft(at - step)) / (2 * step)
    assert float(jax.grad(soft)(at)) == pytest.approx(float(difference), rel=1e-6)
    assert float(jax.jacfwd(soft)(at)) == pytest.approx(float(difference), rel=1e-6)
    batch = jax.jit(jax.vmap(jax.grad(soft)))(jnp.stack([at, 1.1 * at]))
    assert float(batch[0]) == pytest.approx(float(difference), rel=1e-6)


@pytest.mark.exhaustive
def test_a_soft_gradient_comes_with_the_error_that_independent_samples_show():
    robot, poses = LinearDelta.example(), 2000
    low, high = (robot.home()[0] + side * 0.5 * robot.length for side in (-1, 1))
    drawn = jax.random.uniform(jax.random.key(0), (64, poses, 3), low.dtype, minval=low, maxval=high)
    found = jax.vmap(partial(js.workspace.soft_gradient, robot, sharpness=30.0))(drawn)
    whole = js.workspace.soft_gradient(robot, drawn.reshape(-1, 3), sharpness=30.0)
    for given, error, most, least in zip(
        *map(jax.tree.leaves, (found.gradient, found.error, whole.gradient, whole.error)), strict=True
    ):
        # 64 samples know a spread to 1 / sqrt(2 * 63) = 9 %
        error = float(jnp.sqrt(jnp.mean(error**2)))
        assert float(jnp.std(given)) == pytest.approx(error, rel=0.3)
        assert float(jnp.mean(given)) == pytest.approx(float(most), rel=1e-9)
        assert error == pytest.approx(8 * float(least), rel=0.02)
    plain = jax.value_and_grad(js.workspace.soft_fraction)(robot, drawn[0], sharpness=30.0)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b[0], rtol=1e-9), plain, (found.value, found.gradient))
    assert all(bool(jnp.isnan(x)) for x in jax.tree.leaves(js.workspace.soft_gradient(robot, drawn[0, :1]).error))


@pytest.mark.exhaustive
def test_soft_gradients_approach_the_derivative_of_the_hard_fraction():
    theta = jnp.asarray(PROTOTYPE)
    reference = boundary_derivative(theta, rays=1500, cells=800)
    sample = js.Cylinder(0.5, 1.0).quasi_random(1_000_000)
    soft = jax.grad(lambda t: js.workspace.soft_fraction(build(t), sample, sharpness=200.0))(theta)
    scale = np.maximum(np.abs(reference), 0.05 * np.abs(reference).max())
    assert (np.abs(soft - reference) / scale).max() < 0.06


def test_no_nan_in_the_gradient_of_a_batch_a_third_of_which_is_unreachable(prototype, random_poses):
    poses = random_poses(prototype, 300).at[::3, 2].add(3.0)

    def total(robot, poses):
        solution = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
        ratio = jax.vmap(lambda p: js.gear_ratios(robot, p).vertical)(poses)
        return jnp.sum(jnp.where(solution.converged, solution.value.sum(axis=1) + ratio, 0))

    gradients = jax.jit(jax.grad(total, (0, 1)))(prototype, poses)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradients))
