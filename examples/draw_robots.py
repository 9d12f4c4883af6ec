"""Draw the robots of the papers side by side, each in an ordinary pose, as in the README; NaVARo II twice.

Run ``python examples/draw_robots.py``; the picture goes to ``figures/robots.png``.
"""

import argparse
import pathlib

import jax
import matplotlib
import numpy as np

import jaxscissor as js

ROBOTS = [
    ("Triple Scissor Extender", js.TripleScissorExtender.prototype, [0.1, 0.05, 1.1, 0.1, 0.2, 0.3], "m"),
    ("NaVARo II, scissors laid down", js.NavaroII.prototype, [40.0, 24.0, 0.4], ""),
    ("NaVARo II", js.NavaroII.prototype, [40.0, 24.0, 0.4], ""),
    ("Tri-Scott", js.TriScott.prototype, [0.05, 0.05, 0.75, 0.1, 0.15, -1.2], "m"),
    ("MICABO", js.Micabo.prototype, [-0.05, 0.1, 0.9, -0.1, 0.1, -1.8], "m"),
    ("Gough-Stewart", js.StewartGough.prototype, [0.1, 0.0, 1.2, 0.1, -0.1, 0.1], "m"),
]


def draw(path):
    """All robots in two rows."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(13, 8))
    for place, (name, make, pose, unit) in enumerate(ROBOTS):
        flat = "laid down" in name
        ax = figure.add_subplot(2, 3, place + 1, projection=None if flat else "3d")
        js.plot.robot(make(), np.array(pose), ax=ax, unit=unit)
        ax.set_title(name, fontsize=11)
    figure.subplots_adjust(wspace=0.3, hspace=0.25)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=85, bbox_inches="tight")
    plt.close(figure)


def main(argv=None):
    """Draw and say where."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figures", type=pathlib.Path, default=pathlib.Path("figures"))
    args = parser.parse_args(argv)
    matplotlib.use("Agg")
    jax.config.update("jax_enable_x64", True)
    draw(args.figures / "robots.png")
    print(f"picture in {args.figures}/robots.png")


if __name__ == "__main__":
    main()
