"""The Triple Scissor Extender with the largest workspace that stands on no more ground than the prototype of [RAL17 V].

A designer's question: the scissors' length, the stops and the circle on the floor are given. Which base bar,
slide angle, distance of the slides from the centre, top radius and stroke give the largest workspace, if the
platform must still rise at least 90 % as fast per slide as the prototype's? The workspace is the exact part of the
paper's cylinder that a level platform reaches; no smoothing enters.

Run ``python examples/design_tse_workspace.py``; ``--small`` for a quick look. Figures go to ``figures/``.
"""

import argparse
import os
import pathlib
import time

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np

import jaxscissor as js

KEPT_AMPLIFICATION = 0.9
PROTOTYPE = js.TripleScissorExtender.prototype
NAMES = ("base_bar", "slide_angle", "feet_radius", "top_radius", "longest_slide")


def footprint(robot):
    """Radius of the circle about the slides' outer ends."""
    end, angle = robot.stroke[1], robot.actuator_angle
    return js.safe_sqrt((robot.actuator_radius + end * jnp.sin(angle)) ** 2 + (end * jnp.cos(angle)) ** 2)


def build(size):
    """The robot of five numbers: L and the stops are the prototype's."""
    length, stops = PROTOTYPE().length, PROTOTYPE().scissor_angle
    ratios = size["base_bar"] / length, size["slide_angle"], size["feet_radius"] / length, size["top_radius"] / length
    stroke = jnp.stack([jnp.zeros_like(length), size["longest_slide"]])
    return js.TripleScissorExtender.from_ratios(*ratios, length=length, stroke=stroke, scissor_angle=stops)


def reference():
    """The prototype with slides as long as its folded, level platform needs."""
    robot = PROTOTYPE()
    longest = robot.link_lengths[0] * jnp.cos(robot.scissor_angle[0]) / jnp.cos(robot.actuator_angle)
    values = robot.link_lengths[0], robot.actuator_angle, robot.actuator_radius, robot.top_radius, longest
    return dict(zip(NAMES, map(float, values), strict=True))


def slacks(robot, first, heights):
    """Ground left on the circle, in parts of the prototype's, and height amplification beyond what is asked."""
    room = 1 - footprint(robot) / footprint(first)
    return jnp.append(js.height_amplification(robot, first, heights) - KEPT_AMPLIFICATION, room)


def problem(rays=341, cells=32):
    """Arguments of ``design.optimize``."""
    params = reference()
    first, low, high = build(params), (0.15, 0.0, 0.0, 0.1, 0.2), (1.2, np.pi / 3, 0.3, 0.4, 1.2)
    region = js.Cylinder(first.length / 2, first.length)
    return {
        "objective": lambda robot: -js.workspace.ray_fraction(robot, region, rays=rays, cells=cells, axes=(0, 1, 2)),
        "params": params,
        "bounds": tuple(dict(zip(NAMES, values, strict=True)) for values in (low, high)),
        "build": build,
        "constraints": [lambda robot: slacks(robot, first, jnp.linspace(0.5, 1.5, 5))],
    }


def draw(result, folder):
    """Slices of both workspaces through the axis, both robots, and the course of the tuning."""
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    figure = plt.figure(figsize=(14, 4), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.25)  # beside the labels of the axes in space
    half, height = 0.95, 1.75
    for column, robot in enumerate((result.initial, result.robot)):
        ax = figure.add_subplot(1, 5, 1 + 2 * column, projection="3d")
        js.plot.robot(robot, ax=ax)
        ax.locator_params(nbins=3)
        ax = figure.add_subplot(1, 5, 2 + 2 * column)
        js.plot.workspace_slice(robot, np.zeros(6), low=(-half, 0), high=(half, height), ax=ax)
    js.plot.history(result, ax=figure.add_subplot(1, 5, 5), label="negative fraction")
    figure.savefig(folder / "largest_workspace.png", dpi=110)
    plt.close(figure)


def main(argv=None):
    """Solve the problem, certify it on poses of its own, and draw it."""
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

    rays, steps, starts, checked = (64, 6, 1, 20_000) if args.small else (341, 25, 6, 4_000_000)
    result = js.design.optimize(**problem(rays), steps=steps, starts=starts)
    first, robot = result.initial, result.robot
    print(f"{result.status.name} in {time.perf_counter() - began:.0f} s; best of {starts} starts")
    for name, old in reference().items():
        print(f"  {name:<13} {old:.4f} -> {float(result.params[name]):.4f}")
    sample = js.Cylinder(first.length / 2, first.length).quasi_random(checked, seed=2)
    seen = result.validate(
        lambda design: -js.workspace.fraction(design, sample),
        [lambda design: slacks(design, first, jnp.linspace(0.5, 1.5, 41))],
    )
    print(f"hard fraction on {checked} other poses: {-float(seen.before):.4f} -> {-float(seen.after):.4f}")
    print(f"least slack of ground and height amplification at 41 heights: {float(seen.constraints_after):+.4f}")
    multipliers = result.multipliers.constraints.round(3)
    print(f"multipliers of the constraints (amplification at 5 heights, ground): {multipliers}")
    print("what keeps the tuned robot out of the rest of the cylinder:")
    print(js.workspace.limiting_constraints(robot, sample))
    draw(result, args.figures)
    print(f"figures in {args.figures}/, {time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
