"""``design.optimize`` against differential evolution and CMA-ES, on two design problems.

All three see the same objective and constraints and the same bounds, start at random, and run on the same
cores one after another. The two searches evaluate their populations in one vmapped call and add ten times the
largest violation to their objective. A design counts if it violates no constraint by more than 1e-6. Clocks
leave out compilation, which is given apart.

    python -m benchmarks.global_search --problem fuselage --seeds 10
"""

import argparse
import json
import pathlib
import time
import unittest.mock
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from examples import design_tse_fuselage, design_tse_workspace
from jax.flatten_util import ravel_pytree

import jaxscissor as js
from jaxscissor.design import _methods, _optimize

PROBLEMS = {"fuselage": design_tse_fuselage, "workspace": design_tse_workspace}
STEPS = {"fuselage": 40, "workspace": 20}
STARTS = {"fuselage": 3, "workspace": 6}
SIZE = {"fuselage": ((5, 25),), "workspace": (128, 32)}  # grid of the task; rays and cells
SMALL = {"fuselage": ((2, 4),), "workspace": (16, 8)}
SECONDS = {"fuselage": 20, "workspace": 60}  # for each search
RESULTS = pathlib.Path(__file__).parent / "results"
ALLOWED, WEIGHT, NEAR, BLOCK = 1e-6, 10.0, (1e-2, 1e-3, 1e-5), 16


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

        self.block = jax.jit(jax.vmap(judge))

    def judge(self, units):
        """Of any number of designs, in blocks of one size, so that one program serves all populations."""
        blocks = np.resize(units, (-(-len(units) // BLOCK), BLOCK, self.dimension))
        values = [self.block(jnp.asarray(block)) for block in blocks]
        return (np.concatenate(column)[: len(units)] for column in zip(*values, strict=True))

    def begin(self):
        """Compile, if that has not been done, and start the clock."""
        began = time.perf_counter()
        list(self.judge(np.full((BLOCK, self.dimension), 0.5)))
        self.run = Run([], [], [], time.perf_counter() - began)
        self.began, self.count, self.least = time.perf_counter(), 0, np.inf

    def __call__(self, units):
        """Costs of a population, for a search that knows no constraints."""
        value, violation = self.judge(units)
        kept = np.isfinite(value) & (violation <= ALLOWED)
        self.least = min(self.least, value[kept].min(initial=np.inf))
        self.count += len(value)
        self.run.seconds.append(time.perf_counter() - self.began)
        self.run.evaluations.append(self.count)
        self.run.best.append(self.least)
        cost = np.where(violation > ALLOWED, np.nan_to_num(value, nan=0) + WEIGHT * np.minimum(violation, 1e3), value)
        return np.nan_to_num(cost, nan=1e6, posinf=1e6)


def first_robot(problem, judge, seed):
    """The first random design that is a robot."""
    for unit in np.random.default_rng(seed).random((1000, judge.dimension)):
        try:
            problem["build"](judge.params(unit))
            return judge.params(unit)
        except ValueError:
            continue
    raise ValueError("Got bounds within which no random design is a robot.")


def descent(problem, judge, seed, steps, starts):
    """``design.optimize`` from a random design and the best of others.

    Every call makes programs of its own: the time up to the end of the first step counts as compilation, and
    the random designs as what the same number takes in the compiled program of the other searches.
    """
    params = first_robot(problem, judge, seed)
    seconds, stepper, screened = [], _methods.sqp_step, _optimize._screened

    def clocked(function):
        def one(*args):
            result = function(*args)
            seconds.append(time.perf_counter())
            return result

        return one

    def screen(*args):
        began = time.perf_counter()
        drawn = np.random.default_rng(seed).random((64 * starts, judge.dimension))
        list(judge.judge(drawn))
        screening.append(time.perf_counter() - began)
        return screened(*args)

    screening: list[float] = []
    judge.begin()
    began = time.perf_counter()
    with (
        unittest.mock.patch.object(_methods, "sqp_step", lambda evaluate: clocked(stepper(evaluate))),
        unittest.mock.patch.object(_optimize, "_screened", screen),
    ):
        result = js.design.optimize(**{**problem, "params": params}, steps=steps, starts=starts, seed=seed)
    least = np.where(result.history.violation <= ALLOWED, result.history.objective, np.inf).min(axis=1)
    clock = screening[0] + np.array(seconds)[: steps + 1] - seconds[0]
    counts = starts * (64 + np.arange(1, steps + 2))
    return Run(
        clock.tolist(), counts.tolist(), np.minimum.accumulate(least).tolist(), seconds[0] - began - screening[0]
    )


def differential_evolution(judge, seed, seconds):
    from scipy.optimize import differential_evolution

    judge.begin()
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
    judge.begin()
    while time.perf_counter() - judge.began < seconds:
        options = {"bounds": [0, 1], "seed": seed + 1 + judge.count, "verbose": -9, "popsize": size}
        search = cma.CMAEvolutionStrategy(generator.random(judge.dimension), 0.3, options)
        while not search.stop() and time.perf_counter() - judge.began < seconds:
            units = search.ask()
            search.tell(units, judge(np.array(units)).tolist())
        size *= 2
    return judge.run


def compare(name, seeds, small, seconds):
    problem = PROBLEMS[name].problem(*(SMALL if small else SIZE)[name])
    judge, runs = Judge(problem), {"design.optimize": [], "differential evolution": [], "CMA-ES": []}
    for seed in range(seeds):
        runs["design.optimize"].append(descent(problem, judge, seed, 10 if small else STEPS[name], STARTS[name]))
        for rival, search in (("differential evolution", differential_evolution), ("CMA-ES", cma_es)):
            runs[rival].append(search(judge, seed, seconds))
        print(f"{name}, seed {seed}: " + ", ".join(f"{k} {v[-1].best[-1]:.6f}" for k, v in runs.items()), flush=True)
    return runs


def reached(run, value, near):
    """Seconds until a run had a feasible design within a part of a value; or infinity."""
    good = np.flatnonzero(np.array(run.best) <= value + near * abs(value))
    return run.seconds[good[0]] if len(good) else np.inf


def table(runs):
    """Markdown: what each found, how often and when it came near the best that any found."""
    best = min(run.best[-1] for group in runs.values() for run in group)
    names = [f"within {near:g}: runs, median s" for near in NEAR]
    lines = [f"| search | best, median, worst | {' | '.join(names)} | evaluations | seconds | compilation |"]
    lines.append("|---" * (5 + len(NEAR)) + "|")
    for name, group in runs.items():
        ends = np.array([run.best[-1] for run in group])
        found = []
        for near in NEAR:
            when = np.array([reached(run, best, near) for run in group])
            hits = np.isfinite(when)
            found.append(f"{hits.sum()} of {len(group)}" + (f", {np.median(when[hits]):.2f}" if hits.any() else ""))
        counts, seconds, compiled = (
            np.median([pick(run) for run in group])
            for pick in (lambda r: r.evaluations[-1], lambda r: r.seconds[-1], lambda r: r.compiled)
        )
        lines.append(
            f"| {name} | {ends.min():.6f}, {np.median(ends):.6f}, {ends.max():.6f} | {' | '.join(found)} | "
            f"{counts:,.0f} | {seconds:.1f} | {compiled:.1f} |"
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problem", choices=PROBLEMS, default="fuselage")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, help="time of each of the other searches")
    parser.add_argument("--small", action="store_true")
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    runs = compare(args.problem, args.seeds, args.small, args.seconds or SECONDS[args.problem])
    text = table(runs)
    print(text)
    if not args.small:
        kept = {name: [run._asdict() for run in group] for name, group in runs.items()}
        (RESULTS / f"search_{args.problem}.json").write_text(json.dumps(kept))
        (RESULTS / f"search_{args.problem}.md").write_text(text + "\n")


if __name__ == "__main__":
    main()
