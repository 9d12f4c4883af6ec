"""Long jobs: 10^8 poses in constant memory, and two devices pinned to one core each: ``python -m benchmarks.scale``.

Writes ``results/scale.json``. Every job is a process of its own, so that its peak memory is its own.
"""

import argparse
import functools
import json
import os
import resource
import socket
import statistics
import subprocess
import sys
import time

import jax
import numpy as np

import jaxscissor as js
from benchmarks.report import RESULTS

FUNCTIONS = {"value": js.workspace.fraction, "value and gradient": jax.value_and_grad(js.workspace.soft_fraction)}
ROUNDS = 5


def job(function, count, address, processes, process):
    """Time a function over poses of the paper's cylinder, on the devices of all processes."""
    jax.config.update("jax_enable_x64", True)
    if processes > 1:
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        jax.distributed.initialize(address, processes, process)
    robot = js.TripleScissorExtender.prototype()
    cylinder = js.Cylinder(robot.length / 2, robot.length)
    mesh = jax.sharding.Mesh(np.array(jax.devices()), ("devices",))
    run = functools.partial(FUNCTIONS[function], execution=js.workspace.Execution(mesh=mesh))
    jax.block_until_ready(run(robot, cylinder.quasi_random(100_000)))
    before, used = time.perf_counter(), time.process_time()
    fraction = jax.tree.leaves(run(robot, cylinder.quasi_random(count)))[0]
    row = {"poses": count, "wall_s": time.perf_counter() - before, "cpu_s": time.process_time() - used}
    print(json.dumps(row | {"fraction": float(fraction), "peak_MiB": peak(), "load": os.getloadavg()}))


def peak():
    """Largest resident memory of this process so far, in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def processes(function, count, cores):
    """Run a job with one process, and one device, for each set of cores; the result of the first one."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, "-m", "benchmarks.scale", "--job", function, "--poses", str(count), "--address", address]
    started = [
        subprocess.Popen(
            [*command, "--processes", str(len(cores)), "--process", str(process)],
            stdout=subprocess.PIPE,
            preexec_fn=functools.partial(os.sched_setaffinity, 0, some),
        )
        for process, some in enumerate(cores)
    ]
    texts = [process.communicate()[0] for process in started]
    if any(process.returncode for process in started):
        raise RuntimeError(f"A job of {function} failed; its message stands above.")
    return json.loads(texts[0].splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=10**8)
    for hidden in ("--job", "--address"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    for hidden in ("--processes", "--process"):
        parser.add_argument(hidden, type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.job:
        job(args.job, args.poses, args.address, args.processes, args.process)
        return
    cores = sorted(os.sched_getaffinity(0))
    results = {"long": {name: processes(name, args.poses, [cores]) for name in FUNCTIONS}}
    print(results, flush=True)
    pinned = [{core} for core in cores[:2]]
    pairs = [[processes("value", args.poses // 10, some) for some in (pinned[:1], pinned)] for _ in range(ROUNDS)]
    speedups = sorted(one["wall_s"] / two["wall_s"] for one, two in pairs)
    results["two devices"] = {"speedups": speedups, "median": statistics.median(speedups), "rounds": pairs}
    print(speedups)
    (RESULTS / "scale.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
