"""What must also hold in float32; run on its own with JAX_ENABLE_X64=0, and in the suite by casting."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import as_users, exhaustive
from tests.oracles import apices, quartic_joints

DESIGNS = [(0.2647, math.pi / 6, 0.0186, 0.11765), (0.45, 0.9, 0.15, 0.1), (0.15, -0.2, 0.12, 0.05)]


def in_single(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), tree)


@pytest.mark.parametrize("ratios", [DESIGNS[0], *exhaustive(*DESIGNS[1:])])
def test_verdicts_in_single_precision(ratios, random_poses):
    """As in double precision, but for poses within 1000 eps of an edge."""
    robot = in_single(js.TripleScissorExtender.from_ratios(*ratios))
    poses = np.asarray(random_poses(robot, 20_000), np.float32)
    solution = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    home, near = np.ones(len(poses), bool), np.zeros(len(poses), bool)
    exact = np.asarray(in_single(jnp.array(ratios)), np.float64)
    for i, apex in enumerate(apices(exact, poses.astype(np.float64))):
        joints, real, u, determinant = quartic_joints(exact, apex)
        label = real & (joints >= 0).all(axis=-1) & (determinant < 0) & (u > 0)
        home &= label.any(axis=1)
        expected = np.where(label[..., None], joints, 0).sum(axis=1)
        error = np.abs(np.asarray(solution.value)[:, 2 * i : 2 * i + 2] - expected).max(axis=1)
        assert np.median(error[home & np.asarray(solution.converged)]) < 1e-6
        near |= np.abs(edge_distance(exact, apex)) < 1000 * np.finfo(np.float32).eps
    wrong = np.asarray(solution.converged) != home
    assert not (wrong & ~near).any()
    assert near.mean() < 5e-3
    assert not np.isin(np.asarray(solution.status), [js.Status.MAX_STEPS, js.Status.NONFINITE])[~near].any()
    assert np.asarray(solution.residual_norm)[np.asarray(solution.converged)].max() < 1e-4


def edge_distance(ratios, apex):
    """-F at the edge of the home mode, by a dense scan of F over u: independent of the library."""
    k1, eta = ratios[:2]
    x, y, z = apex
    c, s, k = np.cos(eta), np.sin(eta), 1 / (4 * k1**2)
    a, b = 2 * y * s, 2 * x * c
    p2, m2 = s * s / 4 + k * c * c, c * c / 4 + k * s * s
    low = np.maximum(np.maximum(np.abs(b), -a), 1e-9)

    def closure(u):
        p, m = u + a, b + a * b / u
        return x * x + y * y + z * z - 1 - (p * a + m * b) / 2 + p2 * p * p + m2 * m * m

    left, right = low.copy(), low + 4
    for _ in range(80):
        third, two = left + (right - left) / 3, right - (right - left) / 3
        less = closure(third) < closure(two)
        left, right = np.where(less, left, third), np.where(less, two, right)
    return -np.minimum(closure((left + right) / 2), closure(low))


def test_results_keep_the_dtype(prototype):
    single = in_single(prototype)
    pose = single.home()[0]
    sample = js.Cylinder(single.length / 2, single.length).quasi_random(2000)
    assert js.workspace.fraction(single, sample).dtype == jnp.float32
    gradient = jax.grad(js.workspace.soft_fraction)(single, sample)
    assert all(leaf.dtype == jnp.float32 and bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradient))
    assert js.inverse_kinematics_all(single, pose).values.dtype == jnp.float32
    assert float(js.workspace.fraction(single, sample)) == pytest.approx(0.295, abs=0.02)


@pytest.mark.exhaustive
def test_clearance_in_single_precision():
    """Mode 8 of NaVARo II is loose at alpha = 0 [NAV19 eq. 38]; the other number is of a run in double precision."""
    navaro = in_single(js.NavaroII.prototype(8))
    nearest = js.singularities.distance(navaro, jnp.asarray([45.0, 26.0, 0.2], jnp.float32))
    assert nearest.distance.dtype == jnp.float32 and nearest.status == js.Status.CONVERGED
    assert (int(nearest.kind), int(nearest.leg)) == (2, -1)
    assert float(nearest.rotation) == pytest.approx(0.2, abs=1e-3)
    assert float(nearest.distance) == pytest.approx(90 * 0.2, rel=1e-3)
    assert abs(float(js.singularities.measures(navaro, nearest.pose, joints=nearest.joints).type2)) < 1e-4
    tse = in_single(js.TripleScissorExtender.prototype())
    met = js.singularities.distance(tse, tse.home()[0], direction=jnp.eye(6, dtype=jnp.float32)[2])
    assert met.distance.dtype == jnp.float32 and met.kind == 1
    assert float(met.distance) == pytest.approx(0.4098030131, rel=1e-3)
    type1 = js.singularities.measures(tse, met.pose, joints=met.joints).type1[met.leg]
    assert abs(float(type1)) < 1e-3  # it vanishes with the root of the distance


@pytest.mark.exhaustive
def test_aspects_in_single_precision():
    """As many regions, cells and signs as in double precision, from which the numbers are."""
    whole = js.NavaroII.prototype(8)
    robot = in_single(js.NavaroII(whole.base, whole.platform, mode=8))  # no end of stroke
    box = js.Box([-50.0, -60.0, -math.pi], [140.0, 130.0, math.pi])
    found = js.singularities.aspects(robot, box, (12, 12, 12))
    assert found.sizes.tolist() == [634, 634, 230, 230]
    labels = [found.label([45.0, 26.0, a]) for a in (0.5, -0.5)]
    assert labels[0] != labels[1] and found.signs[labels[0]] == -found.signs[labels[1]]
    path = js.singularities.aspect_path(robot, found, [45.0, 26.0, 0.5], [45.0, 30.0, 2.0])
    assert path.clear and not js.singularities.aspect_path(robot, found, [45.0, 26.0, 0.5], [45.0, 26.0, -0.5]).clear


@pytest.mark.exhaustive
def test_plans_in_single_precision():
    """Modes, the switch and the worst measure as in double precision, from which the numbers are."""
    path = np.linspace([45.0, 26.0, 1.4], [45.0, 26.0, -0.9], 93)
    plan = js.singularities.plan_modes(
        {mode: in_single(js.NavaroII.prototype(mode)) for mode in (8, 1)}, path, min_type2=0.02
    )
    assert plan.status == js.Status.PLANNED and plan.switches.tolist() == [19]
    assert (plan.modes == np.where(np.arange(93) < 19, 8, 1)).all()
    assert plan.worst == pytest.approx(0.1807645938, rel=1e-3)
