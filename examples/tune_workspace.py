"""Tune the prototype of the Triple Scissor Extender for the largest workspace, by gradient.

Loads the robot of [RAL17 V], samples its workspace with a million poses, prints fraction and extents beside
the paper's, then tunes k2 (slide angle), k3 (actuator radius) and k4 (top radius) at fixed k1 while the
height amplification stays above 90 % of the prototype's, and checks the result on an independent, denser
sample. Figures go to ``figures/``. Run ``python examples/tune_workspace.py``; ``--small`` for a quick look.
"""

import argparse
import dataclasses
import os
import pathlib
import time

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import optax

import jaxscissor as js

KEPT_AMPLIFICATION = 0.9


def extents(robot, poses):
    """Widths in x and y and range in z of the reached poses, in metres."""
    reached = jax.jit(jax.vmap(lambda robot, pose: js.feasibility(robot, pose).feasible, (None, 0)))(robot, poses)
    points = np.asarray(poses[:, :3])[np.asarray(reached)]
    return np.ptp(points[:, 0]), np.ptp(points[:, 1]), points[:, 2].min(), points[:, 2].max()


def tune(robot, region, samples, steps):
    """The prototype's k1 and stops, with the k2, k3, k4 of the largest workspace."""
    sample = region.quasi_random(samples, seed=1)
    heights = jnp.linspace(0.5, 1.5, 5)

    def build(ratios):
        angle, actuator, top = ratios
        length = robot.length
        return dataclasses.replace(
            robot, actuator_angle=angle, actuator_radius=actuator * length, top_radius=top * length
        )

    return js.design.optimize(
        lambda design: -js.workspace.soft_fraction(design, sample, sharpness=100.0),
        robot.ratios[1:],
        build=build,
        bounds=(jnp.array([0.0, 0.0, 0.08]), jnp.array([jnp.pi / 4, 0.15, 0.2])),
        steps=steps,
        method=js.design.AugmentedLagrangian(optax.adam(optax.cosine_decay_schedule(0.03, steps, 0.02))),
        constraints=[lambda design: js.height_amplification(design, robot, heights) - KEPT_AMPLIFICATION],
    )


def draw(before, after, result, region, folder):
    """Four figures: both robots, both workspaces, both slices, the course of the tuning."""
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    poses = js.Cylinder(region.radius, region.height, measure="volume").quasi_random(60_000)
    half, height = float(before.length) / 2, float(before.length)
    figure = plt.figure(figsize=(13, 7.5), layout="constrained")
    for column, robot in enumerate((before, after)):
        js.plot.robot(robot, ax=figure.add_subplot(2, 3, 1 + 3 * column, projection="3d"))
        ax = js.plot.workspace(robot, poses, ax=figure.add_subplot(2, 3, 2 + 3 * column, projection="3d"))
        ax.set(xlim=(-half, half), ylim=(-half, half), zlim=(0, height), aspect="equal")
        ax = figure.add_subplot(2, 3, 3 + 3 * column)
        js.plot.workspace_slice(robot, np.zeros(6), low=(-half, 0), high=(half, height), ax=ax)
    figure.savefig(folder / "workspace_before_after.png", dpi=110)
    figure, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
    js.plot.history(result, ax=ax, label="negative soft fraction")
    figure.savefig(folder / "tuning.png", dpi=110)
    plt.close("all")


def main(argv=None):
    """Run the job and print what it finds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="few poses and steps, for a quick look")
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("figures"))
    args = parser.parse_args(argv)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)
    if args.small:  # there is little to compute, so that compiling takes most of the time
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
        jax.config.update("jax_disable_most_optimizations", True)
    poses, samples, steps = (40_000, 4096, 20) if args.small else (1_000_000, 65_536, 100)
    began = time.perf_counter()

    robot = js.TripleScissorExtender.prototype()
    region = js.Cylinder(robot.length / 2, robot.length)
    print(robot)
    sample = region.quasi_random(poses)
    print(f"fraction of the paper's cylinder, {poses} poses: {js.workspace.fraction(robot, sample):.4f}")
    wide, deep, low, high = extents(robot, sample[:])
    print("  [RAL17 V] prints 0.28")
    print(f"extents: {wide:.2f} x {deep:.2f} m, z from {low:.2f} to {high:.2f} m")
    print("  [RAL17 V] prints 1.2 x 1.5 m, z from 0.324 to 1.619 m by the scissors' stops")

    result = tune(robot, region, samples, steps)
    tuned, dense = result.robot, region.quasi_random(4 * poses, seed=2)
    print(f"tuned at fixed k1 = {robot.ratios[0]:.4f}: {result.status.name}")
    for name, old, new in zip(("k2", "k3", "k4"), robot.ratios[1:], tuned.ratios[1:], strict=True):
        print(f"  {name}: {old:.4f} -> {new:.4f}")
    amplification = js.height_amplification(tuned, robot, jnp.linspace(0.5, 1.5, 21))
    print(f"  height amplification: at least {amplification.min():.3f} of the prototype's (bound {KEPT_AMPLIFICATION})")
    before, after = (js.workspace.fraction(r, dense) for r in (robot, tuned))
    print(
        f"hard fraction on {len(dense)} other poses: {before:.4f} before, {after:.4f} after ({after / before - 1:+.0%})"
    )

    draw(robot, tuned, result, region, args.figures)
    print(f"figures in {args.figures}/, {time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
