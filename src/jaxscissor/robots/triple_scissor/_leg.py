"""A scissor on two slides that meet in a point: the leg of the Triple Scissor Extender."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.newton import implicit, newton
from jaxscissor._engine.numerics import Scalar, default_tol, limit_margins, safe_divide, safe_sqrt, tiny
from jaxscissor._engine.pytree import pytree, unchecked
from jaxscissor._engine.quartic import quartic_roots
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled, scissor_pins
from jaxscissor.robots._circle import Circle
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots._scissor import Scissor


class _Profile(NamedTuple):
    r"""The closure of one leg as a function of one unknown u, all lengths in units of L.

    With p = s_A + s_B and m = s_A - s_B, the first closure equation [RAL17 eq. 10] is the hyperbola
    (p - a) m = b p, solved by p = u + a, m = b + a b / u. Put into the second [RAL17 eq. 13] it leaves
    F(u) = A u^2 + B a u + C + (beta + gamma a / u) a b^2 / u = 0, where A, B, beta and gamma are the
    leg's. Here a = r.(d_A + d_B) and b = r.(d_A - d_B) for the apex at r from the slides' intersection,
    so any slide directions are covered.
    """

    a: Scalar
    b: Scalar
    C: Scalar
    A: Scalar
    B: Scalar
    beta: Scalar
    gamma: Scalar

    def value(self, u: Scalar) -> Scalar:
        """F(u)."""
        return self.derivatives(u)[0]

    def slope(self, u: Scalar) -> Scalar:
        """F'(u)."""
        return self.derivatives(u)[1]

    def derivatives(self, u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """F, F' and F'' at u."""
        a, inverse = self.a, 1 / u
        beta = self.a * self.b * self.b * inverse
        gamma = self.gamma * a * inverse * beta
        beta = self.beta * beta
        return (
            (self.A * u + self.B * a) * u + self.C + beta + gamma,
            2 * self.A * u + self.B * a - (beta + 2 * gamma) * inverse,
            2 * self.A + (2 * beta + 6 * gamma) * inverse * inverse,
        )

    def joints(self, u: Scalar) -> Joints:
        """The (s_A, s_B) of an unknown u > 0, in units of L; at b = 0 they follow the symmetric branch."""
        p = u + self.a
        m = self.b + self.a * jnp.where(jnp.abs(self.b) > tiny(u), self.b / u, 0)
        return (p + m) / 2, (p - m) / 2

    def has_roots(self) -> Scalar:
        """Whether F has real roots, by the discriminant of u^2 F, divided by a^2 b^2, on which no sign depends."""
        A, B, C, g, h = self.A, self.B, self.C, self.gamma, self.beta
        s, t = self.a**2, self.b**2
        AA, BB, CC, gg, hh = A * A, B * B, C * C, g * g, h * h
        discriminant = (
            4 * C * CC * (4 * A * C * g - A * hh * t - BB * g * s)
            + CC * (BB * hh - 128 * AA * gg - 80 * A * B * h * g) * s * t
            + 18 * C * (8 * AA * hh * g * t + 8 * A * BB * gg * s + A * B * h * hh * t + BB * B * h * g * s) * s * t
            + (256 * AA * A * g * gg - 192 * AA * B * h * gg - 6 * A * BB * hh * g - 4 * BB * B * h * hh) * (s * t) ** 2
            - 27 * (AA * hh * hh * t**2 + BB * BB * gg * s**2) * s * t
        )
        inner = 8 * A * C - 3 * BB * s
        outer = (
            64 * AA * A * g * s * t - 16 * AA * CC + 16 * A * BB * C * s - 16 * AA * B * h * s * t - 3 * BB * BB * s**2
        )
        return (discriminant < 0) | ((inner < 0) & (outer < 0))


@pytree
class ScissorLeg(Leg):
    """A scissor whose feet A and B run on two slides from one origin; its apex C carries the platform.

    The closure equations, free of coordinates, with M = (A + B) / 2:
    (C - M).(A - B) = 0 and |C - M|^2 / L^2 + |A - B|^2 / (4 l0^2) = 1 [RAL17 eqs. 10, 13].

    The home mode is the one with both feet outside the apex's foot on their slides: s_A, s_B >= 0,
    p > a and det d residual / d joints < 0. No path without a singularity leads out of it (on u = 0 the
    determinant is positive), and in it the solution is unique, which is what the reach in ``start`` rests on.

    Attributes:
      base_link, length: l0 and L of the scissor.
      shares: ``(n,)`` of the upper half-bars l1..ln in their sum, which only the picture shows.
      origin: where the slides meet, in the base frame.
      slide_a, slide_b: unit directions of the slides, in the base frame.
      stroke: least and greatest slide coordinate.
      lowest, narrowest: L sin of the lower and 2 l0 cos of the upper scissor-angle stop. A stop is judged
        by the height or the width, whichever moves with the angle there.
    """

    base_link: Scalar
    length: Scalar
    shares: jax.Array
    origin: Vec
    slide_a: Vec
    slide_b: Vec
    stroke: tuple[Scalar, Scalar]
    lowest: Scalar
    narrowest: Scalar

    actuated = (True, True)
    limits = (
        "shortest slide A",
        "longest slide A",
        "shortest slide B",
        "longest slide B",
        "scissor folded",
        "scissor extended",
        "apex at the base plane",
    )

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """Symmetry and height of the scissor [RAL17 eqs. 10, 13], divided by L^2."""
        r = attachment - self.origin
        foot_a, foot_b = self.slide_a * joints[0], self.slide_b * joints[1]
        base = foot_a - foot_b
        axis = r - (foot_a + foot_b) * 0.5
        ratio = self.length / (2 * self.base_link)
        scale = 1 / self.length**2
        return axis.dot(base) * scale, (axis.dot(axis) + ratio**2 * base.dot(base)) * scale - 1

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The home solution to a few digits, and -F at the edge of the home mode.

        At the edge the mode folds into another one, or a foot comes to s = 0; where F is positive there,
        the joints are those of the edge.
        """
        profile = fence(_profile(*self._conics(attachment)))  # without: a third more of inverse kinematics
        edge = fence(_edge(profile))  # it decides, and evaluated anew it may be another
        reach = -profile.value(edge)
        fixed = lax.stop_gradient((profile, edge))  # Newton gives the root its derivative
        u = jnp.where(reach >= 0, _outer_root(*fixed), edge)
        return tuple(s * self.length for s in profile.joints(u)), reach

    def assembles(self, attachment: Vec) -> Scalar:
        """Whether the ellipse of eq. 13 and the hyperbola of eq. 10 meet at all."""
        return _profile(*self._conics(attachment)).has_roots()

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """Slides within their stroke, scissor within its stops, apex above the slides; in units of L and 2 l0."""
        foot_a, foot_b = self.slide_a * joints[0], self.slide_b * joints[1]
        base = foot_a - foot_b
        axis = attachment - self.origin - (foot_a + foot_b) * 0.5
        width, height = safe_sqrt(base.dot(base)), safe_sqrt(axis.dot(axis))
        return (
            *limit_margins(joints[0], *self.stroke, self.length),
            *limit_margins(joints[1], *self.stroke, self.length),
            (height - self.lowest) / self.length,
            (width - self.narrowest) / (2 * self.base_link),
            (attachment.z - self.origin.z) / self.length,
        )

    def mode(self, joints: Joints, attachment: Vec) -> Scalar:
        """Home is 0; other labels count what differs: determinant, side of the hyperbola, signs of the slides."""
        r = attachment - self.origin
        outer = joints[0] + joints[1] > r.dot(self.slide_a + self.slide_b)
        proper = Leg.mode(self, joints, attachment) <= 0
        flags = (proper, outer, joints[0] >= 0, joints[1] >= 0)
        return sum(jnp.where(flag, 0, 1 << i) for i, flag in enumerate(flags))

    def closes(self, joints: Joints) -> Scalar:
        """Whether the feet are no farther apart than the scissor spans, 2 l0."""
        base = self.slide_a * joints[0] - self.slide_b * joints[1]
        full = 2 * self.base_link
        return base.dot(base) <= full**2 * (1 + default_tol(jnp.result_type(full)))

    def circle(self, joints: Joints) -> Circle:
        """Where the apex can be with the feet held: about their line, at the scissor's height."""
        foot_a, foot_b = self.slide_a * joints[0], self.slide_b * joints[1]
        base = (foot_a - foot_b) * (1 / self.length)
        width2 = base.dot(base)
        axis = fence(base * safe_divide(1, safe_sqrt(width2)))
        height = self.length * safe_sqrt(1 - width2 * (self.length / (2 * self.base_link)) ** 2)
        vertical = Vec(0.0, 0.0, 1.0) - axis * axis.z
        up = fence(vertical * safe_divide(height, safe_sqrt(vertical.dot(vertical))))
        return Circle(self.origin + (foot_a + foot_b) * 0.5, up, axis.cross(up))

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """All four working modes: where the ellipse of eq. 13 meets the hyperbola of eq. 10."""
        a, b, rho2, p2, m2 = self._conics(attachment)
        center_p, center_m = a / (4 * p2), b / (4 * m2)
        radius2 = 1 - rho2 + p2 * center_p**2 + m2 * center_m**2
        radius = safe_sqrt(radius2)
        axis_p, axis_m = radius / jnp.sqrt(p2), radius / jnp.sqrt(m2)
        e, f = center_p - a, center_m - b
        cosines, sines, valid = _circle_roots(e * f - a * b, f * axis_p, e * axis_m, axis_p * axis_m)
        args = lax.stop_gradient((self, attachment))
        roots, real = [], []
        for cosine, sine, found in zip(cosines, sines, valid, strict=True):
            p, m = center_p + axis_p * cosine, center_m + axis_m * sine
            guess = tuple(s * self.length / 2 for s in (p + m, p - m))
            root, *_ = newton(_residual, guess, args, tol=0.0, max_steps=4)
            ok = found & (radius2 >= 0)
            roots.append(implicit(_residual, lax.stop_gradient(root), ok, (self, attachment)))
            real.append(ok)
        return roots, real

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The scissor's bars as segments in the base frame."""
        foot_a = self.origin + self.slide_a * joints[0]
        foot_b = self.origin + self.slide_b * joints[1]
        middle, base = (foot_a + foot_b) * 0.5, foot_a - foot_b
        width = safe_sqrt(base.dot(base))
        up = attachment - middle
        across = base * -safe_divide(1, width)
        along = up * safe_divide(1, safe_sqrt(up.dot(up)))
        middle, across, along = fence((middle, across, along))  # else every end would evaluate them anew

        def place(point: jax.Array):
            return middle + across * point[0] + along * point[1]

        upper = (self.length - self.base_link) / 2 * self.shares
        scissor = unchecked(Scissor, link_lengths=jnp.concatenate([self.base_link[None], upper]), end="apex")
        return [(place(p), place(q)) for p, q in scissor.bars(width)]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """The feet slide and have ball joints, the scissor's pins are parallel, a ball joint holds the platform."""
        bars = self.bars(joints, attachment)
        (foot_a, _), (foot_b, _) = bars[:2]
        normal = (foot_b - foot_a).cross(attachment - foot_a)
        normal = fence(normal * safe_divide(1, safe_sqrt(normal.dot(normal))))
        last = len(bars) - 2
        # half-bars below and above a crossing divide the bar
        upper = (self.length - self.base_link) / 2 * self.shares
        halves = jnp.concatenate([self.base_link[None], upper])
        crossings = [p + (q - p) * (halves[i] / (halves[i] + halves[i + 1])) for i, (p, q) in enumerate(bars[:last:2])]
        return [
            Connection(BASE, 0, foot_a, (Freedom("slide", self.slide_a, joints=(0,)), Freedom("ball"))),
            Connection(BASE, 1, foot_b, (Freedom("slide", self.slide_b, joints=(1,)), Freedom("ball"))),
            *scissor_pins(bars, crossings, normal),
            balled(last, PLATFORM, attachment),
        ]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """Both slides, as far as the stroke lets the feet go, or if it does not end, the scissor at rest."""
        low, high = self.stroke
        apart = self.slide_a - self.slide_b
        widest = 2 * self.base_link * safe_divide(1, safe_sqrt(apart.dot(apart)))
        ends = [jnp.where(jnp.isfinite(high), high, jnp.maximum(widest, s)) for s in joints]
        rails = zip((self.slide_a, self.slide_b), ends, strict=True)
        return [(self.origin + slide * low, self.origin + slide * end) for slide, end in rails]

    def _conics(self, attachment: Vec):
        """Both closure equations in p and m: (p-a)(m-b) = ab and P2 p^2 + M2 m^2 - (pa + mb)/2 + rho^2 = 1."""
        r = (attachment - self.origin) * (1 / self.length)
        along_a, along_b = r.dot(self.slide_a), r.dot(self.slide_b)
        cos2 = (1 - self.slide_a.dot(self.slide_b)) / 2
        sin2 = 1 - cos2
        ratio = (self.length / (2 * self.base_link)) ** 2
        return (
            along_a + along_b,
            along_a - along_b,
            r.dot(r),
            sin2 / 4 + ratio * cos2,
            cos2 / 4 + ratio * sin2,
        )


def _profile(a: Scalar, b: Scalar, rho2: Scalar, p2: Scalar, m2: Scalar) -> _Profile:
    """The closure as a function of u, of what ``_conics`` gives."""
    constant = rho2 - 1 + (p2 - 0.5) * a**2 + (m2 - 0.5) * b**2
    return _Profile(a, b, constant, p2, 2 * p2 - 0.5, 2 * m2 - 0.5, m2)


def _residual(joints: Joints, args: PyTree) -> Joints:
    leg, attachment = args
    return leg.residual(joints, attachment)


def _edge(profile: _Profile) -> Scalar:
    """The least u of the home mode: where F is least, unless a foot comes to s = 0 before.

    For a > 0, F is convex on u > 0 and the mode ends in the fold F' = 0; for a <= 0, F rises wherever
    both feet are at s >= 0, that is on u >= max(|b|, -a).
    """
    a, b = profile.a, profile.b
    low = jnp.maximum(jnp.maximum(jnp.abs(b), -a), tiny(b))
    folded = (a > 0) & (profile.slope(low) < 0)
    fixed = lax.stop_gradient(profile)
    least = lax.stop_gradient(low)
    guess = jnp.maximum(_fold_guess(fixed), least)
    guess = lax.fori_loop(0, 3, lambda _, u: jnp.maximum(_halley(fixed, u), least), guess)
    (fold,) = implicit(_fold_equation, (guess,), folded, profile)
    return jnp.where(folded, fold, low)


def _fold_equation(u: tuple[Scalar], profile: _Profile) -> tuple[Scalar]:
    return (profile.slope(u[0]),)


def _fold_guess(f: _Profile) -> Scalar:
    """Upper bound of the fold: 2A u^4 + B a u^3 = (beta u + 2 gamma a) a b^2, balanced term against term.

    The cube root of a b^2 is only needed roughly: two rounds of x <- (a b^2 x)^(1/4) from above.
    """
    a, b = jnp.maximum(f.a, 0), jnp.abs(f.b)
    cube = a * b * b
    root = jnp.maximum(a, b)
    for _ in range(2):
        root = jnp.sqrt(jnp.sqrt(cube * root))
    beta = jnp.maximum(f.beta, 0)
    quartic = jnp.cbrt(beta / (2 * f.A)) * root + jnp.sqrt(jnp.sqrt(f.gamma / f.A)) * jnp.sqrt(a * b)
    some = f.B > 0
    slope = jnp.where(some, f.B, 1)
    cubic = jnp.sqrt(beta / slope) * b + jnp.cbrt(2 * f.gamma / slope) * root
    return jnp.where(some, jnp.minimum(quartic, cubic), quartic)


def _halley(f: _Profile, u: Scalar) -> Scalar:
    """One Halley step on u^3 F'(u) = 0."""
    linear, square = f.B * f.a, f.a * f.b * f.b
    beta = f.beta * square
    value = ((2 * f.A * u + linear) * u * u - beta) * u - 2 * f.gamma * f.a * square
    first = (8 * f.A * u + 3 * linear) * u * u - beta
    second = (24 * f.A * u + 6 * linear) * u
    return u - safe_divide(2 * value * first, 2 * first**2 - value * second)


def _outer_root(f: _Profile, edge: Scalar) -> Scalar:
    """The root of F above the edge, from the right by Euler steps, exact for parabolas and at folds."""
    linear, square = f.B * f.a, f.a * f.b * f.b
    beta, gamma = f.beta * square, f.gamma * f.a * square
    bound = f.C + jnp.minimum(f.beta * f.a, 0) * f.b * f.b / edge
    u = (-linear + safe_sqrt(linear**2 - 4 * f.A * bound)) / (2 * f.A)

    def step(_: object, u: Scalar):
        top = f.A * u * u  # value, slope and curvature times u^2, u^3 and u^4: one division a step
        value = (top + linear * u + f.C) * u * u + beta * u + gamma
        slope = (2 * top + linear * u) * u * u - beta * u - 2 * gamma
        curvature = 2 * top * u * u + 2 * beta * u + 6 * gamma
        root = safe_sqrt(slope**2 - 2 * value * curvature)
        return jnp.maximum(u - safe_divide(2 * value * u, slope + root), edge)

    return lax.fori_loop(0, 5, step, jnp.maximum(u, edge))


def _circle_roots(k0: Scalar, k1: Scalar, k2: Scalar, k3: Scalar):
    """Real roots of k0 + k1 cos x + k2 sin x + k3 sin x cos x = 0 as (cosines, sines, valid), four of each.

    The half-angle tangent of x - x0 turns it into a quartic; x0, one of four diagonals, is chosen so that
    its opposite, where the tangent is infinite, is as far from a root as can be.
    """
    half = jnp.sqrt(jnp.asarray(0.5, jnp.result_type(k0)))
    diagonals = [(half, half), (-half, half), (-half, -half), (half, -half)]
    opposite = [k0 - k1 * c - k2 * s + k3 * c * s for c, s in diagonals]
    best = opposite[0]
    c0, s0 = diagonals[0]
    for (c, s), value in zip(diagonals[1:], opposite[1:], strict=True):
        larger = jnp.abs(value) > jnp.abs(best)
        best, c0, s0 = (jnp.where(larger, n, o) for n, o in ((value, best), (c, c0), (s, s0)))
    q1, q2, q3 = k1 * c0 + k2 * s0, k2 * c0 - k1 * s0, k3 * c0 * s0
    lead = jnp.where(best == 0, 1, best)
    odd = 2 * q2 / lead
    roots, real = quartic_roots(odd, 2 * (k0 - 3 * q3) / lead, odd, (k0 + q1 + q3) / lead)
    cosines, sines = [], []
    for t in roots:
        scale = 1 / (1 + t * t)
        c, s = (1 - t * t) * scale, 2 * t * scale
        cosines.append(c0 * c - s0 * s)
        sines.append(s0 * c + c0 * s)
    return cosines, sines, [r & (best != 0) for r in real]
