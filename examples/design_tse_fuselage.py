"""The smallest Triple Scissor Extender that works along an arc of fuselage, from wall to wall over the ceiling.

A designer's task: a crown panel of 1 m radius about an axis 0.7 m above the floor is to be worked on from 45 deg
on the one side to 45 deg on the other, over 0.4 m of its length, the platform square to the panel everywhere.
Which robot does it with the least footprint and stroke, the two added, at 2 % margin from every stop and
from the edge of its working mode, and with both singularity measures at least a tenth of what they are at home?
Seven dimensions are free: the scissors' length and base bar, slide angle, distance of the slides from the
centre, top radius, and least slide coordinate and stroke. The top must carry a tool 0.1 m in radius.

Run ``python examples/design_tse_fuselage.py``; ``--small`` for a quick look. Figures go to ``figures/``.
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

STOPS = (np.deg2rad(10.8), np.deg2rad(69.6))  # of the scissors, as the prototype of [RAL17 V] has them
CLEAR = 0.02  # margin from every limit
STRONG = 0.1  # least singularity measure, in parts of that at home


@js.pytree
class Panel(js.regions.Region):
    """Poses (along the panel, angle about its axis) that put the platform square to it; lengths in metres."""

    radius: float = 1.0
    axis: float = 0.7  # above the floor
    length: float = 0.4

    @property
    def unit_dimension(self):
        """Along the panel, and about its axis."""
        return 2

    def from_unit(self, unit):
        """Pose (x, y, z, roll, 0, 0)."""
        along, angle = (unit[0] - 0.5) * self.length, (unit[1] - 0.5) * jnp.pi / 2
        across, up, zero = self.radius * jnp.sin(angle), self.axis + self.radius * jnp.cos(angle), 0 * angle
        return jnp.stack([along, across, up, -angle, zero, zero])


def build(size):
    """The robot of seven numbers."""
    length = size["length"]
    ratios = size["base_bar"] / length, size["slide_angle"], size["feet_radius"] / length, size["top_radius"] / length
    stroke = jnp.stack([size["least_slide"], size["least_slide"] + size["stroke"]])
    return js.TripleScissorExtender.from_ratios(*ratios, length=length, stroke=stroke, scissor_angle=STOPS)


def footprint(robot):
    """Radius of the circle about the slides' outer ends."""
    end, angle = robot.stroke[1], robot.actuator_angle
    return js.safe_sqrt((robot.actuator_radius + end * jnp.sin(angle)) ** 2 + (end * jnp.cos(angle)) ** 2)


def size_of(robot):
    """What is to be small, in metres."""
    return footprint(robot) + robot.stroke[1] - robot.stroke[0]


def clearances(robot, poses):
    """By how much each pose (n, 3) keeps clear of the limits and of singularities of type 1 and 2, for each leg."""

    def at(pose):
        solution = js.inverse_kinematics(robot, pose)
        measures = js.singularities.measures(robot, pose, joints=solution.value)
        both = jnp.append(measures.type1, measures.type2)
        return js.margins(robot, pose).ravel(), jnp.where(solution.converged, both, jnp.nan)

    margins, measures = jax.lax.map(at, jnp.concatenate([robot.home()[0][None], poses]), batch_size=1024)
    parts = measures[1:] / measures[:1]
    return margins[1:] - CLEAR, parts[:, :3] - STRONG, parts[:, 3:] - STRONG


