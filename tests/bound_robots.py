"""Robots whose platform is bound, with known singular places: a five-bar, a translational 3-UPU, an agile eye."""

import math

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js
from tests.toys import AZIMUTHS

OUTWARD = [js.Vec(math.cos(a), math.sin(a), 0.0) for a in AZIMUTHS]
ACROSS = [js.Vec(-math.sin(a), math.cos(a), 0.0) for a in AZIMUTHS]


def stacked(legs):
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf, float) for leaf in leaves]), *legs)


def alone(legs):
    return [jax.tree.map(lambda leaf, i=i: leaf[i], legs) for i in range(len(jax.tree.leaves(legs)[0]))]


@js.pytree
class LengthLeg(js.Leg):
    """A telescopic leg between two universal joints, whose axes bind the platform and not the leg."""

    anchor: js.Vec
    scale: jax.Array
    actuated = (True,)

    def residual(self, joints, point):
        bar = point - self.anchor
        return ((bar.dot(bar) - joints[0] ** 2) / (self.scale**2 + joints[0] ** 2),)

    def start(self, point):
        bar = point - self.anchor
        length = js.safe_sqrt(bar.dot(bar))
        return (length,), length / self.scale


@js.pytree
class ThreeUPU(js.Mechanism):
    """Translational 3-UPU: loose under its constraints where x^2 + y^2 = 4 (base - top)^2, at any height."""

    base: float
    top: float
    space = js.SE3
    dependent = ("roll", "pitch", "yaw")

    @property
    def length(self):
        return self.base

    def legs(self):
        return stacked([LengthLeg(e * self.base, self.base) for e in OUTWARD])

    def attachments(self, position, rotation):
        return [position + rotation @ (e * self.top) for e in OUTWARD]

    def constraints(self, position, rotation):
        ends = zip(OUTWARD, ACROSS, self.attachments(position, rotation), strict=True)
        return [(end - e * self.base).dot(u.cross(rotation @ u)) / self.length for e, u, end in ends]

    def home(self):
        pose = jnp.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0])
        return pose, jnp.stack([jnp.hypot(pose[2], self.base - self.top)] * 3)


@js.pytree
class ArcLeg(js.Leg):
    """Two arcs on a sphere, from a motor's axis to one of the platform's."""

    axis: js.Vec
    across: js.Vec
    third: js.Vec
    second: jax.Array  # of the outer arc; the inner one has 90 deg
    actuated = (True,)
    angular = (True,)

    def residual(self, joints, seen):
        middle = self.across * jnp.cos(joints[0]) + self.third * jnp.sin(joints[0])
        return (middle.dot(seen) - jnp.cos(self.second),)

    def start(self, seen):
        a, b, c = seen.dot(self.across), seen.dot(self.third), jnp.cos(self.second)
        room = a * a + b * b - c * c
        return (jnp.arctan2(b, a) + jnp.arctan2(js.safe_sqrt(room), c),), room


@js.pytree
class AgileEye(js.Mechanism):
    """A platform that turns about a point; with arcs of 1.2 rad a leg is stretched at pitch 1.2."""

    second: float
    space = js.SE3
    dependent = ("x", "y", "z")

    @property
    def length(self):
        return 1.0

    def legs(self):
        axes = np.eye(3)
        return stacked([ArcLeg(*(js.Vec(*axes[(i + k) % 3]) for k in range(3)), self.second) for i in range(3)])

    def attachments(self, position, rotation):
        return [rotation @ js.Vec(*(-np.eye(3)[(i + 2) % 3])) for i in range(3)]

    def constraints(self, position, rotation):
        return position.components

    def home(self):
        pose = jnp.zeros(6)
        seen = self.attachments(*self.space.place(pose))
        return pose, jnp.stack([leg.start(one)[0][0] for leg, one in zip(alone(self.legs()), seen, strict=True)])


@js.pytree
class CrankLeg(js.Leg):
    """A crank and a bar in the plane."""

    anchor: js.Vec
    crank: jax.Array
    bar: jax.Array
    elbow: jax.Array
    actuated = (True,)
    angular = (True,)

    def residual(self, joints, point):
        bar = point - self.anchor - js.Vec(jnp.cos(joints[0]), jnp.sin(joints[0])) * self.crank
        return (bar.dot(bar) / self.bar**2 - 1,)

    def start(self, point):
        arm = point - self.anchor
        c = (arm.dot(arm) + self.crank**2 - self.bar**2) / (2 * self.crank)
        room = arm.dot(arm) - c * c
        angle = jnp.arctan2(arm.y, arm.x) + self.elbow * jnp.arctan2(js.safe_sqrt(room), c)
        return (angle,), room / self.crank**2


@js.pytree
class FiveBar(js.Mechanism):
    """Two cranks move a point in the plane; the platform's angle is bound."""

    half: float
    space = js.SE2
    dependent = ("alpha",)

    @property
    def length(self):
        return jnp.asarray(self.half, float)

    def legs(self):
        return stacked([CrankLeg(js.Vec(s * self.half, 0.0), 2 * self.half, 3 * self.half, -s) for s in (-1.0, 1.0)])

    def attachments(self, position, rotation):
        return [position, position]

    def constraints(self, position, rotation):
        return [rotation.columns[0].y]

    def home(self):
        pose = jnp.stack([0 * self.length, 3.75 * self.length, 0 * self.length])
        point = js.Vec(pose[0], pose[1])
        return pose, jnp.stack([leg.start(point)[0][0] for leg in alone(self.legs())])
