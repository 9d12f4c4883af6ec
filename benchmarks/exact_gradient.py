"""Value and gradient of the exact workspace fraction against references that share no code with it.

Of robots whose legs are straight lines the reached length of a ray is known in closed form, in NumPy; it is differenced
in the design with large steps (Richardson), so that nothing but lengths is compared. Of the others, rays of other seeds
along all axes are scanned and bisected by the sign of the margin, and the boundary integral is taken with central
differences of the margin. Two independent sets of rays tell how far a reference has converged itself. The area of the
ring is known. All derivatives are by relative changes of the dimensions.
Run ``python -m benchmarks.exact_gradient [--small]``.
"""

import argparse
import dataclasses
import json
import time
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js
from benchmarks.report import RESULTS
from benchmarks.soft_gradient import PROTOTYPE, build
from benchmarks.timing import interleaved, machine

CELLS, BISECTIONS, BLOCK = 4096, 30, 4096  # between coarser cells the TSE has gaps that matter


class Case(NamedTuple):
    """A design of relative changes, their names, the region, its open axes, and the axis of the reference's rays."""

    robot: object
    names: tuple
    region: object
    axes: tuple
    along: int = 0  # axis of the reference's rays


def scaled(robot, fields, change):
    """The robot with these fields times 1 + change; those of ``stroke`` are its lower and upper ends."""
    fixed = [field for field in fields if field != "stroke"]
    new = {field: getattr(robot, field) * (1 + change[i]) for i, field in enumerate(fixed)}
    if "stroke" in fields:
        new["stroke"] = tuple(end * (1 + change[len(fixed) + i]) for i, end in enumerate(robot.stroke))
    return dataclasses.replace(robot, **new)


def ring():
    corners = 0.5 * np.array([[np.cos(a), np.sin(a)] for a in (0, 2 * np.pi / 3, 4 * np.pi / 3)])
    return js.NavaroII(corners, corners, (0.4, 1.0))


def tri_scott():
    """No symmetry and no straight lines, on which two limits would coincide."""
    masts, platform = [[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]], [[-0.2, -0.1], [0.25, -0.1], [0.0, 0.2]]
    return js.TriScott(masts, [0.8, 0.9, 0.7], platform, crank_lengths=[0.42, 0.4, 0.38])


def cases():
    planar, linked = ("base", "platform", "stroke"), ("masts", "platform", "link_lengths", "crank_lengths")
    lengths = ("base", "platform", "shortest", "longest")
    skewed = tri_scott()
    home, reach = np.asarray(skewed.home()[0]), 0.45 * float(skewed.length) * np.array([1, 1, 1, 0, 0, 0])
    navaro, hexapod = js.NavaroII.prototype(), js.StewartGough.prototype()
    level = js.Box([-1.5, -1.4, 0.0, 0.1, -0.2, 0.1], [1.3, 1.5, 2.2, 0.1, -0.2, 0.1])
    plane = js.Box([-1.1, -1.2, 0.0], [1.2, 1.1, 0.0])
    return {
        "TSE": Case(
            lambda p: build(jnp.asarray(PROTOTYPE) * (1 + p)),
            ("k1", "k2", "k3", "k4", "stop_low", "stop_high"),
            js.Cylinder(0.5, 1.0),
            (0, 1, 2),
        ),
        "NaVARo II": Case(
            partial(scaled, navaro, planar), lengths, js.Box([0.0, 0.0, -0.3], [90.0, 80.0, 0.3]), (0, 1, 2)
        ),
        "Gough-Stewart": Case(partial(scaled, hexapod, planar), lengths, level, (0, 1, 2)),
        "Tri-Scott": Case(
            partial(scaled, skewed, linked), linked, js.Box(home - 0.93 * reach, home + reach), (0, 1, 2)
        ),
        "ring": Case(partial(scaled, ring(), ("stroke",)), ("inner", "outer"), plane, (0, 1)),
    }


def rays_of(case, rays, seed):
    """Points of the unit cube from which rays start, by an additive recurrence."""
    others = [axis for axis in case.axes if axis != case.along]
    units = np.full((rays, case.region.unit_dimension), 0.5)
    steps = np.array([0.7548776662466927, 0.5698402909980532])[: len(others)]
    units[:, others] = (np.random.default_rng(seed).random(len(others)) + np.arange(rays)[:, None] * steps) % 1
    return units


