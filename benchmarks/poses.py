"""The poses of every row, and the judge of every answer: closure and branch in plain NumPy."""

import math

import numpy as np

RATIOS = (0.2647, math.pi / 6, 0.0186, 0.11765)  # of the prototype [RAL17 V], L = 1


def tse_poses(count, seed=0):
    """A box around the middle of the workspace, tall enough that one pose in five is out of reach."""
    low, high = [-0.15, -0.15, 0.3, -0.2, -0.2, -0.2], [0.15, 0.15, 0.9, 0.2, 0.2, 0.2]
    return np.random.default_rng(seed).uniform(low, high, (count, 6))


def poses_near_home(robot, count, seed=0):
    """Fifteen hundredths of the robot's length and 0.2 rad to either side of home."""
    space = robot.space
    spread = np.full(space.dimension, 0.2)
    spread[: space.translations] = 0.15 * float(robot.length)
    return np.asarray(robot.home()[0]) + np.random.default_rng(seed).uniform(-spread, spread, (count, space.dimension))


def leg_conics(ratios, poses):
    """For each leg (a, b, h, p2, m2) of p m - a m - b p = 0 and p2 p^2 + m2 m^2 - (p a + m b) / 2 + h = 0."""
    k1, eta, k3, k4 = ratios
    x, y, z = poses[:, :3].T
    (sr, sp, sy), (cr, cp, cy) = np.sin(poses[:, 3:]).T, np.cos(poses[:, 3:]).T
    n = np.stack([cp * cy, cr * sy + sr * sp * cy, sr * sy - cr * sp * cy])
    t = np.stack([-cp * sy, cr * cy - sr * sp * sy, sr * cy + cr * sp * sy])
    s, c, k = math.sin(eta), math.cos(eta), 1 / (4 * k1**2)
    for azimuth in 2 * np.pi * np.arange(3) / 3:
        ca, sa = math.cos(azimuth), math.sin(azimuth)
        px, py, pz = np.stack([x - k3 * ca, y - k3 * sa, z]) + k4 * (n * ca + t * sa)
        across, along = px * sa - py * ca, px * ca + py * sa
        height = across**2 + along**2 + pz**2 - 1
        yield 2 * along * s, 2 * across * c, height, s * s / 4 + k * c * c, c * c / 4 + k * s * s


def closure(p, m, a, b, h, p2, m2):
    """Both closure equations of a leg."""
    return (p - a) * m - b * p, p2 * p * p + m2 * m * m - (p * a + m * b) / 2 + h


def judge(ratios, poses, joints):
    """Norm of the closure at the joints, and whether every leg is in the home mode, which is unique."""
    squares, home = np.zeros(len(poses)), np.ones(len(poses), bool)
    with np.errstate(invalid="ignore", over="ignore"):
        for i, (a, b, h, p2, m2) in enumerate(leg_conics(ratios, poses)):
            first, second = joints[:, 2 * i], joints[:, 2 * i + 1]
            p, m = first + second, first - second
            f, g = closure(p, m, a, b, h, p2, m2)
            det = (m - b) * (2 * m2 * m - b / 2) - (p - a) * (2 * p2 * p - a / 2)
            squares += f * f + g * g
            home &= (det < 0) & (p > a) & (first >= 0) & (second >= 0)
    return np.sqrt(squares), home
