"""The state of an unfinished sum in a file: written whole or not at all, resumed only by the same job."""

from __future__ import annotations

import hashlib
import os
import zipfile
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def save(path: str, job: dict[str, Any], done: int, totals: Any) -> None:
    """Replace the file by the totals after ``done`` chunks; with many processes, the first one writes."""
    if jax.process_index() > 0:
        return
    state: dict[str, Any] = {f"total_{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(totals))}
    unfinished = f"{path}.part"
    with open(unfinished, "wb") as file:
        np.savez(file, **state, **_identity(job), done=done)
        file.flush()
        os.fsync(file.fileno())
    os.replace(unfinished, path)


def restore(path: str, job: dict[str, Any], totals: Any) -> tuple[int, Any]:
    """Number of chunks done and their totals, in JAX or NumPy like those given, which it returns without a file.

    Raises:
      ValueError: the file is no checkpoint, or one of another job.
    """
    state: Any = (np.int32(0), jax.tree.map(np.asarray, totals))
    if jax.process_index() == 0 and os.path.exists(path):
        state = _read(path, job, totals)
    if jax.process_count() > 1:  # all must go on from the same chunk, whatever files they see
        from jax.experimental import multihost_utils

        state = multihost_utils.broadcast_one_to_all(state)
    kinds = jax.tree.map(lambda leaf: jnp.asarray if isinstance(leaf, jax.Array) else np.asarray, totals)
    return int(state[0]), jax.tree.map(lambda kind, leaf: kind(leaf), kinds, state[1])


def _read(path: str, job: dict[str, Any], totals: Any) -> tuple[np.ndarray, Any]:
    try:
        with open(path, "rb") as file:
            saved = dict(np.load(file, allow_pickle=False))
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"Got {path!r}, which is no checkpoint; name another file or delete it.") from error
    identity = _identity(job)
    other = [name.removeprefix("job_") for name in identity if str(saved.get(name)) != identity[name]]
    if other:
        raise ValueError(
            f"Got {path!r}, the checkpoint of a job with another {', '.join(other)}; name another file or delete it."
        )
    leaves, structure = jax.tree.flatten(totals)
    return saved["done"].astype(np.int32), structure.unflatten([saved[f"total_{i}"] for i in range(len(leaves))])


def _identity(job: dict[str, Any]) -> dict[str, Any]:
    """A digest of everything that the sum depends on, by name."""
    return {f"job_{name}": _digest(value) for name, value in job.items()}


def _digest(tree: Any) -> str:
    leaves, structure = jax.tree.flatten(tree)
    digest = hashlib.sha256(str(structure).encode())
    for leaf in map(np.asarray, leaves):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode() + leaf.tobytes())
    return digest.hexdigest()
