"""Gradient descent through the workspace against differential evolution and CMA-ES, on two design problems.

All three see the same compiled objective and constraints and the same bounds, start at random, and run on the same
cores one after another. The two searches evaluate their populations in one vmapped call, take a violation with a
weight of 10 into their objective, and may take ``--times`` as long as the descent did, its compilation included.

    python -m benchmarks.global_search --problem fuselage --seeds 10
"""

import argparse
import json
import pathlib
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from examples import design_tse_fuselage, design_tse_workspace
from jax.flatten_util import ravel_pytree

import jaxscissor as js

PROBLEMS = {"fuselage": design_tse_fuselage, "workspace": design_tse_workspace}
STEPS = {"fuselage": 200, "workspace": 60}
TIMES = {"fuselage": 20, "workspace": 5}
RESULTS = pathlib.Path(__file__).parent / "results"
ALLOWED, WEIGHT, NEAR = 1e-3, 10.0, 0.01


class Run(NamedTuple):
    """One search: seconds, evaluations and best feasible value so far, after each of its generations."""

    seconds: list
    evaluations: list
    best: list
    compiled: float


class Judge:
    """Objective and largest violation of designs in the unit cube, compiled once; keeps the record of a search."""

    def __init__(self, problem):
        low, high = (ravel_pytree(jax.tree.map(jnp.asarray, bound))[0] for bound in problem["bounds"])
        unravel = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), problem["params"]))[1]
        self.dimension = len(low)
        self.params = lambda unit: unravel(low + (high - low) * jnp.asarray(unit))

        def judge(unit):
            robot = problem["build"](unravel(low + (high - low) * unit))
            slack = jnp.concatenate([jnp.ravel(constraint(robot)) for constraint in problem["constraints"]])
            slack = jnp.where(jnp.isnan(slack), -jnp.inf, slack)
            return problem["objective"](robot), jnp.max(jnp.maximum(-slack, 0))

        self.judge = jax.jit(lambda units: jax.lax.map(judge, units, batch_size=8))

    def begin(self, population):
        """Compile for a population, and start the clock."""
        began = time.perf_counter()
        jax.block_until_ready(self.judge(jnp.full((population, self.dimension), 0.5)))
        self.run = Run([], [], [], time.perf_counter() - began)
        self.began, self.count, self.least = time.perf_counter(), 0, np.inf

    def __call__(self, units):
        """Costs of a population, for a search that knows no constraints."""
        value, violation = map(np.asarray, self.judge(jnp.asarray(units)))
        kept = np.isfinite(value) & (violation <= ALLOWED)
        self.least = min(self.least, value[kept].min(initial=np.inf))
        self.count += len(value)
        self.run.seconds.append(time.perf_counter() - self.began)
        self.run.evaluations.append(self.count)
        self.run.best.append(self.least)
        cost = np.where(violation > ALLOWED, np.nan_to_num(value, nan=0) + WEIGHT * np.minimum(violation, 1e3), value)
        return np.nan_to_num(cost, nan=1e6, posinf=1e6)


def descent(problem, judge, seed, steps):
    """``optimize_design`` from a random design; compilation is part of the clock, and given apart."""
    params = judge.params(np.random.default_rng(seed).random(judge.dimension))
    began = time.perf_counter()
    js.optimize_design(**{**problem, "params": params}, steps=1)
    compiled = time.perf_counter() - began
    began = time.perf_counter()
    result = js.optimize_design(**{**problem, "params": params}, steps=steps)
    total = time.perf_counter() - began
    kept = np.where(result.history.violation <= ALLOWED, result.history.objective, np.inf)[:, 0]
    counts = np.arange(1, steps + 2)
    seconds = compiled + (total - compiled) * counts / counts[-1]
    return Run(seconds.tolist(), counts.tolist(), np.minimum.accumulate(kept).tolist(), compiled)


