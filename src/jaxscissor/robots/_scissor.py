"""The scissor (pantograph) as an element: lengths, the width-height relation, joint positions, bars."""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, static


@pytree
class Scissor:
    r"""A scissor of half-bars ``l_0 .. l_n``, standing on a base of width w and rising to a height h.

    With the bars inclined by :math:`\alpha` to the base, :math:`w = 2 l_0 \cos\alpha` and
    :math:`h = L \sin\alpha`, so that :math:`(h/L)^2 + (w/2l_0)^2 = 1` [RAL17 eqs. 4-7, NAV19 eqs. 27-28].
    The crossings lie on the axis; between two of them the half-bars form a rhombus of side ``l_i``.

    Args:
      link_lengths: ``(n+1,)``, half-bars from the base up, any unit of length.
      end: ``"apex"`` if the last rhombus closes in one point, as in the TSE:
        :math:`L = l_0 + 2(l_1 + ... + l_n)`; ``"open"`` if the last crossing's bars end apart, as in
        NaVARo II: :math:`L = l_0 + 2(l_1 + ... + l_{n-1}) + l_n`.

    Raises:
      ValueError: lengths that are not positive, or not an array ``(n+1,)``, or an unknown end.

    Example:
      >>> scissor = Scissor([18.0, 14.0, 11.0])
      >>> float(scissor.length), float(scissor.height(0.0))
      (68.0, 68.0)
    """

    link_lengths: jax.Array
    end: Literal["apex", "open"] = static(default="apex")

    def __post_init__(self):
        if self.end not in ("apex", "open"):
            raise ValueError(f"Got end={self.end!r}; expected 'apex' or 'open'.")
        (lengths,) = as_arrays(self.link_lengths)
        object.__setattr__(self, "link_lengths", lengths)
        least = 1 if self.end == "apex" else 2
        if lengths.ndim != 1 or lengths.shape[0] < least:
            raise ValueError(
                f"Got link_lengths of shape {lengths.shape}; expected one row of at least {least} half-bars."
            )
        if is_concrete(lengths) and not np.all(np.isfinite(lengths) & (np.asarray(lengths) > 0)):
            raise ValueError(f"Got link_lengths {lengths}; every half-bar must be positive and finite.")

    @property
    def base_link(self) -> Scalar:
        """The lowest half-bar l0."""
        return self.link_lengths[..., 0]

    @property
    def length(self) -> Scalar:
        """L, the height of the fully extended scissor [RAL17 eq. 6]."""
        total = 2 * jnp.sum(self.link_lengths, axis=-1) - self.base_link
        return total if self.end == "apex" else total - self.link_lengths[..., -1]

    def height(self, width: Scalar) -> Scalar:
        """Height at a base width; zero where the width exceeds 2 l0 [RAL17 eq. 7]."""
        return self.length * safe_sqrt(1 - (width / (2 * self.base_link)) ** 2)

    def width(self, height: Scalar) -> Scalar:
        """Base width at a height; zero where the height exceeds L [RAL17 eq. 7]."""
        return 2 * self.base_link * safe_sqrt(1 - (height / self.length) ** 2)

    def gain(self, width: Scalar) -> Scalar:
        """Height won per width lost, dh/dw, negative; zero where it does not exist (folded flat)."""
        ratio = self.length / (2 * self.base_link)
        return -ratio * safe_divide(ratio * width, self.height(width))

    def nodes(self, width: Scalar) -> tuple[jax.Array, jax.Array]:
        """Pins in the scissor's plane (across, along the axis), origin in the middle of the base.

        Returns:
          The left chain ``(n+2, 2)`` of bar ends from the base up, and the crossings on the axis. The
          right chain is the mirror image. With an apex both chains end in it.
        """
        cosine = width / (2 * self.base_link)
        sine = safe_sqrt(1 - cosine**2)
        upper = self.link_lengths[1:]
        axis = (self.base_link + jnp.concatenate([0 * self.link_lengths[:1], 2 * jnp.cumsum(upper)])) * sine
        on_axis = jnp.stack([jnp.zeros_like(axis), axis], axis=-1)
        sides = jnp.stack([-upper * cosine, axis[:-1] + upper * sine], axis=-1)
        foot = jnp.stack([-self.base_link * cosine, jnp.zeros_like(sine)])[None]
        top = on_axis[-1:] if self.end == "apex" else on_axis[:0]
        return jnp.concatenate([foot, sides, top]), on_axis[:-1]

    def bars(self, width: Scalar) -> list[tuple[jax.Array, jax.Array]]:
        """The rigid bars as segments in the scissor's plane, each from one chain to the other."""
        left, _ = self.nodes(width)
        mirror = jnp.array([-1, 1], left.dtype)
        pairs = [(left[i], left[i + 1] * mirror) for i in range(left.shape[0] - 1)]
        return [bar for a, b in pairs for bar in ((a, b), (a * mirror, b * mirror))]
