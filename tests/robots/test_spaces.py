"""Pose spaces: what every one of them must keep, whatever its coordinates are."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js

SPACES = {
    "SE3": js.SE3,
    "SE2": js.SE2,
    "R3": js.R3,
    "R2": js.robots.R2,
    "R1": js.robots.R1,
    "SO3": js.robots.SO3,
    "Schoenflies": js.robots.Schoenflies,
    "roll": js.robots.Subspace(js.SE3, ("z", "roll")),
    "pitch": js.robots.Subspace(js.SE3, ("x", "pitch")),
    "turn": js.robots.Subspace(js.SE2, ("alpha",)),
}


def flat(place):
    """Position and rotation as one array."""
    position, rotation = place
    matrix = jnp.broadcast_to(rotation.array(), (len(position.components),) * 2)
    return jnp.concatenate([position.array(), jnp.ravel(matrix)])


@partial(jax.jit, static_argnums=0)
@partial(jax.vmap, in_axes=(None, 0, 0))
def told(space, pose, twist):
    """The pose from its place; a twist from its step, and that step once more; derivatives by pose and by twist."""
    start, still = space.place(pose), jnp.zeros_like(twist)
    end = space.retract(*start, tuple(twist))
    back = space.between(start, end)
    again = space.retract(*start, tuple(back))
    steps = [
        jax.jacfwd(lambda t, step=step: flat(step(*start, tuple(t))))(still) for step in (space.retract, space.nudge)
    ]
    by_pose = jax.jacfwd(lambda pose: flat(space.place(pose)))(pose)
    moved = [step @ space.rates_to_twist(pose) for step in steps]
    return jnp.stack(space.coordinates(*start)), back, flat(again) - flat(end), by_pose, *moved


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_coordinates_steps_and_rates_agree(space, rng):
    """place and coordinates undo each other, and retract and between; d place / d pose is the step by the rates."""
    alone = space.dimension - space.translations == 1  # such an angle goes all the way around
    poses = rng.uniform(-3.1 if alone else -1.5, 3.1 if alone else 1.5, (50, space.dimension))
    twists = rng.uniform(-1.7, 1.7, (50, space.dimension))
    coordinates, back, again, by_pose, stepped, nudged = told(space, poses, twists)
    assert np.allclose(coordinates, poses, atol=1e-12)
    assert np.allclose(back, twists, atol=1e-9)
    assert np.allclose(again, 0, atol=1e-9)
    assert np.allclose(stepped, by_pose, atol=1e-12) and np.allclose(nudged, by_pose, atol=1e-12)


@pytest.mark.parametrize(
    ("space", "free", "said"),
    [
        (js.SE3, ("x", "alpha"), "some of"),
        (js.SE3, (), "some of"),
        (js.SE2, "xy", "some of"),
        (js.SE3, ("roll", "pitch"), "no group"),
    ],
)
def test_what_is_no_space_is_refused(space, free, said):
    with pytest.raises(ValueError, match=said):
        js.robots.Subspace(space, free)