def straight_legs(case, units, change):
    """Mean share of rays along x of a box in which all legs |x - c| lie within the stroke: chords, in NumPy."""
    robot = jax.tree.map(np.asarray, case.robot(jnp.asarray(change)))
    poses = np.asarray(case.region.low + (case.region.high - case.region.low) * units)
    turn = rotations(poses)
    centers = robot.base - np.einsum("nij,kj->nki", turn, robot.platform)
    position = poses[:, None, 1 : robot.base.shape[1]]
    across2 = np.sum((position - centers[:, :, 1:]) ** 2, axis=2)
    edges = np.asarray(case.region.low[0]), np.asarray(case.region.high[0])
    inner, outer = (np.sqrt(np.maximum(end**2 - across2, 0)) for end in robot.stroke)
    outer = np.where(across2 > robot.stroke[1] ** 2, -np.inf, outer)
    low = np.clip((centers[:, :, 0] - outer).max(axis=1), *edges)[:, None]
    high = np.maximum(low, np.minimum(edges[1], (centers[:, :, 0] + outer).min(axis=1))[:, None])
    starts, stops = (np.clip(centers[:, :, 0] + sign * inner, low, high) for sign in (-1, 1))
    order = np.argsort(starts, axis=1)
    starts, stops = (np.take_along_axis(ends, order, axis=1) for ends in (starts, stops))
    furthest = np.maximum.accumulate(np.concatenate([low, stops], axis=1), axis=1)
    holes = np.maximum(furthest[:, 1:] - np.maximum(starts, furthest[:, :-1]), 0).sum(axis=1)
    return np.mean(high[:, 0] - low[:, 0] - holes) / (edges[1] - edges[0])


def rotations(poses):
    """Of planar poses (x, y, alpha), and of spatial ones, R = Rx Ry Rz."""
    if poses.shape[1] == 3:
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=1)
    (r, p, y), one = poses[0, 3:], np.eye(3)
    turns = [
        one * np.cos(a) + (1 - np.cos(a)) * np.outer(u, u) + np.sin(a) * np.cross(one, u)
        for a, u in zip((r, p, y), one, strict=True)
    ]
    return np.broadcast_to(turns[0] @ turns[1] @ turns[2], (len(poses), 3, 3))


def crossings(inside, units, along):
    """Points where rays along one axis cross the boundary, whether they leave there, and how many end inside."""

    def moved(rows, places):
        points = units[rows].copy()
        points[:, along] = places
        return points

    edges = np.linspace(1e-9, 1 - 1e-9, CELLS + 1)
    found = np.stack([inside(moved(slice(None), edge)) for edge in edges], axis=1)
    ray, cell = np.nonzero(found[:, 1:] != found[:, :-1])
    low, high, leaving = edges[cell], edges[cell + 1], found[ray, cell]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        same = inside(moved(ray, middle)) == leaving
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return moved(ray, (low + high) / 2), leaving, found[:, -1].sum()


