"""A robot at one configuration, in numbers: where its bars are, what they weigh and how they hang together."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.programs import run_once
from jaxscissor._engine.pytree import is_concrete
from jaxscissor._engine.types import JointsLike, PoseLike, PyTree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._configuration import configuration
from jaxscissor.kinematics._legs import place
from jaxscissor.robots._bodies import Connection
from jaxscissor.robots._contract import Attachment, Joints, Leg, Mechanism, joints_by_leg
from jaxscissor.robots._over_legs import one_by_one, over_legs
from jaxscissor.statics._bodies import Bodies, bodies_of, centers_of
from jaxscissor.statics._materials import Section


class PosedLeg(NamedTuple):
    """One leg: bars and rails ``(k, 2, 3)``, the bars' masses ``(k,)`` and centers ``(k, 3)`` if there is a section."""

    bars: np.ndarray
    rails: np.ndarray
    weighed: tuple[np.ndarray, np.ndarray] | None
    connections: list[Connection]


class Posed(NamedTuple):
    """A robot at one configuration, in the base frame."""

    pose: np.ndarray
    joints: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    axes: np.ndarray  # (d, 3), along or about which the platform moves with each coordinate of the pose
    length: float
    legs: list[PosedLeg]


def posed(robot: Mechanism, pose: PoseLike | None, joints: JointsLike | None, section: Section | None) -> Posed:
    """The robot at a pose, or at home, in the widest floating numbers that JAX is set to.

    Raises:
      ValueError: traced numbers; wrong shapes; legs that do not say how their bars hang together; a pose that the home
        mode does not reach while no joints are given.
    """
    robot = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(float)), robot)
    if not is_concrete(robot):
        raise ValueError("Got a robot that is being traced. A file holds numbers: write it outside jit, vmap and grad.")
    robot, pose, joints = configuration(robot, pose, joints)
    section = jax.tree.map(lambda leaf: jnp.asarray(leaf, pose.dtype), section)
    (position, rotation), rates, length, legs = jax.tree.map(np.asarray, _described(robot, pose, joints, section))
    legs = [PosedLeg(_segments(bars), _segments(rails), *rest) for bars, rails, *rest in legs]
    if not all(leg.connections for leg in legs):
        raise ValueError(
            f"{type(robot.legs()).__name__} does not say how its bars hang together; expected a method "
            "connections(joints, attachment) with a Connection for every place where two parts are held together."
        )
    frame = np.eye(3)
    for i, column in enumerate(rotation.columns):
        frame[:, i] = in_space(column)
    axes = _axes(robot.space.translations, frame, *rates)
    return Posed(np.asarray(pose), np.asarray(joints), in_space(position), frame, axes, float(length), legs)


def _axes(translations: int, frame: np.ndarray, velocity: Vec, turning: Rotation) -> np.ndarray:
    """Unit axes of the pose's coordinates, from the derivatives of position and rotation by each of them."""
    axes = np.zeros((len(velocity.x), 3))
    for i in range(len(axes)):
        shift, turned = jax.tree.map(lambda leaf, i=i: leaf[i], (velocity, turning))
        spin = np.zeros((3, 3))
        for k, column in enumerate(turned.columns):
            spin[:, k] = in_space(column)
        spin = spin @ frame.T  # dR R^T, skew
        axes[i] = in_space(shift) if i < translations else [spin[2, 1], spin[0, 2], spin[1, 0]]
    return axes


def in_space(vector: Vec) -> np.ndarray:
    """A point or direction of a robot in space; one of the plane has no height."""
    return np.array([*map(float, vector.components), 0.0])[:3]


def _segments(segments: list[tuple[Vec, Vec]]) -> np.ndarray:
    return np.array([[in_space(end) for end in segment] for segment in segments]).reshape(-1, 2, 3)


@run_once
def _described(robot: Mechanism, pose: jax.Array, joints: jax.Array, section: Section | None) -> PyTree:
    placed = place(robot, pose)
    weights = None if section is None else bodies_of(robot, section)

    def of_leg(leg: Leg, q: Joints, seen: Attachment, bodies: Bodies | None) -> PyTree:
        weighed = None if bodies is None else (bodies.masses, centers_of(leg, q, seen, bodies))
        return list(leg.bars(q, seen)), list(leg.rails(q, seen)), weighed, list(leg.connections(q, seen))

    legs = over_legs(of_leg, placed.legs, joints_by_leg(robot, joints), placed.attachments, weights)
    rates = jax.jacfwd(robot.space.place)(pose)
    return (placed.position, placed.rotation), rates, robot.length, list(one_by_one(*legs))
