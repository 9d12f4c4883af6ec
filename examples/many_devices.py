"""A workspace, its gradient and a sweep over designs on many devices: virtual ones here, real ones on a cluster.

``python examples/many_devices.py`` runs on 8 virtual devices of this machine, ``--processes 2`` starts two
processes that find each other on the loopback interface and share the devices. On a cluster every host runs
``--cluster``, and JAX takes the address and the number of the process from the scheduler. ``--small`` is for a
quick look. A second run with the same ``--checkpoint`` goes on where the first was stopped.
"""

import argparse
import socket
import subprocess
import sys
import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js


def start(args):
    """Make the devices known, before anything is computed."""
    jax.config.update("jax_enable_x64", True)
    if args.cluster:
        jax.distributed.initialize()
    else:
        jax.config.update("jax_num_cpu_devices", args.devices // args.processes)
        if args.processes > 1:
            jax.config.update("jax_cpu_collectives_implementation", "gloo")
            jax.distributed.initialize(args.address, args.processes, args.process)
    return jax.sharding.Mesh(np.array(jax.devices()), ("devices",))


def show(name, run):
    """Run, and let the first process print the result and its time."""
    before = time.perf_counter()
    value = np.asarray(run())
    if jax.process_index() == 0:
        print(f"{name:30} {time.perf_counter() - before:6.1f} s  {value.tolist()}", flush=True)


def sweep(args):
    """Fraction of the paper's cylinder, its gradient, and the fractions of some designs."""
    mesh = start(args)
    robot = js.TripleScissorExtender.prototype()
    cylinder = js.Cylinder(robot.length / 2, robot.length)
    sample = cylinder.quasi_random(100_000 if args.small else 10_000_000)
    if jax.process_index() == 0:
        print(f"{len(sample):,} poses, {mesh.size} devices, {jax.process_count()} processes", flush=True)
    saved = js.workspace.Execution(mesh=mesh, checkpoint=args.checkpoint)
    show("fraction", lambda: js.workspace.fraction(robot, sample, execution=saved))
    soft = partial(js.workspace.soft_fraction, poses=sample, execution=js.workspace.Execution(mesh=mesh))
    show("fraction per metre of radius", lambda: jax.grad(soft)(robot).actuator_radius)
    k1, k2, k3, k4 = robot.ratios
    designs = jax.vmap(lambda k1: js.TripleScissorExtender.from_ratios(k1, k2, k3, k4))(k1 * jnp.linspace(0.8, 1.2, 4))
    few = js.Cylinder(0.5, 1.0).quasi_random(len(sample) // 10)
    shared = partial(js.workspace.fraction, execution=js.workspace.Execution(mesh=mesh, chunk_size=8192))
    show("fractions of four designs", lambda: jax.vmap(shared, (0, None))(designs, few))


def launch(args):
    """Start this script once per process and wait for all."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, __file__, *sys.argv[1:], "--address", address, "--process"]
    started = [subprocess.Popen([*command, str(process)]) for process in range(args.processes)]
    sys.exit(max(abs(process.wait()) for process in started))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="a hundredth of the poses")
    parser.add_argument("--devices", type=int, default=8, help="virtual devices, of all processes together")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--cluster", action="store_true", help="one process per host, started by a scheduler")
    parser.add_argument("--checkpoint", help="path of the file from which the first sum is resumed")
    parser.add_argument("--address", help=argparse.SUPPRESS)
    parser.add_argument("--process", type=int, help=argparse.SUPPRESS)
    parsed = parser.parse_args()
    if parsed.processes > 1 and parsed.process is None:
        launch(parsed)
    sweep(parsed)
