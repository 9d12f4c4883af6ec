"""What a user waits for at first: ``python -m benchmarks.startup`` writes ``results/startup.json``.

Every row runs in fresh processes: processor seconds of the first call, compilation included, and how many programs it
compiles; milliseconds of a later call, and how many programs that compiles, which must be none; instructions of the
optimized program that ``jax.jit`` makes of it, which do not depend on the machine. With ``--check`` nothing is
written: programs and instructions are compared with the stored ones, and the exit status tells.
"""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial

from benchmarks.report import RESULTS

ROUNDS = 2  # of which the least counts
LATER = 20  # calls whose median counts
SLACK = 1.02  # instructions may grow by this factor: other versions of XLA differ by some
STORED = RESULTS / "startup.json"


def rows():
    """Name -> (function, arguments) of everything that is measured; without arguments it is called as it is."""
    import jax
    import jax.numpy as jnp

    import jaxscissor as js

    tse, navaro = js.TripleScissorExtender.prototype, js.NavaroII.prototype
    robot = tse()
    home, joints = robot.home()
    pose, actuated = jnp.array([0.1, 0.0, 1.0, 0.0, 0.2, 0.0]), robot.actuated(joints) + 0.01
    cylinder = js.Cylinder(robot.length / 2, robot.length)
    poses = jnp.asarray(cylinder.quasi_random(100_000)[:])
    way = jnp.linspace(home, pose, 20)
    bars = js.statics.Section.rectangle(js.statics.Material.aluminum(), depth=0.038, width=0.006)
    carried = {"load": js.statics.Load(payload=11.34, platform_mass=2.0), "section": bars}

    return {
        "TripleScissorExtender.prototype() and home()": (lambda: tse().home(), None),
        "NavaroII.prototype() and home()": (lambda: navaro().home(), None),
        "residual": (_residual, (robot, home, joints)),
        "inverse_kinematics, one pose": (js.inverse_kinematics, (robot, pose)),
        "vmap(inverse_kinematics), 10^5 poses": (jax.vmap(js.inverse_kinematics, (None, 0)), (robot, poses)),
        "feasibility, one pose": (js.feasibility, (robot, pose)),
        "workspace.fraction, 10^5 poses": (js.workspace.fraction, (robot, poses)),
        "forward_kinematics": (js.forward_kinematics, (robot, actuated)),
        "jacfwd of forward_kinematics": (jax.jacfwd(_pose_of, 1), (robot, actuated)),
        "forward_kinematics_all": (js.forward_kinematics_all, (robot, actuated)),
        "closure_jacobians": (_closure_jacobians, (robot, home, joints)),
        "inverse_jacobian": (js.inverse_jacobian, (robot, pose)),
        "gear_ratios": (js.gear_ratios, (robot, pose)),
        "workspace.soft_fraction, value and gradient": (jax.value_and_grad(js.workspace.soft_fraction), (robot, poses)),
        "workspace.ray_fraction, value and gradient": (
            jax.value_and_grad(js.workspace.ray_fraction),
            (robot, cylinder),
        ),
        "singularities.measures": (js.singularities.measures, (robot, pose)),
        "singularities.distance": (js.singularities.distance, (robot, pose)),
        "design.optimize, one step": (lambda: _optimized(robot, poses), None),
        "statics.actuator_forces": (partial(js.statics.actuator_forces, **carried), (robot, pose)),
        "statics.stiffness": (partial(js.statics.stiffness, actuator_stiffness=1e6, **carried), (robot, pose)),
        "statics.sag": (partial(js.statics.sag, actuator_stiffness=1e6, **carried), (robot, pose)),
        "motion.jog, 20 steps": (js.motion.jog, (robot, pose, jnp.full((20, 6), 1e-3))),
        "motion.follow, 20 poses": (js.motion.follow, (robot, way)),
        "motion.track, 20 poses": (js.motion.track, (robot, jnp.linspace(robot.actuated(joints), actuated, 20))),
        "calibration.identify, 20 poses": (lambda: _identified(robot, way), None),
    }


def _residual(robot, pose, joints):
    import jaxscissor as js

    return js.residual(robot, pose, joints=joints)


def _closure_jacobians(robot, pose, joints):
    import jaxscissor as js

    return js.closure_jacobians(robot, pose, joints=joints)


def _identified(robot, way):
    """Zeros of the six slides, from poses that are one millimetre off."""
    import jax

    import jaxscissor as js

    joints = jax.vmap(js.inverse_kinematics, (None, 0))(robot, way).value
    return js.calibration.identify(robot, joints, way + 1e-3, offsets=1e-3, sigma=1e-4)


def _pose_of(robot, joints):
    import jaxscissor as js

    return js.forward_kinematics(robot, joints).value


def _loss(robot, poses):
    import jaxscissor as js

    return -js.workspace.soft_fraction(robot, poses)


def _room(robot):
    import jaxscissor as js

    return js.margins(robot, robot.home()[0])


