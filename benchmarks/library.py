"""The library's own rows: every robot, every function, every size."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import optax

import jaxscissor as js
from benchmarks.own_robot import Planar3RPR
from benchmarks.poses import RATIOS, poses_near_home, tse_poses

inverse = jax.vmap(js.inverse_kinematics, (None, 0))
ROBOTS = {
    "NaVARo II": js.NavaroII,
    "Tri-Scott": js.TriScott,
    "MICABO": js.Micabo,
    "Gough-Stewart": js.StewartGough,
    "user's 3-RPR": Planar3RPR,
}


def tse(dtype=jnp.float64):
    """The robot of all rows that name no other."""
    return js.TripleScissorExtender.from_ratios(*np.asarray(RATIOS, dtype))


def robots(count):
    """Inverse kinematics of every other robot: {row: (function, arguments, count)}."""
    rows = {}
    for name, kind in ROBOTS.items():
        robot = kind.prototype()
        rows[f"inverse kinematics, {name}"] = inverse, (robot, jnp.asarray(poses_near_home(robot, count))), count
    return rows


def functions(count):
    """The other functions, on the TSE."""
    robot, poses = tse(), jnp.asarray(tse_poses(count))
    few = max(count // 10, 1)
    joints = inverse(robot, poses[:few]).value
    single = tse(jnp.float32), poses.astype(jnp.float32)
    soft = js.workspace.soft_fraction
    optimizer = optax.adam(1e-3)

    def mapped(function):
        return jax.vmap(function, (None, 0))

    rays = count // 100
    exact = partial(js.workspace.ray_fraction, region=js.Cylinder(robot.length / 2, robot.length), rays=rays)

    def design_step(robot, poses):
        gradient = jax.grad(soft)(robot, poses)
        updates, _ = optimizer.update(gradient, optimizer.init(robot))
        return optax.apply_updates(robot, updates)

    return {
        "inverse kinematics, float32": (inverse, single, count),
        "all working modes": (mapped(js.inverse_kinematics_all), (robot, poses[:few]), few),
        "forward kinematics": (mapped(js.forward_kinematics), (robot, joints), few),
        "inverse Jacobian": (mapped(partial(js.inverse_jacobian, rates="twist")), (robot, poses), count),
        "singular values": (mapped(js.gear_ratios), (robot, poses[:few]), few),
        "hard fraction": (js.workspace.fraction, (robot, poses), count),
        "hard fraction, float32": (js.workspace.fraction, single, count),
        "soft fraction": (soft, (robot, poses), count),
        "soft fraction and gradient": (jax.value_and_grad(soft), (robot, poses), count),
        "exact fraction, a hundred poses per ray": (exact, (robot,), count),
        "exact fraction and gradient": (jax.value_and_grad(exact), (robot,), count),
        "design step": (design_step, (robot, poses), count),
    }


def sizes(largest):
    """Inverse kinematics over the size of the batch."""
    robot = tse()
    rows = {}
    for exponent in range(len(str(largest))):
        count = 10**exponent
        rows[f"inverse kinematics, batch {count}"] = inverse, (robot, jnp.asarray(tse_poses(count))), count
    return rows
