"""A public function as one program, its checks and conversions included."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import take_current_trace

from jaxscissor._engine.cpu import active
from jaxscissor._engine.cpu.compile_options import QUICK, UNOPTIMIZED
from jaxscissor._engine.pytree import refuse_unregistered
from jaxscissor._engine.types import PyTree

P = ParamSpec("P")
T = TypeVar("T")

_KEPT = 16  # programs of a user's functions


def one_pose(*static: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Make a function of one pose one program; ``static`` names its arguments that are no arrays.

    Called with numbers, it is compiled without most of the optimizations: in a third of the time, and for one pose
    it runs as fast. Under ``jit``, ``vmap`` or a derivative it becomes a part of the caller's program, which is
    optimized as a whole. Lists and tuples of numbers become arrays.
    """
    return lambda function: _program(function, static, UNOPTIMIZED)


def program(*static: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """The same for a function that evaluates the robot many times: optimized also when called with numbers."""
    return lambda function: _program(function, static, QUICK)


def run_once(function: Callable[P, T], **options: Any) -> Callable[P, T]:
    """The function as a program that is not worth optimizing; for ``options`` see ``jax.jit``."""
    plain, quick = jax.jit(function, **options), jax.jit(function, compiler_options=UNOPTIMIZED, **options)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        return (quick if active() else plain)(*args, **kwargs)

    return call


def keyed(body: Callable[..., T]) -> Callable[..., T]:
    """Make ``body(function, *arrays, **static)`` one program for every function, of which the last few are kept."""

    @functools.lru_cache(maxsize=_KEPT)
    def program_of(function: Callable[..., Any], **settings: Any) -> Any:
        return jax.jit(functools.partial(body, function, **settings))

    @functools.wraps(body)
    def call(function: Callable[..., Any], *arrays: Any, **settings: Any) -> T:
        if _holds_tracers(function):  # made for this call alone
            return body(function, *arrays, **settings)
        return program_of(function, **settings)(*arrays)

    return call


def _holds_tracers(function: Callable[..., Any]) -> bool:
    cells = [cell.cell_contents for cell in getattr(function, "__closure__", None) or ()]
    leaves = jax.tree.leaves(cells)
    return any(isinstance(leaf, Tracer) or (callable(leaf) and _holds_tracers(leaf)) for leaf in leaves)


def _program(function: Callable[P, T], static: tuple[str, ...], options: PyTree) -> Callable[P, T]:
    part = jax.jit(function, static_argnames=static)
    whole = jax.jit(function, static_argnames=static, compiler_options=options)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        numbers = tuple(_listed(arg) for arg in args)
        named = {name: _listed(arg) for name, arg in kwargs.items()}
        leaves = jax.tree.leaves((numbers, named))
        for leaf in leaves:
            refuse_unregistered(leaf)
        if any(isinstance(leaf, Tracer) for leaf in leaves) or not active():
            return part(*numbers, **named)
        with take_current_trace():  # inside a caller's program, too, numbers give numbers
            return whole(*numbers, **named)

    return call


def _listed(value: Any) -> Any:
    """Lists and tuples of numbers as arrays."""
    if type(value) not in (list, tuple):
        return value
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value))
    return jnp.asarray(value) if traced else np.asarray(value)
