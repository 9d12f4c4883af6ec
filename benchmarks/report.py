"""Tables of results, and the comparison with stored ones."""

import pathlib

RESULTS = pathlib.Path(__file__).parent / "results"
TOLERANCE = 1.5  # processor time relative to plain C++ may grow by this factor before it counts as slower
COLUMNS = {
    "poses": "{:,}",
    "poses_per_s": "{:,.0f}",
    "cpu_ns_per_pose": "{:,.0f}",
    "success": "{:.4f}",
    "wrong_branch": "{}",
    "p50": "{:.0e}",
    "p98": "{:.0e}",
    "max": "{:.0e}",
    "trace": "{:.2f}",
    "lower": "{:.2f}",
    "compile": "{:.2f}",
    "first_run": "{:.3f}",
    "temporary_MiB": "{:.1f}",
}


def table(rows):
    """Markdown, with the columns that any row has."""
    columns = [c for c in COLUMNS if any(c in row for row in rows.values())]
    lines = ["| row | " + " | ".join(c.replace("_", " ") for c in columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for name, row in rows.items():
        cells = [COLUMNS[c].format(row[c]) if c in row else "" for c in columns]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def relative(results):
    """Processor time per pose over that of plain C++ in the same run, {row: ratio}."""
    plain = results["contest"]["C++, plain"]["cpu_ns_per_pose"]
    ratios = {name: row["cpu_ns_per_pose"] / plain for name, row in results["contest"].items()}
    return ratios | {name: row["cpu_ns_per_pose"] / row["plain_cpu_ns"] for name, row in results["library"].items()}


def regressions(results, stored):
    """One sentence for every row that got slower."""
    now, then = relative(results), relative(stored)
    return [
        f"{name}: {now[name]:.2f} of plain C++, was {then[name]:.2f}"
        for name in now
        if name in then and now[name] > TOLERANCE * then[name]
    ]
