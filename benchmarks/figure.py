"""Throughput over the size of the batch, from stored results: ``python -m benchmarks.figure``."""

import json

from benchmarks.report import RESULTS

PEERS = {"C++, SIMD": "s", "C++, plain": "^", "NumPy, vectorised": "v", "optimistix, vmap": "D", "SciPy fsolve": "x"}


def throughput(results, path):
    """The library's inverse kinematics of the TSE over the batch, and its peers at the batch they were given."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    sizes = [row for name, row in results["library"].items() if ", batch " in name]
    figure, ax = plt.subplots(figsize=(6, 3.8), layout="constrained")
    ax.loglog([r["poses"] for r in sizes], [r["poses_per_s"] for r in sizes], "ko-", label="this library, vmap")
    for name, marker in PEERS.items():
        row = results["contest"][name]
        ax.loglog(row["poses"], row["poses_per_s"], marker, color="0.35", mfc="white", ms=7, label=name)
    ax.set(xlabel="poses in a batch", ylabel="poses per second")
    ax.grid(color="0.85")
    ax.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    throughput(json.loads((RESULTS / "full.json").read_text()), RESULTS / "throughput.png")
