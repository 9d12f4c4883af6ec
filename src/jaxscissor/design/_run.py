"""The steps of an optimization: shown, saved, resumed and interrupted."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxscissor._engine.checkpoint import restore, save
from jaxscissor._engine.progress import progress
from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import FEASIBLE, PERIOD


class Run(NamedTuple):
    """The state after the last step, and what all steps found: objectives, violations, multipliers."""

    state: Any
    log: tuple[np.ndarray, ...]
    settled: bool  # whether it ended because the objective no longer fell
    interrupted: bool  # whether the user ended it
    seconds: Seconds


def run(
    step: Callable[..., Any],
    state: PyTree,
    steps: int,
    tolerance: float | None,
    checkpoint: str | os.PathLike[str] | None,
    job: dict[str, Any],
    unit: float,
    clock: Clock,
) -> Run:
    """All steps, or those that a checkpoint lacks, until the objective settles or the user interrupts.

    An interrupted run has its last whole step in the checkpoint, and goes on from there.

    Raises:
      KeyboardInterrupt: before the first step was done.
    """
    log, done, path = _log(0, state), 0, None if checkpoint is None else os.fspath(checkpoint)
    if path is not None:
        done, (state, log) = restore(path, job, (state, log))
    log = tuple(np.concatenate(rows) for rows in zip(log, _log(max(steps + 1 - done, 0), state), strict=True))
    settled, interrupted, saved = False, False, done
    try:
        for number in progress(range(done, steps + 1), "design", "step", lambda i: _note(log, i, unit)):
            if tolerance is not None and (settled := _settled(log, number, max(steps // 5, PERIOD), tolerance)):
                break
            log[2][number] = state.multipliers
            after, info = step(state, number, number % PERIOD == PERIOD - 1)
            log[0][number], log[1][number] = info.objective, info.violation
            state, done = after, number + 1  # last, so that an interrupted step is none
            clock.stop()
            if path is not None and (done % PERIOD == 0 or done > steps):
                save(path, job, done, (state, _first(log, done)))
                saved = done
    except KeyboardInterrupt:
        if done == 0:
            raise
        interrupted = True
    if path is not None and saved < done:
        save(path, job, done, (state, _first(log, done)))
    return Run(state, _first(log, done), settled, interrupted, clock.seconds)


@dataclasses.dataclass(frozen=True, eq=False)
class Seconds:
    """Time of an optimization; equal to any other, so that two results are of one structure.

    Attributes:
      first: until the first step was done, compilation included.
      others: of the other steps.
    """

    first: float
    others: float

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Seconds)

    def __hash__(self) -> int:
        return hash(Seconds)


class Clock:
    """Seconds until the end of the first step and of the other steps."""

    def __init__(self) -> None:
        self._start, self._ends = time.perf_counter(), []

    def stop(self) -> None:
        """A step has ended."""
        self._ends = [*self._ends[:1], time.perf_counter()]

    @property
    def seconds(self) -> Seconds:
        """So far."""
        ends = self._ends or [self._start]
        return Seconds(ends[0] - self._start, ends[-1] - ends[0])


def _note(log: tuple[np.ndarray, ...], number: int, unit: float) -> str:
    """The best objective so far of what keeps the constraints, or if nothing does the least violation."""
    objective, violation = (column[: number + 1] for column in log[:2])
    kept = (violation <= FEASIBLE) & np.isfinite(objective)
    if kept.any():
        return f"best {unit * objective[kept].min():.5g}"
    return f"violated by {np.fmin.reduce(violation, axis=None):.2g}"


def _first(log: tuple[np.ndarray, ...], rows: int) -> tuple[np.ndarray, ...]:
    return tuple(column[:rows] for column in log)


def _log(rows: int, state: PyTree) -> tuple[np.ndarray, ...]:
    columns = state.best.objective, state.best.violation, state.multipliers
    return tuple(np.full((rows, *column.shape), np.nan, column.dtype) for column in columns)


def _settled(log: tuple[np.ndarray, ...], number: int, window: int, tolerance: float) -> bool:
    """Whether every start has a design that keeps the constraints, and none a better one since the window began."""
    if number <= window:
        return False
    allowed = np.where(log[1][:number] <= FEASIBLE, log[0][:number], np.inf)
    before = np.min(allowed[:-window], axis=0)
    return bool(np.all(before < np.inf) and np.all(np.min(allowed, axis=0) >= before - tolerance))
