"""Clocks: wall and processor time of interleaved runs, and the phases of a compilation."""

import os
import platform
import resource
import statistics
import time

import jax
import jaxlib
import numpy as np


def interleaved(runs, rounds):
    """Time every run once a round, in turn: {name: (median wall, least processor time)} in seconds.

    On a shared machine the load falls on all alike, and the processor time leaves most of it out.
    """
    for run in runs.values():
        jax.block_until_ready(run())
    times = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            wall, cpu = time.perf_counter(), time.process_time()
            jax.block_until_ready(run())
            times[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: (statistics.median(w for w, _ in ts), min(c for _, c in ts)) for name, ts in times.items()}


def phases(function, *args):
    """Compile a function for these arguments: the program, and seconds of each phase, each in wall time."""
    marks = [time.perf_counter()]

    def mark(value):
        marks.append(time.perf_counter())
        return value

    traced = mark(jax.jit(function).trace(*args))
    lowered = mark(traced.lower())
    program = mark(lowered.compile())
    mark(jax.block_until_ready(program(*args)))
    seconds = dict(zip(("trace", "lower", "compile", "first_run"), np.diff(marks).round(4).tolist(), strict=True))
    memory = program.memory_analysis()
    return program, seconds | {"temporary_MiB": round(memory.temp_size_in_bytes / 2**20, 1)}


def machine():
    """Versions, cores, load and peak memory."""
    return {
        "python": platform.python_version(),
        "jax": jax.__version__,
        "jaxlib": jaxlib.__version__,
        "numpy": np.__version__,
        "device": jax.devices()[0].device_kind,
        "cores": len(os.sched_getaffinity(0)),
        "load": [round(x, 1) for x in os.getloadavg()],
        "peak_MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
