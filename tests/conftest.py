"""Settings of all tests, and the one table of robots that every contract test runs over."""

import os
from functools import partial

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from hypothesis import settings

import jaxscissor as js
from tests.toys import LinearDelta, Planar3RPR, ThreePRS

matplotlib.use("Agg")
if "JAX_DISABLE_MOST_OPTIMIZATIONS" not in os.environ:  # compiling takes most of the time: a quarter of it this way
    os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_use_fusion_emitters=false"
    jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_num_cpu_devices", 8)  # for tests that share out work; the others use the first
jax.config.update("jax_enable_x64", os.environ.get("JAX_ENABLE_X64", "1") != "0")
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
settings.register_profile("default", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("default")


def tse_clockwise() -> js.TripleScissorExtender:
    third = 2 * np.pi / 3
    return js.TripleScissorExtender.from_ratios(0.3, -0.3, 0.2, 0.1, azimuths=(0.0, -third, third))


def tri_scott_skewed() -> js.TriScott:
    """No symmetry, and cranks with which the linkages draw no straight line."""
    masts, platform = [[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]], [[-0.2, -0.1], [0.25, -0.1], [0.0, 0.2]]
    return js.TriScott(masts, [0.8, 0.9, 0.7], platform, crank_lengths=[0.42, 0.4, 0.38])


ROBOTS = {
    "tse_prototype": js.TripleScissorExtender.prototype,
    "tse_clockwise": tse_clockwise,
    **{f"navaro_mode_{mode}": partial(js.NavaroII.prototype, mode) for mode in (1, 3, 6, 8)},
    "tri_scott": js.TriScott.prototype,
    "micabo": js.Micabo.prototype,
    "tri_scott_skewed": tri_scott_skewed,
    "stewart_gough": js.StewartGough.prototype,
    "planar_3rpr": Planar3RPR.example,
    "three_prs": ThreePRS.example,
    "linear_delta": LinearDelta.example,
}


@pytest.fixture(scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in ROBOTS])
def robot(request):
    """Each robot of the table in turn; one worker runs all its tests and compiles its programs once."""
    yield ROBOTS[request.param]()
    jax.clear_caches()


@pytest.fixture(scope="module", autouse=True)
def _forget_programs():
    """A process may map only so many pages, and every compiled program maps some."""
    yield
    jax.clear_caches()


@pytest.fixture
def prototype():
    return js.TripleScissorExtender.prototype()


@pytest.fixture
def rng():
    return np.random.default_rng(20260)


@pytest.fixture
def random_poses(rng):
    """``random_poses(robot, n)``: poses of the paper's cylinder with tilts to 30 deg."""

    def draw(robot, n):
        length = float(robot.length)
        radius, angle = rng.uniform(0, length / 2, n), rng.uniform(0, 2 * np.pi, n)
        tilt = rng.uniform(-np.pi / 6, np.pi / 6, (n, 3))
        height = rng.uniform(0, length, n)
        return jnp.asarray(np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height, tilt]))

    return draw