def problem(shape=(5, 25)):
    """Arguments of ``design.optimize``, with the task on a grid of poses that has its edges and corners."""
    units = jnp.stack(jnp.meshgrid(*(jnp.linspace(0, 1, n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 2)
    poses = jax.vmap(Panel().from_unit)(units)
    names = ("length", "base_bar", "slide_angle", "feet_radius", "top_radius", "least_slide", "stroke")
    start = (2.5, 0.7, 0.5, 0.05, 0.2, 0.01, 0.8)
    low, high = (1.0, 0.1, 0.0, 0.03, 0.1, 0.0, 0.1), (4.0, 1.0, 1.0, 0.5, 0.5, 0.3, 1.5)
    first, lowest, highest = (dict(zip(names, values, strict=True)) for values in (start, low, high))
    return {
        "objective": size_of,
        "params": first,
        "bounds": (lowest, highest),
        "build": build,
        "constraints": [lambda robot: jnp.concatenate(clearances(robot, poses), axis=1)],
    }


def draw(robot, dense, clear, folder):
    """The robot at three poses of the task, and how clear of everything it is over the panel."""
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    figure = plt.figure(figsize=(15, 4.2), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.25)  # beside the labels of the axes in space
    for column, unit in enumerate(([0.5, 0.0], [0.5, 0.5], [1.0, 1.0])):
        ax = figure.add_subplot(1, 4, column + 1, projection="3d")
        js.plot.robot(robot, Panel().from_unit(jnp.array(unit)), ax=ax)
        ax.set(xlim=(-0.9, 0.9), ylim=(-0.9, 0.9), zlim=(0, 1.8), aspect="equal")
        ax.view_init(elev=15, azim=-20)
    ax = figure.add_subplot(1, 4, 4, box_aspect=1)
    angles = np.rad2deg(-np.asarray(dense[:, 3]))
    for values, name, mark in zip(clear, ("limits", "type 1", "type 2"), "o^s", strict=True):
        bins = np.linspace(-45, 45, 46)
        lowest = [values[np.digitize(angles, bins) == i].min(initial=np.inf) for i in range(1, len(bins))]
        ax.plot((bins[1:] + bins[:-1]) / 2, lowest, f"k-{mark}", markevery=9, markerfacecolor="w", label=name)
    ax.axhline(0, color="0.6", linewidth=0.8)
    ax.set(xlabel="angle on the panel (deg)", ylabel="least clearance beyond what is asked (1)")
    ax.legend(frameon=False)
    figure.savefig(folder / "fuselage.png", dpi=110)
    plt.close(figure)


def main(argv=None):
    """Solve the problem, check it on poses of its own, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="few poses and steps, for a quick look")
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("figures"))
    args = parser.parse_args(argv)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)
    if args.small:  # there is little to compute, so that compiling takes most of the time
        os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
        jax.config.update("jax_disable_most_optimizations", True)
    began = time.perf_counter()

    shape, steps, starts, checked = ((3, 7), 20, 1, 1000) if args.small else ((5, 25), 60, 6, 100_000)
    result = js.design.optimize(**problem(shape), steps=steps, starts=starts)
    robot = result.robot
    print(f"{result.status.name} in {time.perf_counter() - began:.0f} s; best of {starts} starts")
    for name, value in result.params.items():
        held = [
            side
            for side, price in (("low", result.multipliers.low), ("high", result.multipliers.high))
            if price[name] > 0
        ]
        print(f"  {name:<12} {float(value):.4f}" + (f"  held at its {held[0]} bound" if held else ""))
    print(f"footprint {float(footprint(robot)):.3f} m, stroke {float(robot.stroke[1] - robot.stroke[0]):.3f} m")
    dense = Panel().quasi_random(checked, seed=1)[:]
    clear = [np.asarray(part).min(axis=1) for part in jax.jit(clearances)(robot, dense)]
    print(f"least clearance beyond what is asked, on {checked} other poses of the panel:")
    for name, column in zip(("limits", "type 1", "type 2"), clear, strict=True):
        print(f"  {name}: {column.min():+.5f}")
    multipliers = np.asarray(result.multipliers.constraints).reshape(shape[0] * shape[1], -1)
    limits, type1, type2 = (part.sum() for part in np.split(multipliers, [-4, -1], axis=1))
    print(f"multipliers of the three clearances, metres per unit: {limits:.3f}, {type1:.3f}, {type2:.3f}")
    draw(robot, dense, clear, args.figures)
    print(f"figures in {args.figures}/, {time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    main()
