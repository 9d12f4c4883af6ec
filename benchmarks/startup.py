"""What a user waits for at first: ``python -m benchmarks.startup`` writes ``results/startup.json``.

Importing the package after JAX against importing JAX, in fresh processes in turn, and compiling the first inverse
kinematics. Least of several rounds, in seconds: wall time and, on a shared machine to be preferred, processor time.
Bytecode is kept from the first round on, as that of an installed package is.
"""

import json
import os
import subprocess
import sys
import tempfile

from benchmarks.report import RESULTS

ROUNDS = 9
CLOCK = "import time; start = time.perf_counter(), time.process_time(); "
STOP = "; print(time.perf_counter() - start[0], time.process_time() - start[1])"
PROGRAMS = {
    "import jax": f"{CLOCK}import jax{STOP}",
    "import jaxscissor after jax": f"import jax; {CLOCK}import jaxscissor{STOP}",
    "first inverse_kinematics": "import jax, jaxscissor as js; jax.config.update('jax_enable_x64', True); "
    "robot = js.TripleScissorExtender.prototype(); pose = robot.home()[0]; "
    f"{CLOCK}js.inverse_kinematics(robot, pose).value.block_until_ready(){STOP}",
}


def seconds(program, bytecode):
    """Wall and processor time that a fresh process prints."""
    environment = os.environ | {"PYTHONPYCACHEPREFIX": bytecode, "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, "-c", program]
    text = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    return [float(word) for word in text.split()]


def main():
    times = {name: [] for name in PROGRAMS}
    with tempfile.TemporaryDirectory() as bytecode:
        for _ in range(ROUNDS):
            for name, program in PROGRAMS.items():
                times[name].append(seconds(program, bytecode))
    rows = {
        name: dict(zip(("wall_s", "cpu_s"), map(min, zip(*ts, strict=True)), strict=True)) for name, ts in times.items()
    }
    jax_alone, package = rows["import jax"], rows["import jaxscissor after jax"]
    ratio = {clock: 1 + package[clock] / jax_alone[clock] for clock in package}
    results = {"rows": rows, "import ratio": ratio, "load": os.getloadavg()}
    print(json.dumps(results, indent=1))
    (RESULTS / "startup.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
