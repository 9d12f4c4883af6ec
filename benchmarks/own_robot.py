"""A robot as a user defines it, with no closed form: the planar 3-RPR."""

import jax
import jax.numpy as jnp

import jaxscissor as js


@js.pytree
class RPRLeg(js.Leg):
    """Turns passively about its anchor, pushes to a length."""

    anchor: js.Vec
    actuated = (False, True)
    angular = (True, False)

    def residual(self, joints, attachment):
        """Tip of the leg against the attachment."""
        angle, length = joints
        tip = self.anchor + js.Vec(jnp.cos(angle), jnp.sin(angle)) * length
        return (tip - attachment).components

    def start(self, attachment):
        """Straight ahead, off by a tenth, so that Newton has to work."""
        reach = attachment - self.anchor
        return (jnp.arctan2(reach.y, reach.x) + 0.1, 1.1 * jnp.sqrt(reach.dot(reach))), None


@js.pytree
class Planar3RPR(js.Mechanism):
    """Base of side one, platform of radius 0.2."""

    base: jax.Array
    corners: jax.Array
    space = js.SE2

    @classmethod
    def prototype(cls):
        """Round numbers."""
        return cls(jnp.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]), jnp.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]))

    @property
    def length(self):
        """Side of the base."""
        return jnp.linalg.norm(self.base[1] - self.base[0])

    def legs(self):
        """Three legs."""
        return RPRLeg(js.Vec(self.base[:, 0], self.base[:, 1]))

    def attachments(self, position, rotation):
        """The platform's corners."""
        return [position + rotation @ js.Vec(*self.corners[i]) for i in range(3)]

    def home(self):
        """In the middle."""
        pose = jnp.array([0.45, 0.35, 0.8], self.base.dtype)
        points = jnp.stack([a.array() for a in self.attachments(*self.space.place(pose))])
        reach = points - self.base
        lengths = jnp.linalg.norm(reach, axis=1)
        return pose, jnp.stack([jnp.arctan2(reach[:, 1], reach[:, 0]), lengths], axis=1).reshape(6)
