"""What exists only because of XLA on CPUs is lowered for CPUs only, and can be turned off."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import pytest

import jaxscissor as js


def loops(function, *arguments, platform):
    lowered = jax.jit(function).trace(*arguments).lower(lowering_platforms=(platform,))
    return lowered.as_text().count("stablehlo.while")


@pytest.mark.parametrize("batched", [False, True])
def test_fences_are_no_loops_on_other_platforms(prototype, batched):
    """A loop is a stop for the host there. What is left: the legs, Newton's steps, the first guess, and chunks."""
    pose, joints = prototype.home()
    if batched:
        function, arguments = jax.vmap(js.inverse_kinematics, (None, 0)), (prototype, jnp.tile(pose, (100_000, 1)))
    else:
        function, arguments = jax.jacfwd(js.forward_kinematics, 1), (prototype, joints)
    on_cpu, elsewhere = (loops(function, *arguments, platform=platform) for platform in ("cpu", "cuda"))
    assert elsewhere <= 5
    assert on_cpu > 2 * elsewhere, "there are fences, and they are counted"


def test_one_switch_turns_it_off_and_changes_rounding_only():
    code = (
        "import jax; jax.config.update('jax_enable_x64', True); import jaxscissor as js; "
        "robot = js.NavaroII.prototype(); pose = [46.0, 27.0, 0.2]; "
        "solve = jax.jit(js.inverse_kinematics); "
        "print(solve.trace(robot, jax.numpy.array(pose)).lower().as_text().count('stablehlo.while')); "
        "print(*map(float, js.inverse_kinematics(robot, pose).value))"
    )
    counts, values = [], []
    for plain in ("0", "1"):
        environment = {**os.environ, "JAXSCISSOR_PLAIN": plain}
        run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment)
        count, numbers = run.stdout.splitlines()
        counts.append(int(count))
        values.append(jnp.array([float(number) for number in numbers.split()]))
    assert counts[1] < counts[0]
    assert float(jnp.abs(values[0] - values[1]).max()) < 1e-12
