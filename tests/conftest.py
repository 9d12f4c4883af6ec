"""Settings of all tests, and the one table of robots that every contract test runs over."""

import dataclasses
import gc
import os
import pathlib
import re
from functools import partial

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from hypothesis import settings

import jaxscissor as js
from jaxscissor._engine.cpu.compile_options import UNOPTIMIZED
from jaxscissor._engine.pytree import unchecked
from tests.toys import LinearDelta, Planar3RPR, ThreePRS

matplotlib.use("Agg")
if "JAX_DISABLE_MOST_OPTIMIZATIONS" not in os.environ:  # see as_users
    quick = (f"--{name}={str(value).lower()}" for name, value in UNOPTIMIZED.items())
    os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *quick])
    jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_num_cpu_devices", 8)  # for tests that share out work; the others use the first
jax.config.update("jax_enable_x64", os.environ.get("JAX_ENABLE_X64", "1") != "0")
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
# by default a fifteenth of the time goes into looking through millions of equations of traced programs for garbage
gc.set_threshold(100_000, 50, 100)
settings.register_profile("default", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("default")


def as_users(function, **options):
    """A jitted function compiled as users compile, for the laws of batches and statuses.

    What the optimizer makes of a batch is to be tested; what is long to compile and runs a few times, derivatives
    and searches, is compiled without it, in a third of the time. Functions of one pose called with numbers always
    compile as users do.
    """
    flags = {"xla_backend_optimization_level": 3, "xla_llvm_disable_expensive_passes": False}
    flags |= {"xla_cpu_use_fusion_emitters": True, "xla_cpu_parallel_codegen_split_count": 32}
    return jax.jit(function, compiler_options=flags | {"xla_disable_hlo_passes": ""}, **options)


def exhaustive(*values):
    """Parameters of a test that are left to ``-m exhaustive``."""
    return [pytest.param(value, marks=pytest.mark.exhaustive) for value in values]


def tse_clockwise() -> js.TripleScissorExtender:
    """Other proportions and legs counted clockwise, in the shapes of the prototype: both share their programs."""
    third = 2 * np.pi / 3
    bars = [0.3, 0.2, 0.15]
    return js.TripleScissorExtender(bars, -0.3, 0.2, 0.1, azimuths=(0.0, -third, third))


def tri_scott_skewed() -> js.TriScott:
    """No symmetry, and cranks with which the linkages draw no straight line."""
    masts, platform = [[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]], [[-0.2, -0.1], [0.25, -0.1], [0.0, 0.2]]
    return js.TriScott(masts, [0.8, 0.9, 0.7], platform, crank_lengths=[0.42, 0.4, 0.38])


ROBOTS = {
    "tse_prototype": js.TripleScissorExtender.prototype,
    "tse_clockwise": tse_clockwise,
    "navaro_mode_8": partial(js.NavaroII.prototype, 8),
    "three_prs": ThreePRS.example,
    "linear_delta": LinearDelta.example,
}


MORE = {  # by ``-m exhaustive``
    "stewart_gough": js.StewartGough.prototype,
    **{f"navaro_mode_{mode}": partial(js.NavaroII.prototype, mode) for mode in (1, 3, 6)},
    "tri_scott_skewed": tri_scott_skewed,
    "tri_scott": js.TriScott.prototype,
    "micabo": js.Micabo.prototype,
    "planar_3rpr": Planar3RPR.example,
}
ALL = ROBOTS | MORE
KINDS = ("navaro_mode_8", "three_prs")  # legs that know all their roots, a free pose; legs that do not, a bound pose


def scaled(robot, by):
    """The robot in another unit of length: all its dimensions but angles times a number."""
    values = {}
    for field in dataclasses.fields(robot):
        value = getattr(robot, field.name)
        length = field.metadata.get("unit") != "rad" and not field.metadata.get("static")
        values[field.name] = value * by if length else value
    return unchecked(type(robot), **values)


@pytest.fixture(scope="module", params=[*ROBOTS, *exhaustive(*MORE)])
def robot(request):
    """Each robot of the table in turn, all its tests one after the other."""
    return ALL[request.param]()


@pytest.fixture(scope="module", params=[*KINDS, *exhaustive(*(name for name in ALL if name not in KINDS))])
def robot_of_a_kind(request):
    """A robot whose platform is free and one whose platform is bound; the exhaustive tests take all others."""
    return ALL[request.param]()


@pytest.fixture(autouse=True)
def _forget_programs():
    """Forget all compiled programs when memory runs short, or two thirds of the maps that Linux allows are used up.

    Every program takes some maps, and a process that has used them up crashes in the compiler. What the process has
    taken is no measure: it is not given back, and every test after the first that took much would begin anew.
    """
    yield
    process = pathlib.Path("/proc")
    if not process.exists():
        return
    free = int(re.search(r"MemAvailable: +(\d+) kB", (process / "meminfo").read_text())[1]) * 2**10
    maps = (process / "self" / "maps").read_text().count("\n")
    if free < 3 * 2**30 or maps > 45_000:
        jax.clear_caches()
        gc.collect()


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
