"""Options with which a program compiles sooner.

A function that is called with the numbers of one pose runs for microseconds and compiles for seconds. Measured with
jaxlib 0.10.2, TSE, processor seconds to compile: inverse kinematics 1.06 without and 0.28 with ``UNOPTIMIZED``,
forward kinematics 3.6 and 0.96, and as fast to run. ``QUICK`` takes more than half of the time, 0.58 and 2.0, and is
for programs that evaluate a robot many times. They can go when XLA's default compiles as fast.
"""

_SKIPPED = (  # passes that look through large programs and find nothing to gain in one pose: a fifth of the time
    "while-loop-invariant-code-motion",
    "simplify-while-loops",
    "cpu-parallel-task-assigner",
    "small-while-loop-hoisting",
    "reshape-mover",
    "tree_reduction_rewriter",
    "shape-canonicalizer",
    "dynamic-dimension-simplifier",
    "while-loop-trip-count-annotator",
)
QUICK: dict[str, bool | int | str] = {"xla_cpu_use_fusion_emitters": False}
UNOPTIMIZED = QUICK | {
    "xla_backend_optimization_level": 0,
    "xla_cpu_parallel_codegen_split_count": 1,
    "xla_disable_hlo_passes": ",".join(_SKIPPED),
}
