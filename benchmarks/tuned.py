"""The contest again, with one device per core and XLA's options for long loops: ``python -m benchmarks.tuned``.

Writes ``results/tuned.json`` and ``.md``. A process of its own: XLA reads its options once.
"""

import json
import os

OPTIONS = (
    "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true,xla_cpu_small_while_loop_byte_threshold=10000000"
    " --xla_cpu_prefer_vector_width=512"
)
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {OPTIONS}"
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # waiting C++ threads must not count as processor time

import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

import jaxscissor as js
from benchmarks import library, peers
from benchmarks.__main__ import quality_row, rate_row
from benchmarks.poses import tse_poses
from benchmarks.report import RESULTS, table
from benchmarks.timing import interleaved, machine, phases

COUNT, ROUNDS, CHUNK = 1_000_000, 9, 4096


def contest(mesh):
    """Both C++ programs and the library on the same poses, in turn."""
    lanes, everywhere = PartitionSpec("devices"), PartitionSpec()
    poses, robot = tse_poses(COUNT), library.tse()
    shared = jax.device_put(poses, NamedSharding(mesh, lanes))
    copied = jax.device_put(poses, NamedSharding(mesh, everywhere))
    inverse = jax.shard_map(library.inverse, mesh=mesh, in_specs=(everywhere, lanes), out_specs=lanes)
    program, compiled = phases(inverse, robot, shared)

    def fraction():
        return js.workspace.fraction(robot, copied, execution=js.workspace.Execution(mesh=mesh, chunk_size=CHUNK))

    plain, simd = peers.cpp("plain"), peers.cpp("simd")
    runs = {
        "C++, plain": lambda: plain(poses),
        "C++, SIMD": lambda: simd(poses),
        "this library, vmap": lambda: program(robot, shared),
        "this library, workspace.fraction": fraction,
    }
    rows = {name: rate_row(COUNT, *times) for name, times in interleaved(runs, ROUNDS).items()}
    for name in ("C++, plain", "C++, SIMD"):
        rows[name] |= quality_row(poses, *runs[name]())
    found = program(robot, shared)
    rows["this library, vmap"] |= quality_row(poses, found.value, found.converged) | compiled
    rows["this library, workspace.fraction"] |= {"success": float(fraction())}
    return rows


def main():
    cores = len(os.sched_getaffinity(0))
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_num_cpu_devices", cores)
    before = machine()
    rows = contest(jax.sharding.Mesh(np.array(jax.devices()), ("devices",)))
    results = {"contest": rows, "machine": machine() | {"load_at_start": before["load"], "XLA_FLAGS": OPTIONS}}
    (RESULTS / "tuned.json").write_text(json.dumps(results, indent=1) + "\n")
    text = f"`{results['machine']}`\n\n{table(rows)}\n"
    (RESULTS / "tuned.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
