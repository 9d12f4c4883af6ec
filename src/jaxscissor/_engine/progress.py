"""Progress of long work, shown if tqdm is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

import jax

_PATIENCE = 2.0  # seconds before a bar appears


def progress(numbers: range, what: str, unit: str, note: Callable[[int], str] | None = None) -> Iterator[int]:
    """The numbers one by one, with a bar if there are several; ``note`` says something about each when it is done."""
    if len(numbers) <= 1 or jax.process_index() > 0:
        yield from numbers
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield from numbers
        return
    with tqdm(total=len(numbers), desc=what, unit=unit, mininterval=_seconds_between(), delay=_PATIENCE) as bar:
        for number in numbers:
            yield number
            if note:
                bar.set_postfix_str(note(number), refresh=False)
            bar.update()


def _seconds_between() -> float:
    """Between two states of a bar: on a terminal and in a notebook they replace each other, in a log they add up."""
    if sys.stderr.isatty():
        return 0.1
    return 1.0 if "ipykernel" in sys.modules else 10.0
