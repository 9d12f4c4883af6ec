"""Run all rows and write ``results/<name>.json`` and ``.md``: ``python -m benchmarks [--small] [--check]``."""

import argparse
import json
import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # waiting C++ threads must not count as processor time

import jax
import jax.numpy as jnp
import numpy as np

import jaxscissor as js
from benchmarks import library, peers
from benchmarks.figure import throughput
from benchmarks.poses import RATIOS, judge, tse_poses
from benchmarks.report import RESULTS, regressions, table
from benchmarks.timing import interleaved, machine, phases


def rate_row(count, wall, cpu):
    return {"poses": count, "poses_per_s": count / wall, "cpu_ns_per_pose": cpu / count * 1e9}


def quality_row(poses, joints, solved):
    residual, home = judge(RATIOS, poses, np.asarray(joints))
    solved = np.asarray(solved)
    quantiles = np.quantile(residual[solved], [0.5, 0.98, 1.0])
    row = {"success": float(solved.mean()), "wrong_branch": int((solved & ~home).sum())}
    return row | dict(zip(("p50", "p98", "max"), quantiles.tolist(), strict=True))


def contest(count, rounds):
    """Inverse kinematics of the TSE: the library and its peers on the same poses, in turn."""
    poses, robot = tse_poses(count), library.tse()
    on_device = jnp.asarray(poses)
    program, compiled = phases(library.inverse, robot, on_device)
    fraction, compiled_fraction = phases(js.workspace.fraction, robot, on_device)
    plain, simd, optimistix = peers.cpp("plain"), peers.cpp("simd"), peers.optimistix_newton()
    fewer, few = poses[: max(count // 50, 100)], poses[: max(count // 2000, 100)]
    runs = {
        "C++, plain": (poses, lambda: plain(poses)),
        "C++, SIMD": (poses, lambda: simd(poses)),
        "this library, vmap": (poses, lambda: program(robot, on_device)),
        "this library, workspace.fraction": (poses, lambda: fraction(robot, on_device)),
        "NumPy, vectorised": (poses, lambda: peers.numpy_newton(poses)),
        "optimistix, vmap": (fewer, lambda: optimistix(fewer)),
        "SciPy fsolve": (few, lambda: peers.scipy_fsolve(few)),
    }
    times = interleaved({name: run for name, (_, run) in runs.items()}, rounds)
    rows = {}
    for name, (used, run) in runs.items():
        rows[name] = rate_row(len(used), *times[name])
        if name == "this library, workspace.fraction":
            rows[name] |= {"success": float(run())}
        else:
            out = run()
            rows[name] |= quality_row(used, *(out if isinstance(out, tuple) else (out.value, out.converged)))
    rows["this library, vmap"] |= compiled
    rows["this library, workspace.fraction"] |= compiled_fraction
    return rows


def contest_forward(count, rounds):
    """Forward kinematics of the TSE from home: joints of reachable poses, which are to be found again."""
    robot = library.tse()
    poses = jnp.asarray(tse_poses(2 * count))
    found = library.inverse(robot, poses)
    reached = np.flatnonzero(np.asarray(found.converged))[:count]
    poses, joints = np.asarray(poses)[reached], np.asarray(found.value)[reached]
    on_device = jnp.asarray(joints)
    program, compiled = phases(jax.vmap(js.forward_kinematics, (None, 0)), robot, on_device)
    plain = peers.cpp_forward()
    runs = {"C++, plain": lambda: plain(joints), "this library, vmap": lambda: program(robot, on_device)}
    times = interleaved(runs, rounds)
    places, solved = plain(joints)
    pose = jax.vmap(lambda place: js.pose(robot, place[:3], matrix=place[3:].reshape(3, 3)))
    ours = program(robot, on_device)
    answers = {
        "C++, plain": (np.asarray(pose(jnp.asarray(places))), solved),
        "this library, vmap": (np.asarray(ours.value), np.asarray(ours.converged)),
    }
    rows = {}
    for name, (back, solved) in answers.items():
        residual, _ = judge(RATIOS, back[solved], joints[solved])
        other = np.abs(back[solved] - poses[solved]).max(axis=1) > 1e-6
        row = {"success": float(solved.mean()), "wrong_branch": int(other.sum())}
        quantiles = dict(zip(("p50", "p98", "max"), np.quantile(residual, [0.5, 0.98, 1.0]).tolist(), strict=True))
        rows[name] = rate_row(len(joints), *times[name]) | row | quantiles
    rows["this library, vmap"] |= compiled
    return rows


def own_rows(cases, rounds):
    """Rows of the library alone, each beside the plain C++ of the same moment."""
    poses, plain, rows = tse_poses(100_000), peers.cpp("plain"), {}
    for name, (function, args, count) in cases.items():
        program, compiled = phases(function, *args)
        both = interleaved({"own": lambda p=program, a=args: p(*a), "plain": lambda: plain(poses)}, rounds)
        rows[name] = rate_row(count, *both["own"]) | {"plain_cpu_ns": both["plain"][1] / len(poses) * 1e9} | compiled
        print(name, {k: v for k, v in rows[name].items() if k != "poses"}, flush=True)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="a tenth of the poses and batches up to 10^5")
    parser.add_argument("--check", action="store_true", help="compare with the stored results, exit 1 if slower")
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    count = 100_000 if args.small else 1_000_000
    before = machine()
    results = {"contest": contest(count, args.rounds)}
    print(table(results["contest"]), flush=True)
    results["forward"] = contest_forward(count // 10, args.rounds)
    print(table(results["forward"]), flush=True)
    cases = (
        library.robots(count // 10) | library.functions(count // 10) | library.sizes(100_000 if args.small else 10**7)
    )
    results["library"] = own_rows(cases, args.rounds)
    results["machine"] = machine() | {"load_at_start": before["load"]}
    name = "small" if args.small else "full"
    stored = RESULTS / f"{name}.json"
    if args.check:
        slower = regressions(results, json.loads(stored.read_text()))
        raise SystemExit("\n".join(slower) if slower else 0)
    stored.write_text(json.dumps(results, indent=1) + "\n")
    text = [f"`{results['machine']}`", *(table(results[part]) for part in ("contest", "forward", "library"))]
    stored.with_suffix(".md").write_text("\n\n".join(text) + "\n")
    if not args.small:
        throughput(results, RESULTS / "throughput.png")


if __name__ == "__main__":
    main()