def _built(ratios):
    import jaxscissor as js

    return js.TripleScissorExtender.from_ratios(*ratios, length=1.727, scissor_angle=(0.19, 1.2))


def _optimized(robot, poses):
    """The four ratios of the TSE, tuned for its workspace while its home pose keeps its margins."""
    import jaxscissor as js

    ratios = robot.ratios
    bounds = ratios - 0.01, ratios + 0.05
    return js.design.optimize(
        _loss, ratios, bounds=bounds, build=_built, constraints=(_room,), steps=1, poses=poses
    ).params


def measured(name):
    """One row in this process; ``jacfwd`` is what a user jits."""
    import jax

    jax.config.update("jax_enable_x64", True)
    programs = []
    listen = jax.monitoring.register_event_duration_secs_listener
    listen(lambda event, _, **labels: programs.append(labels) if "backend_compile" in event else None)
    if "prototype" in name:  # building the robots of the other rows would compile its programs before
        import jaxscissor as js

        robot = js.TripleScissorExtender if "Triple" in name else js.NavaroII
        function, arguments = lambda: robot.prototype().home(), None
    else:
        function, arguments = rows()[name]
        function = jax.jit(function) if name.startswith("jacfwd") else function
    call = function if arguments is None else lambda: function(*arguments)

    programs.clear()
    start = time.process_time()
    jax.block_until_ready(call())
    seconds = time.process_time() - start
    first = len(programs)
    times = []
    for _ in range(LATER):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    found = {"first_cpu_s": round(seconds, 3), "programs": first, "programs_later": len(programs) - first}
    return found | {"later_ms": round(1e3 * statistics.median(times), 3)}


def instructions(function, *arguments):
    """How many the optimized program has."""
    import jax

    text = jax.jit(function).lower(*arguments).compile().as_text()
    return len(re.findall(r"^\s+(?:ROOT )?%?[\w.\-]+ = ", text, re.MULTILINE))


def counted():
    """Instructions of every row that is one function of arrays, in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    return {name: instructions(f, *arguments) for name, (f, arguments) in rows().items() if arguments is not None}


def fresh(code, **environment):
    """What a fresh process prints, as JSON."""
    command = [sys.executable, "-c", code]
    text = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | environment).stdout
    return json.loads(text)


def imports():
    """Least processor seconds of importing JAX, and the package after it, with bytecode kept as an installed one's."""
    clock, stop = "import time; start = time.process_time(); ", "; print(time.process_time() - start)"
    programs = {"import jax": f"{clock}import jax{stop}"}
    programs["import jaxscissor after jax"] = f"import jax; {clock}import jaxscissor{stop}"
    with tempfile.TemporaryDirectory() as bytecode:
        times = [{name: fresh(code, PYTHONPYCACHEPREFIX=bytecode) for name, code in programs.items()} for _ in range(9)]
    return {name: round(min(time[name] for time in times), 3) for name in programs}


def table(results):
    """Markdown."""
    lines = ["| first call | processor s | programs | later, ms | instructions |", "|---|---|---|---|---|"]
    for name, row in results["rows"].items():
        cells = row["first_cpu_s"], row["programs"], row["later_ms"], results["instructions"].get(name, "")
        lines.append(f"| {name} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def regressions(results, stored):
    """One sentence for every row that compiles more than the stored one."""
    found = [
        f"{n}: a later call compiles {r['programs_later']}" for n, r in results["rows"].items() if r["programs_later"]
    ]
    for name, row in stored["rows"].items():
        if results["rows"][name]["programs"] > row["programs"]:
            found.append(f"{name}: {results['rows'][name]['programs']} programs, were {row['programs']}")
    for name, many in stored["instructions"].items():
        if results["instructions"][name] > SLACK * many:
            found.append(f"{name}: {results['instructions'][name]} instructions, were {many}")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the stored results instead of writing them")
    check = parser.parse_args().check
    module = "import json; from benchmarks import startup; print(json.dumps(startup."
    many = fresh(f"{module}counted()))")
    found = {}
    for name in fresh(f"{module}names()))"):
        rounds = [fresh(f"{module}measured({name!r})))") for _ in range(1 if check else ROUNDS)]
        found[name] = min(rounds, key=lambda row: row["first_cpu_s"])
        print(name, found[name], flush=True)
    results = {
        "imports_cpu_s": imports(),
        "rows": found,
        "instructions": many,
        "versions": fresh(f"{module}versions()))"),
    }
    print(table(results))
    if not check:
        STORED.write_text(json.dumps(results, indent=1) + "\n")
        return
    worse = regressions(results, json.loads(STORED.read_text()))
    print("\n".join(worse) or "nothing compiles more than before")
    sys.exit(bool(worse))


def names():
    """Of all rows."""
    return list(rows())


def versions():
    """Of JAX and Python, which the instructions depend on."""
    from benchmarks.timing import machine

    return {name: value for name, value in machine().items() if name in ("python", "jax", "jaxlib", "device", "load")}


if __name__ == "__main__":
    main()