def by_boundary(case, rays, seed, step=1e-6):
    """Value by rays along all axes, and the boundary integral of the margin's change over its slope."""

    @jax.jit
    @partial(jax.vmap, in_axes=(None, 0))
    def margins(change, unit):
        return js.feasibility(case.robot(change), case.region.from_unit(unit)).margin

    def judged(change, units):
        blocks = np.zeros((max(-(-len(units) // BLOCK), 1) * BLOCK, units.shape[1]))
        blocks[: len(units)] = units
        change = jnp.asarray(change)
        return np.concatenate([margins(change, block) for block in blocks.reshape(-1, BLOCK, units.shape[1])])[
            : len(units)
        ]

    size = len(case.names)
    zero, total = np.zeros(size), np.zeros(size + 1)
    for along in case.axes:
        units = rays_of(case._replace(along=along), rays, seed)
        points, leaving, ends = crossings(lambda units: judged(zero, units) >= 0, units, along)

        def slope(change, way, points=points):
            return (judged(change, points + way) - judged(-change, points - way)) / (2 * step)

        slopes = np.stack([slope(zero, step * way) for way in np.eye(units.shape[1])[list(case.axes)]])
        weight = np.abs(slopes[case.axes.index(along)]) / np.sum(slopes**2, axis=0)
        total[0] += (np.where(leaving, 1, -1) @ points[:, along] + ends) / len(case.axes)
        total[1:] += [np.sum(slope(step * way, 0) * weight) for way in np.eye(size)]
    return total / rays


def by_differences(measure, size, step=8e-3):
    """Value, then the derivative by each relative change, by Richardson extrapolation."""
    found = [measure(np.zeros(size))]
    for axis in np.eye(size):
        wide, narrow = ((measure(h * axis) - measure(-h * axis)) / (2 * h) for h in (step, step / 2))
        found.append((4 * narrow - wide) / 3)
    return np.array(found)


def reference_of(name, case, rays):
    """The reference, and how far two halves of its rays differ."""
    if name in ("NaVARo II", "Gough-Stewart"):
        sets = [rays_of(case, 32 * rays, seed) for seed in (0, 1)]
        pair = [by_differences(partial(straight_legs, case, units), len(case.names)) for units in sets]
    else:
        pair = [by_boundary(case, rays, seed) for seed in (0, 1)]
    return sum(pair) / 2, errors(*pair)


def closed_form(case):
    """Value and derivatives of the ring."""
    (inner, outer), sides = (0.4, 1.0), np.asarray(case.region.high - case.region.low)[:2]
    return np.pi / sides.prod() * np.array([outer**2 - inner**2, -2 * inner**2, 2 * outer**2])


def errors(found, reference):
    """Of the value; of the gradient by its norm; of every dimension by itself. All relative."""
    off = found[1:] - reference[1:]
    norm = float(np.linalg.norm(off) / np.linalg.norm(reference[1:]))
    return float(abs(found[0] / reference[0] - 1)), norm, [float(x) for x in np.abs(off / reference[1:])]


def accuracy(name, case, rays, reference_rays):
    begun = time.perf_counter()
    if name == "ring":
        reference, spread = closed_form(case), None
    else:
        reference, spread = reference_of(name, case, reference_rays)
    took = time.perf_counter() - begun
    print(f"{name}: value {reference[0]:.6f}, derivatives", dict(zip(case.names, reference[1:].round(5), strict=True)))
    if spread:
        print(
            f"  reference, one half against the other: value {spread[0]:.1e}, gradient {spread[1]:.1e} ({took:.0f} s)"
        )
    rows = []
    for axes, counts in (((case.axes[0],), rays[-1:]), (case.axes, rays)):
        for count in counts:

            def fraction(change, count=count, axes=axes):
                return js.workspace.ray_fraction(case.robot(change), case.region, rays=count, axes=axes)

            value, gradient = jax.jit(jax.value_and_grad(fraction))(jnp.zeros(len(case.names)))
            found = errors(np.array([value, *gradient]), reference)
            rows.append({"axes": axes, "rays": count, "value": found[0], "gradient": found[1], "each": found[2]})
            each = " ".join(f"{x:.1e}" for x in found[2])
            print(
                f"  axes {axes!s:10} rays {count:7}  value {found[0]:.1e}  gradient {found[1]:.1e}  each {each}",
                flush=True,
            )
    return {"reference": reference.tolist(), "spread": spread, "names": case.names, "rows": rows}


def cost(counts):
    """Time of value-and-gradient over that of the value, and the programs' temporary memory."""
    robot = js.TripleScissorExtender.prototype()
    cylinder = js.Cylinder(robot.length / 2, robot.length)
    rows = []
    for count in counts:
        functions = {
            "soft": partial(js.workspace.soft_fraction, poses=cylinder.quasi_random(count)),
            "exact": partial(js.workspace.ray_fraction, region=cylinder, rays=count // 64),
        }
        for name, function in functions.items():
            programs = {"value": jax.jit(function), "both": jax.jit(jax.value_and_grad(function))}
            compiled = {key: program.lower(robot).compile() for key, program in programs.items()}
            memory = {key: program.memory_analysis().temp_size_in_bytes for key, program in compiled.items()}
            runs = {key: partial(lambda run: jax.block_until_ready(run(robot)), run) for key, run in compiled.items()}
            times = interleaved(runs, 3)
            wall, cpu = (times["both"][i] / times["value"][i] for i in (0, 1))
            rows.append({"of": name, "poses": count, "wall_ratio": wall, "cpu_ratio": cpu, "memory_bytes": memory})
            print(rows[-1] | {"value_s": times["value"][0]}, flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="fewer rays, for a look")
    parser.add_argument("--only", nargs="+", help="names of robots")
    parser.add_argument("--skip-cost", action="store_true")
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rays = (512, 2048) if args.small else (1024, 4096, 16_384)
    reference_rays = 1024 if args.small else 16_384
    chosen = {name: case for name, case in cases().items() if not args.only or name in args.only}
    results = {name: accuracy(name, case, rays, reference_rays) for name, case in chosen.items()}
    if not args.skip_cost:
        results["cost"] = cost((10**4, 10**5) if args.small else (10**5, 10**6))
    if not args.small and not args.only:
        text = json.dumps(results | {"machine": machine()}, indent=1)
        (RESULTS / "exact_gradient.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
