"""What exists only because of how XLA compiles for CPUs.

Every file states what it is for, the gain that was measured and when it can go. ``JAXSCISSOR_PLAIN=1`` in the
environment, before the import, turns all of it off; results then differ by rounding, and where a verdict hangs on the
last bit it may be evaluated twice and differ from itself.
"""

import os

import jax

PLAIN = os.environ.get("JAXSCISSOR_PLAIN", "0") != "0"


def active() -> bool:
    """Whether programs are made for a CPU by default, and not plainly."""
    return not PLAIN and jax.default_backend() == "cpu"