def differential_evolution(judge, seed, seconds):
    from scipy.optimize import differential_evolution

    population = 15 * judge.dimension
    judge.begin(population)
    differential_evolution(
        lambda x: judge(x.T) if x.ndim == 2 else judge(x[None])[0],
        [(0, 1)] * judge.dimension,
        vectorized=True,
        updating="deferred",
        popsize=15,
        seed=seed,
        tol=0,
        maxiter=10**6,
        polish=False,
        callback=lambda *_, **__: time.perf_counter() - judge.began > seconds,
    )
    return judge.run


def cma_es(judge, seed, seconds):
    """Restarted from random designs, with a population that doubles, whenever it has converged."""
    import cma

    generator, size = np.random.default_rng(seed), 4 * judge.dimension
    judge.begin(size)
    while time.perf_counter() - judge.began < seconds:
        options = {"bounds": [0, 1], "seed": seed + 1 + judge.count, "verbose": -9, "popsize": size}
        search = cma.CMAEvolutionStrategy(generator.random(judge.dimension), 0.3, options)
        while not search.stop() and time.perf_counter() - judge.began < seconds:
            units = search.ask()
            search.tell(units, judge(np.array(units)).tolist())
        size *= 2
    return judge.run


def compare(name, seeds, small, times):
    problem = (
        PROBLEMS[name].problem(*((2, 4),) if name == "fuselage" else (16, 8)) if small else PROBLEMS[name].problem()
    )
    judge, runs = Judge(problem), {"descent": [], "differential evolution": [], "CMA-ES": []}
    for seed in range(seeds):
        mine = descent(problem, judge, seed, 10 if small else STEPS[name])
        runs["descent"].append(mine)
        for rival, search in (("differential evolution", differential_evolution), ("CMA-ES", cma_es)):
            runs[rival].append(search(judge, seed, times * mine.seconds[-1]))
        print(f"{name}, seed {seed}: " + ", ".join(f"{k} {v[-1].best[-1]:.5f}" for k, v in runs.items()), flush=True)
    return runs


def reached(run, value):
    """Seconds until a run had a feasible design within one per cent of a value, without compilation; or infinity."""
    good = np.flatnonzero(np.array(run.best) <= value + NEAR * abs(value))
    return run.seconds[good[0]] if len(good) else np.inf


def table(runs):
    """Markdown: what each found, how often it came within one per cent of the best that any found, and when."""
    best = min(run.best[-1] for group in runs.values() for run in group)
    lines = ["| search | best, median, worst | success | s to success (median) | evaluations | seconds | compilation |"]
    lines.append("|---" * 7 + "|")
    for name, group in runs.items():
        ends = np.array([run.best[-1] for run in group])
        when = np.array([reached(run, best) for run in group])
        hits = np.isfinite(when)
        typical = f"{np.median(when[hits]):.1f}" if hits.any() else ""
        counts, seconds, compiled = (
            np.median([pick(run) for run in group])
            for pick in (lambda r: r.evaluations[-1], lambda r: r.seconds[-1], lambda r: r.compiled)
        )
        lines.append(
            f"| {name} | {ends.min():.5f}, {np.median(ends):.5f}, {ends.max():.5f} | {hits.sum()} of {len(group)} | "
            f"{typical} | {counts:,.0f} | {seconds:.1f} | {compiled:.1f} |"
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problem", choices=PROBLEMS, default="fuselage")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--times", type=float, help="time of the others in units of the descent's")
    parser.add_argument("--small", action="store_true")
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    runs = compare(args.problem, args.seeds, args.small, args.times or TIMES[args.problem])
    text = table(runs)
    print(text)
    if not args.small:
        kept = {name: [run._asdict() for run in group] for name, group in runs.items()}
        (RESULTS / f"search_{args.problem}.json").write_text(json.dumps(kept))
        (RESULTS / f"search_{args.problem}.md").write_text(text + "\n")


if __name__ == "__main__":
    main()
