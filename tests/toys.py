"""Three robots as a user would write them: passive joints in the plane, lower mobility, pure translation."""

import math

import jax
import jax.numpy as jnp

import jaxscissor as js

AZIMUTHS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


@js.pytree
class RPRLeg(js.Leg):
    """A planar leg: passive turn at the base, actuated length, passive turn at the platform."""

    anchor: js.Vec
    scale: jax.Array
    actuated = (False, True)
    angular = (True, False)

    def residual(self, joints, attachment):
        turn, length = joints
        tip = self.anchor + js.Vec(jnp.cos(turn), jnp.sin(turn)) * length
        return ((tip - attachment) * (1 / self.scale)).components

    def start(self, attachment):
        reach = attachment - self.anchor
        return (jnp.arctan2(reach.y, reach.x), jnp.sqrt(reach.dot(reach))), None

    def margins(self, joints, attachment):
        return ((joints[1] - 0.2 * self.scale) / self.scale, (1.5 * self.scale - joints[1]) / self.scale)

    def bars(self, joints, attachment):
        return [(self.anchor, attachment)]


@js.pytree
class Planar3RPR(js.Mechanism):
    """Planar 3-RPR: (x, y, alpha) by three lengths."""

    base: jax.Array
    platform: jax.Array
    space = js.SE2

    @classmethod
    def example(cls):
        return cls(jnp.array([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]]), jnp.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]]))

    @property
    def length(self):
        return jnp.sqrt(jnp.sum((self.base[1] - self.base[0]) ** 2))

    def legs(self):
        return RPRLeg(js.Vec(self.base[:, 0], self.base[:, 1]), jnp.full(3, 1.0, self.base.dtype) * self.length)

    def attachments(self, position, rotation):
        return [position + rotation @ js.Vec(*self.platform[i]) for i in range(3)]

    def home(self):
        unit = self.length / math.sqrt(1.01)  # that of the example is one
        pose = jnp.stack([0.45 * unit, 0.35 * unit, jnp.full_like(unit, 0.8)])
        position, rotation = self.space.place(pose)
        legs = self.legs()
        joints = []
        for i, attachment in enumerate(self.attachments(position, rotation)):
            joints += jax.tree.map(lambda leaf, i=i: leaf[i], legs).start(attachment)[0]
        return pose, jnp.stack(joints)


@js.pytree
class PRSLeg(js.Leg):
    """A slide along a horizontal ray and a rod of fixed length to a ball joint."""

    slide: js.Vec
    rod: jax.Array
    actuated = (True,)

    def residual(self, joints, attachment):
        bar = attachment - self.slide * joints[0]
        return (bar.dot(bar) / self.rod**2 - 1,)

    def start(self, attachment):
        along = attachment.dot(self.slide)
        across2 = attachment.dot(attachment) - along**2
        return (along + jnp.sqrt(jnp.maximum(self.rod**2 - across2, 1e-4 * self.rod**2)),), None

    def constraints(self, joints, attachment):
        across = js.Vec(-self.slide.y, self.slide.x, 0.0)
        return (attachment.dot(across) / self.rod,)

    def margins(self, joints, attachment):
        return (joints[0] / self.rod, (2 * self.rod - joints[0]) / self.rod)

    def bars(self, joints, attachment):
        return [(self.slide * joints[0], attachment)]

    def rails(self, joints, attachment):
        return [(self.slide * (0.0 * self.rod), self.slide * (2.0 * self.rod))]


@js.pytree
class ThreePRS(js.Mechanism):
    """3-PRS: each ball joint of the platform stays in its leg's vertical plane; three degrees of freedom."""

    rod: jax.Array
    top_radius: jax.Array
    space = js.SE3
    dependent = ("x", "y", "yaw")

    @classmethod
    def example(cls):
        return cls(jnp.asarray(1.0), jnp.asarray(0.3))

    @property
    def length(self):
        return self.rod

    def legs(self):
        angle = jnp.array(AZIMUTHS, self.rod.dtype)
        rays = js.Vec(jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle))
        return PRSLeg(rays, jnp.broadcast_to(self.rod, (3,)))

    def attachments(self, position, rotation):
        corners = [js.Vec(math.cos(a), math.sin(a), 0.0) * self.top_radius for a in AZIMUTHS]
        return [position + rotation @ corner for corner in corners]

    def home(self):
        height = 0.8 * self.rod
        zero = jnp.zeros_like(height)
        slide = self.top_radius + 0.6 * self.rod
        return jnp.stack([zero, zero, height, zero, zero, zero]), jnp.stack([slide] * 3)


@js.pytree
class DeltaLeg(js.Leg):
    """A vertical slide and a parallelogram, which keeps the platform from turning."""

    foot: js.Vec
    rod: jax.Array
    actuated = (True,)

    def residual(self, joints, attachment):
        bar = attachment - self.foot - js.Vec(0.0, 0.0, 1.0) * joints[0]
        return (bar.dot(bar) / self.rod**2 - 1,)

    def start(self, attachment):
        bar = attachment - self.foot
        across2 = bar.x**2 + bar.y**2
        return (bar.z + jnp.sqrt(jnp.maximum(self.rod**2 - across2, 1e-4 * self.rod**2)),), None

    def margins(self, joints, attachment):
        return (joints[0] / self.rod, 2 - joints[0] / self.rod)

    def bars(self, joints, attachment):
        return [(self.foot + js.Vec(0.0, 0.0, 1.0) * joints[0], attachment)]

    def rails(self, joints, attachment):
        return [(self.foot, self.foot + js.Vec(0.0, 0.0, 2.0) * self.rod)]


@js.pytree
class LinearDelta(js.Mechanism):
    """Linear delta: (x, y, z) by three vertical slides; slides of twice a rod's length."""

    radius: jax.Array
    rod: jax.Array
    space = js.R3

    @classmethod
    def example(cls):
        return cls(jnp.asarray(0.5), jnp.asarray(1.0))

    @property
    def length(self):
        return self.rod

    def legs(self):
        angle = jnp.array(AZIMUTHS, self.rod.dtype)
        feet = js.Vec(self.radius * jnp.cos(angle), self.radius * jnp.sin(angle), jnp.zeros_like(angle))
        return DeltaLeg(feet, jnp.broadcast_to(self.rod, (3,)))

    def attachments(self, position, rotation):
        return [position, position, position]

    def home(self):
        slide = jnp.sqrt(self.rod**2 - self.radius**2)
        return jnp.zeros(3, self.rod.dtype), jnp.stack([slide] * 3)
