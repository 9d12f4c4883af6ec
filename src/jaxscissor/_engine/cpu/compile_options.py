"""Options with which a program compiles sooner.

A function that is called with the numbers of one pose runs for microseconds and compiles for seconds. Measured with
jaxlib 0.10.2, TSE, processor seconds to compile: inverse kinematics 1.65 without and 0.48 with ``UNOPTIMIZED``,
forward kinematics 6.2 and 2.6, and as fast to run. ``QUICK`` takes two thirds of the time and is for programs that
evaluate a robot many times. They can go when XLA's default compiles as fast.
"""

QUICK = {"xla_cpu_use_fusion_emitters": False}
UNOPTIMIZED = QUICK | {"xla_backend_optimization_level": 0}
