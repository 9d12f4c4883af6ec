"""The linear delta of tests/toys.py in NumPy: slides above the platform, closed forms of both kinematics."""

import numpy as np

FEET = 0.5 * np.stack([np.cos(2 * np.pi * np.arange(3) / 3), np.sin(2 * np.pi * np.arange(3) / 3)], axis=1)


def drop(position, rod=1.0):
    """How far each slide is above the platform."""
    across = np.asarray(position)[..., None, :2] - FEET
    return np.sqrt(rod**2 - (across**2).sum(axis=-1))


def slides(position, rod=1.0):
    return np.asarray(position)[..., 2:] + drop(position, rod)


def jacobian(position, rod=1.0):
    """d slides / d position."""
    across = np.asarray(position)[:2] - FEET
    return np.column_stack([-across / drop(position, rod)[:, None], np.ones(3)])


def position(joints, rod=1.0):
    """Where three spheres about the slides meet, below them."""
    centers = np.column_stack([FEET, joints])
    along = centers[1:] - centers[0]
    normal = np.cross(along[0], along[1])
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    right = np.array([along[0] @ along[0], along[1] @ along[1], 0]) / 2
    middle = np.linalg.solve(np.vstack([along, normal]), right)
    return centers[0] + middle - normal * np.sqrt(rod**2 - middle @ middle)
