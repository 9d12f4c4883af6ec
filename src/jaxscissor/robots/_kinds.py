"""Legs of different kinds in one robot: stacked, so that the library maps over them as over legs of one kind."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._contract import Attachment, Joints, Leg, LegKind
from jaxscissor.robots._method_checks import actuated_flags

Method = Callable[[Leg, Attachment], Any]


@pytree
class LegOfAnyKind(Leg):
    """A leg that is one of several kinds.

    It carries a leg of every kind, of which one is its own and the others idle. What it sees is the point that it
    holds, and then what each kind sees. A leg of fewer joints than others has further ones that stay zero, which the
    array of all joints leaves out. It does not say how its bars hang together.

    Attributes:
      own: number of its kind, as a float, so that robots of such legs can be differentiated.
      kinds: a leg of every kind.
      each: what is fixed about each of the stacked legs.
      numbers: of the kinds of the stacked legs.
      place: number of the kind of a leg taken out of them.
    """

    own: Scalar
    kinds: tuple[Any, ...]
    each: tuple[LegKind, ...] = static()  # pyright: ignore[reportIncompatibleVariableOverride]
    numbers: tuple[int, ...] = static()
    place: int | None = static(default=None)

    def alone(self, number: int) -> Leg:
        """The leg, which knows its kind."""
        return dataclasses.replace(self, place=self.numbers[number])

    @property
    def actuated(self) -> tuple[bool, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """An entry for each joint; which are actuated says ``each``."""
        return (False,) * max(len(kind.actuated) for kind in self.each)

    @property
    def limits(self) -> tuple[str, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Those of all kinds, one after the other."""
        if any(kind.limits is None for kind in self.kinds):
            return None
        return tuple(f"{type(kind).__name__}: {name}" for kind in self.kinds for name in kind.limits)

    def residual(self, joints: Joints, attachment: Attachment) -> Joints:
        """Its kind's, and the further joints."""

        def equations(kind: Leg, seen: Attachment) -> list[Scalar]:
            own = _own(joints, kind)
            return [*kind.residual(own, seen), *joints[len(own) :]]

        return tuple(self._chosen(equations, attachment))

    def start(self, attachment: Attachment) -> tuple[Joints, Scalar | None]:
        """Its kind's. The reach is known if every kind knows its own."""
        known = all(self._asked(lambda kind, seen: kind.start(seen)[1] is not None, attachment))

        def start(kind: Leg, seen: Attachment) -> list[Scalar]:
            joints, reach = kind.start(seen)
            return [reach if known else self.own, *self._filled(joints)]

        reach, *joints = self._chosen(start, attachment)
        return tuple(joints), reach if known else None

    def margins(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """Those of all kinds one after the other, infinite where they are of another kind."""
        counts = self._asked(lambda kind, seen: len(kind.margins(_own(joints, kind), seen)), attachment)
        before = [sum(counts[:place]) for place in range(len(counts))]
        after = [sum(counts[place + 1 :]) for place in range(len(counts))]

        def margins(place: int, kind: Leg, seen: Attachment) -> list[Scalar]:
            own = kind.margins(_own(joints, kind), seen)
            return [jnp.inf] * before[place] + list(own) + [jnp.inf] * after[place]

        return self._switched([partial(margins, place) for place in range(len(counts))], attachment, self.own.dtype)

    def constraints(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """Its kind's, filled up with zeros, which are nobody's."""
        return self._filled_up(lambda kind, seen: kind.constraints(_own(joints, kind), seen), 0.0, attachment)

    def bars(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """Its kind's, filled up with points."""
        point = attachment[0]
        return self._filled_up(lambda kind, seen: kind.bars(_own(joints, kind), seen), (point, point), attachment)

    def rails(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """Its kind's, filled up with the point that it holds."""
        point = attachment[0]
        return self._filled_up(lambda kind, seen: kind.rails(_own(joints, kind), seen), (point, point), attachment)

    def mode(self, joints: Joints, attachment: Attachment) -> Scalar:
        """Its kind's."""
        (label,) = self._chosen(lambda kind, seen: [kind.mode(_own(joints, kind), seen)], attachment, jnp.int32)
        return label

    def solutions(self, attachment: Attachment) -> tuple[Sequence[Joints], Sequence[Scalar]] | None:
        """Its kind's, filled up; unknown if any kind does not know its own."""
        counts = self._asked(lambda kind, seen: _count(kind.solutions(seen)), attachment)
        if None in counts:
            return None
        most, none = max(counts), self._filled(())

        def roots(kind: Leg, seen: Attachment) -> list[Joints]:
            found = [self._filled(root) for root in (kind.solutions(seen) or ((), ()))[0]]
            return found + [none] * (most - len(found))

        def real(kind: Leg, seen: Attachment) -> list[Scalar]:
            found = list((kind.solutions(seen) or ((), ()))[1])
            return found + [False] * (most - len(found))

        return self._chosen(roots, attachment), self._chosen(real, attachment, jnp.bool_)

    def assembles(self, attachment: Attachment) -> Scalar | None:
        """Its kind's; unknown if any kind does not know it."""
        if not all(self._asked(lambda kind, seen: kind.assembles(seen) is not None, attachment)):
            return None
        (found,) = self._chosen(lambda kind, seen: [kind.assembles(seen)], attachment, jnp.bool_)
        return found

    def closes(self, joints: Joints) -> Scalar:
        """Its kind's."""
        unseen = (None,) * (1 + len(self.kinds))
        return self._chosen(lambda kind, _: kind.closes(_own(joints, kind)), unseen, jnp.bool_)

    def _asked(self, method: Method, attachment: Attachment) -> list[Any]:
        """What every kind answers that is no number."""
        answers = []
        for kind, seen in zip(self.kinds, attachment[1:], strict=True):
            jax.eval_shape(lambda kind, seen: answers.append(method(kind, seen)), kind, seen)
        return answers

    def _chosen(self, method: Method, attachment: Attachment, dtype: Any = None) -> Any:
        """What the leg's own kind answers, numbers in one dtype."""
        return self._switched([method] * len(self.kinds), attachment, self.own.dtype if dtype is None else dtype)

    def _switched(self, methods: Sequence[Method], attachment: Attachment, dtype: Any) -> Any:
        """What that of the methods answers that belongs to the leg's own kind."""

        def answer(method: Method, kind: Leg, seen: Attachment) -> Any:
            return jax.tree.map(lambda number: jnp.asarray(number, dtype), method(kind, seen))

        cases = [partial(answer, *case) for case in zip(methods, self.kinds, attachment[1:], strict=True)]
        if self.place is not None:
            return cases[self.place]()
        return lax.switch(self.own.astype(jnp.int32), cases)

    def _filled_up(self, method: Method, filler: Any, attachment: Attachment) -> Any:
        """A list that the leg's own kind gives, filled up to the longest with something."""
        most = max(self._asked(lambda kind, seen: len(method(kind, seen)), attachment))

        def filled(kind: Leg, seen: Attachment) -> list[Any]:
            own = list(method(kind, seen))
            return own + [filler] * (most - len(own))

        return self._chosen(filled, attachment)

    def _filled(self, joints: Joints) -> Joints:
        """Joints of a kind, and zeros."""
        return (*joints, *[jnp.zeros_like(self.own)] * (len(self.actuated) - len(joints)))


def _own(joints: Joints, kind: Leg) -> Joints:
    """Those of all joints that a kind has."""
    return joints[: len(actuated_flags(kind))]


def _count(solutions: Any) -> int | None:
    return None if solutions is None else len(solutions[1])


def stacked_legs(legs: Sequence[Leg], seen: Sequence[Attachment]) -> Leg:
    """Legs on a leading axis, of any kinds.

    Args:
      legs: one by one.
      seen: what each of them sees.
    """
    kinds = kinds_of(legs)
    if max(kinds) == 0:
        return _stacked(legs)
    first = [kinds.index(kind) for kind in range(max(kinds) + 1)]
    sides = [
        _stacked([leg if own == kind else legs[place] for leg, own in zip(legs, kinds, strict=True)])
        for kind, place in enumerate(first)
    ]
    each = tuple(_described(leg, one) for leg, one in zip(legs, seen, strict=True))
    own = jnp.asarray(kinds, jnp.result_type(jax.tree.leaves(legs[0])[0]))
    return LegOfAnyKind(own, tuple(sides), each, tuple(kinds))


def seen_by_kinds(kinds: Sequence[int], seen: Sequence[Attachment]) -> list[Attachment]:
    """What legs of such kinds see, from what each sees itself, so that it can be stacked."""
    if max(kinds) == 0:
        return list(seen)
    first = [kinds.index(kind) for kind in range(max(kinds) + 1)]
    return [
        (_point(one), *(one if kind == own else seen[first[kind]] for kind in range(len(first))))
        for one, own in zip(seen, kinds, strict=True)
    ]


def kinds_of(legs: Sequence[Any]) -> list[int]:
    """Number of the kind of each leg: those of one kind differ in nothing but their numbers."""
    shapes = [(jax.tree.structure(leg), tuple(map(jnp.shape, jax.tree.leaves(leg)))) for leg in legs]
    order = list(dict.fromkeys(shapes))
    return [order.index(shape) for shape in shapes]


def _stacked(legs: Sequence[Leg]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *legs)


def _described(leg: Leg, seen: Attachment) -> LegKind:
    flags = actuated_flags(leg)
    zero = tuple(jnp.zeros(()) for _ in flags)
    bound = len(jax.eval_shape(leg.constraints, zero, seen))
    return LegKind(flags, leg.angular or (False,) * len(flags), bound)


def _point(seen: Attachment) -> Vec:
    """The first point that a leg sees."""
    return jax.tree.leaves(seen, is_leaf=lambda part: isinstance(part, Vec))[0]
