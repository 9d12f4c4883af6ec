"""Legs for NaVARo II: the stroke that a task needs, and the scissor that gives it, for every number of crosses.

A designer's task [NAV19 4.1]: base and platform are given. The platform is to reach every point of a disc of
radius 25 about the middle of the base, with every angle from -90 to 90 deg. Which stroke must the legs have,
and how long are the bars of a scissor of n equal crosses with that stroke, how wide is it folded, and how much faster
than its base does it move? The paper prints r_min = 9.641016 and r_max = 79.772256, and takes 9 and 80.

Run ``python examples/design_navaro_stroke.py``; ``--small`` for a quick look. Figures go to ``figures/``. The paper
gives no unit of length.
"""

import argparse
import pathlib

import jax
import matplotlib
import numpy as np

import jaxscissor as js

RADIUS, TURN = 25.0, np.pi / 2


def needed(robot, samples):
    """Least and greatest length of any leg over the disc, and the two poses."""
    disc = js.Disc(robot.base.mean(axis=0), RADIUS, -TURN, TURN)
    found = js.workspace.joint_range(robot, disc, samples=samples)
    low, high = found.low[1::2], found.high[1::2]
    poses = found.low_poses[1::2][low.argmin()], found.high_poses[1::2][high.argmax()]
    return float(low.min()), float(high.max()), poses


def scissor(stroke, crosses):
    """The scissor of equal bars whose folded height is the least and whose folded width the greatest length over n.

    Folded, a cross of bars l is h high and w wide with h^2 + w^2 = l^2; opened to the greatest length the
    two change places [NAV19 eqs. 27-30].
    """
    bar = np.hypot(*stroke) / crosses
    return js.Scissor([bar / 2] * (crosses + 1), end="open")


def table(stroke, most):
    """One row for each number of crosses, checked by the scissor itself."""
    print(f"{'n':>2} {'bar':>8} {'bars in all':>12} {'pins':>5} {'folded (across x along)':>24} {'speed dh/dw':>22}")
    for crosses in range(1, most + 1):
        legs = scissor(stroke, crosses)
        wide, narrow = float(legs.width(stroke[0])), float(legs.width(stroke[1]))
        assert np.allclose([wide, narrow], [stroke[1] / crosses, stroke[0] / crosses], rtol=1e-12)
        assert np.allclose([legs.height(wide), legs.height(narrow)], stroke, rtol=1e-12)
        bar, speeds = 2 * float(legs.base_link), [float(legs.gain(width)) for width in (wide, narrow)]
        print(
            f"{crosses:>2} {bar:8.3f} {2 * crosses * bar:12.3f} {3 * crosses + 2:>5} {wide:12.3f} x {stroke[0]:7.3f}"
            f" {speeds[0]:11.2f} to {speeds[1]:6.2f}"
        )


def draw(robot, poses, stroke, most, folder):
    """The two poses that need the ends of the stroke, and legs of two to six crosses folded."""
    import matplotlib.pyplot as plt

    folder.mkdir(exist_ok=True)
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
    for ax, pose in zip(axes, poses, strict=False):
        js.plot.robot(robot, pose, ax=ax, unit="unit")
        ax.add_patch(plt.Circle(np.asarray(robot.base.mean(axis=0)), RADIUS, fill=False, linestyle=":"))
    for place, crosses in enumerate(n for n in (2, 3, 4, 6) if n <= most):
        legs = scissor(stroke, crosses)
        for start, end in legs.bars(legs.width(stroke[0])):
            across, along = np.stack([start, end], axis=1)
            axes[2].plot(across, along + 15 * place, "k-", linewidth=1)
        axes[2].annotate(f"n = {crosses}", (24, 4 + 15 * place), va="center")
    axes[2].set(xlabel="across the folded leg (unit)", ylabel="along the leg (unit)", aspect="equal", xlim=(-24, 40))
    figure.savefig(folder / "navaro_stroke.png", dpi=110)
    plt.close(figure)


def main(argv=None):
    """Find the stroke, size the scissors, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="few poses and crosses, for a quick look")
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("figures"))
    args = parser.parse_args(argv)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)

    samples, most = (256, 3) if args.small else (2048, 8)
    robot = js.NavaroII.prototype()
    low, high, poses = needed(robot, samples)
    known = 20 * np.sqrt(3) - 25, 25 + 10 * np.sqrt(30)
    print(f"stroke needed: {low:.6f} to {high:.6f}; [NAV19 eqs. 13-26]: {known[0]:.6f} to {known[1]:.6f}")
    print(f"off by {abs(low - known[0]):.1e} and {abs(high - known[1]):.1e}")
    for name, pose in zip(("least", "greatest"), poses, strict=True):
        x, y, alpha = np.asarray(pose)
        print(f"  the {name} length is needed at ({x:.2f}, {y:.2f}), {np.rad2deg(alpha):.1f} deg")
    print("scissors for the stroke that the paper takes, 9 to 80:")
    table((9.0, 80.0), most)
    draw(robot, poses, (9.0, 80.0), most, args.figures)
    print(f"figures in {args.figures}/")


if __name__ == "__main__":
    main()
