"""The Tri-Scott with the largest dexterous workspace that fits into a cell of given size.

A designer's task: the robot is to stand in a cell 1.3 m wide and 2 m high. A position counts as reached if the
platform takes it level and tilted by 15 deg to four sides, each time also turned by 15 deg to the left and to
the right. Which masts, links, platform and strokes reach the largest part of a box of 1 x 1 x 1.5 m, while the
type-2 measure stays, at every pose that counts, above a tenth of what it is at home?

Run ``python examples/design_tri_scott.py``; ``--small`` for a quick look. Figures go to ``figures/``.
"""

import argparse
import itertools
import os
import pathlib
import time

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np

import jaxscissor as js

WIDTH, HEIGHT = 1.3, 2.0  # of the cell, in metres
TILT = TURN = np.deg2rad(15.0)
STRONG = 0.1  # least type-2 measure, in parts of that at home
FIRST = {
    "mast_circle": 1 / np.sqrt(3),  # the prototype, with strokes that fit into the cell
    "link": 0.8,
    "platform_circle": 0.3 / np.sqrt(3),
    "highest_lower": 1.3,
    "least_upper": 0.1,
    "greatest_upper": 0.7,
}
LOW = dict(
    FIRST, mast_circle=0.3, link=0.3, platform_circle=0.1, highest_lower=0.5, least_upper=0.05, greatest_upper=0.2
)
HIGH = dict(
    FIRST, mast_circle=0.65, link=1.5, platform_circle=0.4, highest_lower=1.9, least_upper=0.4, greatest_upper=1.4
)


def build(size):
    """The robot of six numbers."""
    angles = jnp.arange(3) * (2 * jnp.pi / 3)
    corners = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
    links = jnp.full(3, size["link"])
    stroke = jnp.stack(
        [
            jnp.stack([jnp.zeros_like(size["link"]), size["highest_lower"]]),
            jnp.stack([size["least_upper"], size["greatest_upper"]]),
        ]
    )
    return js.TriScott(size["mast_circle"] * corners, links, size["platform_circle"] * corners, stroke)


def task(robot):
    """Positions of the cell, with the set of orientations about those at home."""
    turned = float(robot.home()[0][5])
    tilts = [(0, 0), (TILT, 0), (-TILT, 0), (0, TILT), (0, -TILT)]
    orientations = [(*tilt, turned + turn) for tilt, turn in itertools.product(tilts, (-TURN, TURN))]
    box = js.Box([-0.5, -0.5, 0.0, 0.0, 0.0, 0.0], [0.5, 0.5, 1.5, 0.0, 0.0, 0.0])
    return js.workspace.Dexterous(box, orientations)


def size_left(robot):
    """Room left in the cell, in metres: beside the masts, and above the upper sliders."""
    masts = WIDTH / 2 - jnp.max(jnp.linalg.norm(robot.masts, axis=1))
    return jnp.stack([masts, HEIGHT - robot.stroke[0, 1] - robot.stroke[1, 1]])


@jax.jit
def reached(robot, sample):
    """Which positions of a sample are reached in all orientations."""
    in_all = jax.vmap(lambda pose: js.feasibility(robot, pose).feasible)
    return jax.lax.map(lambda poses: jnp.all(in_all(poses)), sample[:], batch_size=128)


@jax.jit
def strength(robot, sample):
    """Type-2 measure beyond what is asked, in parts of that at home, at every pose that counts; 1 at the others."""
    poses = jnp.concatenate([robot.home()[0][None], sample[:].reshape(-1, 6)])
    measures = jax.lax.map(lambda pose: js.singularities.measures(robot, pose).type2, poses, batch_size=1280)
    parts = measures[1:].reshape(len(sample), -1) / measures[0]
    return jnp.where(reached(jax.lax.stop_gradient(robot), sample)[:, None], parts - STRONG, 1)


def problem(rays=256, cells=24, positions=500):
    """Arguments of ``design.optimize``."""
    region = task(build(FIRST))
    sample = region.quasi_random(positions)
    return {
        "objective": lambda robot: -js.workspace.ray_fraction(robot, region, rays=rays, cells=cells, axes=(0, 1, 2)),
        "params": FIRST,
        "bounds": (LOW, HIGH),
        "build": build,
        "constraints": [lambda robot: jnp.append(size_left(robot), strength(robot, sample))],
    }


def main(argv=None):
    """Solve the problem, certify it on poses of its own, and draw it."""
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="few rays and steps, for a quick look")
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("figures"))
    args = parser.parse_args(argv)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)
    if args.small:  # there is little to compute, so that compiling takes most of the time
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
        jax.config.update("jax_disable_most_optimizations", True)
    began = time.perf_counter()

    sizes, steps, checked = ((32, 12, 50), 4, 50) if args.small else ((256, 24, 500), 25, 100_000)
    result = js.design.optimize(**problem(*sizes), steps=steps)
    print(f"{result.status.name} in {time.perf_counter() - began:.0f} s")
    for name, old in FIRST.items():
        print(f"  {name:<16} {old:.4f} -> {float(result.params[name]):.4f}")
    sample = task(result.initial).quasi_random(checked, seed=1)
    other = [size_left, lambda robot: jnp.min(strength(robot, sample))]
    seen = result.validate(lambda robot: -jnp.mean(reached(robot, sample)), other)
    volume = float(sample.region.volume)
    print(f"dexterous part of the box on {checked} other positions: {-seen.before:.4f} -> {-seen.after:.4f}")
    print(f"  in volume: {-volume * seen.before:.4f} -> {-volume * seen.after:.4f} m^3")
    print(f"least slack of the constraints on them: {seen.constraints_before:+.4f} -> {seen.constraints_after:+.4f}")
    width, height, *poses = result.multipliers.constraints
    print(f"multipliers (width, height, all poses): {width:.3f}, {height:.3f}, {sum(poses):.3f}")

    args.figures.mkdir(exist_ok=True)
    drawn = sample.region.quasi_random(min(checked, 2000))
    positions = np.asarray(drawn)[:, 0, :3]
    figure = plt.figure(figsize=(9, 4.5), layout="constrained")
    for column, robot in enumerate((result.initial, result.robot)):
        ax = figure.add_subplot(1, 2, column + 1, projection="3d")
        js.plot.robot(robot, ax=ax)
        ax.scatter(*positions[np.asarray(reached(robot, drawn))].T, s=2, color="0.4")
    figure.savefig(args.figures / "tri_scott_dexterous.png", dpi=110, bbox_inches="tight")
    plt.close(figure)
    print(f"figures in {args.figures}/, {time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
