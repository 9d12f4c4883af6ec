"""What others would do: C++ twice, SciPy, NumPy, optimistix. Each maker returns poses -> (joints, solved)."""

import ctypes
import pathlib
import subprocess
import tempfile

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js
from benchmarks.poses import RATIOS, closure, leg_conics

HERE = pathlib.Path(__file__).parent
FLAGS = {
    "plain": ["-O3", "-march=native", "-ffast-math", "-fopenmp"],
    "simd": ["-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-fopenmp"],
}
TOL = 1e-12


def _built(name):
    """The solver of one of the C++ references."""
    library = pathlib.Path(tempfile.mkdtemp()) / f"{name}.so"
    source = HERE / "cpp" / f"{name}.cpp"
    flags = FLAGS.get(name, FLAGS["plain"])
    subprocess.run(["g++", *flags, "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library)).solve


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def cpp_forward():
    """joints -> (positions and rotation matrices, solved), by the C++ reference."""
    function, ratios, kept = _built("forward"), np.array(RATIOS), {}
    home = np.array(js.TripleScissorExtender.from_ratios(*RATIOS).home()[0])

    def solve(joints):
        n = len(joints)
        if n not in kept:
            kept[n] = np.empty((n, 12)), np.empty(n, np.int32)
        places, status = kept[n]
        given = [pointer(a) for a in (ratios, home, joints)]
        function(*given, ctypes.c_long(n), ctypes.c_double(TOL), pointer(places), pointer(status))
        return places, status == 0

    return solve


def cpp(name):
    """Build one of the C++ references and return its solver."""
    function, ratios, kept = _built(name), np.array(RATIOS), {}

    def solve(poses):
        n = len(poses)
        if n not in kept:  # results in memory that was touched before, as XLA's are
            kept[n] = np.empty((n, 6)), np.empty(n, np.int32), np.empty(n)
        joints, status, residual = kept[n]
        arrays = [pointer(a) for a in (ratios, poses)], [pointer(a) for a in (joints, status, residual)]
        function(*arrays[0], ctypes.c_long(n), ctypes.c_double(TOL), *arrays[1])
        return joints, status == 0

    return solve


def numpy_newton(poses, steps=8):
    """Newton's method on all poses at once, leg by leg, from the symmetric start."""
    joints, solved = np.empty((len(poses), 6)), np.ones(len(poses), bool)
    with np.errstate(all="ignore"):
        for i, (a, b, h, p2, m2) in enumerate(leg_conics(RATIOS, poses)):
            p = (a / 2 + np.sqrt(np.maximum(a * a / 4 - 4 * p2 * h, 0))) / (2 * p2)
            m = b * p / (p - a)
            for _ in range(steps):
                f, g = closure(p, m, a, b, h, p2, m2)
                fp, fm, gp, gm = m - b, p - a, 2 * p2 * p - a / 2, 2 * m2 * m - b / 2
                det = fp * gm - fm * gp
                p, m = p - (f * gm - g * fm) / det, m - (g * fp - f * gp) / det
            f, g = closure(p, m, a, b, h, p2, m2)
            joints[:, 2 * i], joints[:, 2 * i + 1] = (p + m) / 2, (p - m) / 2
            solved &= (f * f + g * g <= TOL**2) & (p > a) & (det < 0) & (np.abs(m) <= p)
    return joints, solved


def scipy_fsolve(poses):
    """One call per pose, all six joints, from the joints of home."""
    from scipy.optimize import fsolve

    home = np.asarray(js.TripleScissorExtender.from_ratios(*RATIOS).home()[1])
    joints, solved = np.empty((len(poses), 6)), np.empty(len(poses), bool)
    for n, pose in enumerate(poses):
        conics = list(leg_conics(RATIOS, pose[None]))

        def residual(q, conics=conics):
            legs = [closure(q[2 * i] + q[2 * i + 1], q[2 * i] - q[2 * i + 1], *c) for i, c in enumerate(conics)]
            return np.concatenate([part for leg in legs for part in leg])

        joints[n], _, code, _ = fsolve(residual, home, full_output=True, xtol=1e-12)
        solved[n] = code == 1 and np.abs(residual(joints[n])).max() <= TOL
    return joints, solved


def optimistix_newton():
    """The library's residual under a mapped general solver, as a user of JAX would write it."""
    import optimistix

    robot = js.TripleScissorExtender.from_ratios(*RATIOS)
    home = robot.home()[1]
    solver = optimistix.Newton(rtol=1e-12, atol=1e-12)

    @jax.jit
    def mapped(poses):
        def one(pose):
            found = optimistix.root_find(
                lambda q, p: js.residual(robot, p, joints=q), solver, home, pose, max_steps=30, throw=False
            )
            return found.value, jnp.linalg.norm(js.residual(robot, pose, joints=found.value)) <= TOL

        return jax.vmap(one)(poses)

    return lambda poses: mapped(jnp.asarray(poses))
