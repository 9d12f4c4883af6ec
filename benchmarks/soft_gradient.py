"""Gradient of the soft workspace fraction against the derivative of the hard one.

The reference uses no gradient of the library: on rays along the three axes of the paper's cylinder the
boundary is located by a dense scan and bisection, and its speed under a change of the design follows from
central differences of the margin. Run ``python -m benchmarks.soft_gradient``.
"""

import argparse
import math

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js

NAMES = ("k1", "k2", "k3", "k4", "stop_low", "stop_high")
PROTOTYPE = np.array([0.2647, math.pi / 6, 0.0186, 0.11765, math.asin(0.324 / 1.727), math.asin(1.619 / 1.727)])


def build(theta):
    return js.TripleScissorExtender.from_ratios(*theta[:4], scissor_angle=(theta[4], theta[5]))


def margin(theta, unit):
    """Margin at a point (radius, angle, height) of the unit cube, which is the cylinder in the paper's measure."""
    return js.feasibility(build(theta), js.Cylinder(0.5, 1.0).from_unit(unit)).margin


margins = jax.jit(jax.vmap(margin, (None, 0)))


def crossings(theta, axis, rays, cells):
    """Points ``(n, 3)`` where rays along one axis of the unit cube cross the boundary of the workspace."""
    points = np.array(js.Box(np.zeros(3), np.ones(3)).quasi_random(rays)[:])

    def reached(numbers, values):
        moved = points[numbers].copy()
        moved[:, axis] = values
        return np.asarray(margins(theta, moved)) >= 0

    edges = np.linspace(1e-9, 1, cells + 1)
    inside = np.stack([reached(slice(None), edge) for edge in edges], axis=1)
    ray, cell = np.nonzero(inside[:, 1:] != inside[:, :-1])
    low, high, entering = edges[cell], edges[cell + 1], ~inside[ray, cell]
    for _ in range(45):
        middle = (low + high) / 2
        before = reached(ray, middle) != entering
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    found = points[ray]
    found[:, axis] = (low + high) / 2
    return found


def boundary_derivative(theta, rays, cells=3200, step=1e-7):
    """Derivative of the hard fraction: the boundary integral of the margin's change over its gradient.

    Each axis takes the part m_i^2 / |grad m|^2 of the boundary, so that no ray has to be tangent to it.
    """
    total = np.zeros(len(theta))
    for axis in range(3):
        points = crossings(theta, axis, rays, cells)

        def change(dt, du, points=points):
            forward, back = margins(theta + dt, points + du), margins(theta - dt, points - du)
            return np.asarray(forward - back) / (2 * step)

        slopes = np.stack([change(0, step * basis) for basis in np.eye(3)])
        weight = np.abs(slopes[axis]) / np.sum(slopes**2, axis=0)
        total += [np.sum(change(step * basis, 0) * weight) / rays for basis in np.eye(len(theta))]
    return total


def designs(count, seed=0):
    generator = np.random.default_rng(seed)
    yield PROTOTYPE
    while count:
        theta = generator.uniform([0.15, -0.6, 0.0, 0.05, 0.05, 1.1], [0.6, 0.9, 0.2, 0.25, 0.3, 1.4])
        try:
            build(jnp.asarray(theta))
        except ValueError:
            continue
        count -= 1
        yield theta


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rays", type=int, default=8_000, help="along each axis")
    parser.add_argument("--poses", type=int, default=32_000_000)
    parser.add_argument("--sharpness", type=float, nargs="+", default=[400.0])
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    samples = [js.Cylinder(0.5, 1.0).quasi_random(args.poses, seed) for seed in range(2)]
    for theta in designs(5):
        theta = jnp.asarray(theta)
        reference = boundary_derivative(theta, args.rays)
        scale = np.maximum(np.abs(reference), 0.05 * np.abs(reference).max())
        spread = np.abs(boundary_derivative(theta, args.rays // 4) - reference) / scale
        fraction = js.workspace.fraction(build(theta), samples[0])
        print(f"theta {np.round(theta, 4)}  fraction {fraction:.5f}")
        print(f"  boundary    {np.round(reference, 4)}  a quarter of the rays differs by {spread.max():.4f}")
        for sharpness in args.sharpness:

            def gradient(sample, theta=theta, sharpness=sharpness):
                return jax.grad(lambda t: js.workspace.soft_fraction(build(t), sample, sharpness=sharpness))(theta)

            first, second = (np.asarray(gradient(sample)) for sample in samples)
            error, noise = np.abs(first - reference) / scale, np.abs(second - first) / scale
            worst = f"worst {error.max():.4f} ({NAMES[int(error.argmax())]}), another sample {noise.max():.4f}"
            print(f"  soft {sharpness:6.0f} {np.round(first, 4)}  {worst}", flush=True)


if __name__ == "__main__":
    main()
