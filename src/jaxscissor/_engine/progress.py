"""Progress of long work, shown if tqdm is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import jax


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
    with tqdm(total=len(numbers), desc=what, unit=unit, disable=None) as bar:
        for number in numbers:
            yield number
            if note and not bar.disable:
                bar.set_postfix_str(note(number))
            bar.update()
