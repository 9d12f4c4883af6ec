"""The state of unfinished work in a file: written whole or not at all, resumed only by the same job."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.types import PyTree


def save(path: str, job: dict[str, Any], done: int, totals: PyTree) -> None:
    """Replace the file by the totals after ``done`` steps; with many processes, the first one writes.

    Each process writes a file of its own and puts it in place whole: two that share a checkpoint both stay alive, and
    the file is that of the last one.
    """
    if jax.process_index() > 0:
        return
    state: dict[str, Any] = {f"total_{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(totals))}
    state |= {"done": np.int64(done)} | _identity(job)
    folder, name = os.path.split(path)
    number, unfinished = tempfile.mkstemp(".part", f"{name}.", folder or ".")
    try:
        with os.fdopen(number, "wb") as file:
            np.savez(file, **state, seal=_seal(state))
            file.flush()
            os.fsync(file.fileno())
        os.replace(unfinished, path)
    except BaseException:
        os.unlink(unfinished)
        raise


def restore(path: str, job: dict[str, Any], totals: PyTree) -> tuple[int, Any]:
    """Number of steps done and their totals, in JAX or NumPy like those given, which it returns without a file.

    Raises:
      ValueError: the file is no checkpoint, or a damaged one, or one of another job.
    """
    state: Any = (np.int32(0), jax.tree.map(np.asarray, totals))
    if jax.process_index() == 0 and os.path.exists(path):
        state = _read(path, job, totals)
    if jax.process_count() > 1:  # all must go on from the same step, whatever files they see
        from jax.experimental import multihost_utils

        state = multihost_utils.broadcast_one_to_all(state)
    kinds = jax.tree.map(lambda leaf: jnp.asarray if isinstance(leaf, jax.Array) else np.asarray, totals)
    return int(state[0]), jax.tree.map(lambda kind, leaf: kind(leaf), kinds, state[1])


def traced(function: Callable[..., Any], *args: Any, **kwargs: Any) -> tuple[str, str, list[Any]]:
    """What a function computes, to be part of a job: its name, its jaxpr and the arrays that it closes over."""
    jaxpr = jax.make_jaxpr(function)(*args, **kwargs)
    return qualified_name(function), re.sub(r"0x[0-9a-f]+", "", str(jaxpr)), list(jaxpr.consts)


def qualified_name(function: Callable[..., Any]) -> str:
    """Module and name of a function, of what a partial function calls, or of the class of another callable."""
    if isinstance(function, functools.partial):
        return qualified_name(function.func)
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _read(path: str, job: dict[str, Any], totals: PyTree) -> tuple[np.ndarray, Any]:
    try:
        with open(path, "rb") as file:
            saved = dict(np.load(file, allow_pickle=False))
    except Exception as error:  # what a damaged archive raises is not documented: six kinds were seen
        raise ValueError(f"Got {path!r}, which is no checkpoint; name another file or delete it.") from error
    identity = _identity(job)
    other = [name.removeprefix("job_") for name in identity if str(saved.get(name)) != identity[name]]
    if other:
        raise ValueError(
            f"Got {path!r}, the checkpoint of a job with another {', '.join(other)}; name another file or delete it."
        )
    if str(saved.pop("seal", None)) != _seal(saved):
        raise ValueError(f"Got {path!r}, a checkpoint whose content was changed; name another file or delete it.")
    leaves, structure = jax.tree.flatten(totals)
    return saved["done"].astype(np.int32), structure.unflatten([saved[f"total_{i}"] for i in range(len(leaves))])


def _seal(state: dict[str, Any]) -> str:
    """A digest of everything in the file, by which a change of its content is found out."""
    return _digest({name: np.asarray(value) for name, value in state.items()})


def _identity(job: dict[str, Any]) -> dict[str, Any]:
    """A digest of everything that the work depends on, by name; this library's version among it."""
    return {f"job_{name}": _digest(value) for name, value in (job | {"library": version("jaxscissor")}).items()}


def _digest(tree: PyTree) -> str:
    leaves, structure = jax.tree.flatten(tree)
    digest = hashlib.sha256(f"{structure}{sorted(_classes(structure))}".encode())
    for leaf in map(np.asarray, leaves):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode() + leaf.tobytes())
    return digest.hexdigest()


def _classes(structure: Any) -> set[str]:
    """Full names of the classes in a tree, of which its text has only the last part."""
    node = structure.node_data()
    own = {qualified_name(node[0])} if node else set()
    return own.union(*map(_classes, structure.children()))
