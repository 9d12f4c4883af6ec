"""The package as a whole: import directions, an inert import, documented names, metadata, README commands."""

import ast
import pathlib
import re
import subprocess
import sys
import tomllib

import pytest

import jaxscissor as js

ROOT = pathlib.Path(__file__).parents[1]
SOURCE = ROOT / "src" / "jaxscissor"
LEVELS = [
    {"_vectors", "_pytree", "_fence", "_checkpoint", "_progress", "mobility"},
    {"_numerics", "_solution", "_trigonometric", "_batching"},
    {"_matrices", "_sincos", "_program"},
    {
        "_spaces",
        "_newton",
        "_bracket",
        "_quartic",
        "_sweep",
        "_distinct",
        "scissor",
        "scott",
        "mechanisms._method_checks",
    },
    {"mechanisms._contract", "mechanisms._octahedron", "mechanisms._planar_triangle", "mechanisms._upright"},
    {"mechanisms.per_leg", "mechanisms._scissor_leg", "mechanisms._scott_leg", "mechanisms._planar_home"},
    {"mechanisms.triple_scissor", "mechanisms.navaro", "mechanisms.tri_scott", "mechanisms.stewart", "_legs"},
    {"_platform", "mechanisms.navaro_drive"},
    {"kinematics", "assembly", "constraints"},
    {"jacobians", "feasibility", "singularity", "sensing"},
    {"dexterity", "regions", "reach", "encumbrance", "tolerances", "contract_check"},
    {"tasks", "_samples", "_descent"},
    {"workspace", "_sqp", "_scaling", "_prices", "extremes", "loci", "clearance"},
    {"exact", "metrics", "aspects", "_slices", "design", "binding"},
    {"modes", "_singularity_pictures", "tradeoffs"},
    {"plot"},
]
LEVEL = {name: level for level, names in enumerate(LEVELS) for name in names}


def modules():
    return [path for path in SOURCE.rglob("*.py") if path.name != "__init__.py"]


def name_of(path):
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts)


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_imports_run_downwards(path):
    text = path.read_text()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("jaxscissor"):
            imported = node.module.removeprefix("jaxscissor").lstrip(".")
            assert imported and LEVEL[imported] < LEVEL[name_of(path)], f"{name_of(path)} imports {imported}"
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        allowed = {"jax", "numpy", "scipy", "optax", "matplotlib", "mpl_toolkits", "tqdm", "jaxscissor", "__future__"}
        allowed |= sys.stdlib_module_names
        assert all(name.split(".")[0] in allowed for name in names)


def test_import_changes_nothing():
    code = (
        "import sys, jax; before = dict(jax.config.values); import jaxscissor; "
        "assert dict(jax.config.values) == before; assert 'matplotlib.pyplot' not in sys.modules; "
        "jax.config.update('jax_num_cpu_devices', 2); assert jax.device_count() == 2"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_public_name_is_documented_with_an_example_where_it_computes():
    names = [name for name in vars(js) if not name.startswith("_") and name not in ("assembly",)]
    for name in names:
        thing = getattr(js, name)
        if callable(thing):
            assert thing.__doc__ and len(thing.__doc__.split("\n")[0]) > 15, name
    for function in (js.inverse_kinematics, js.forward_kinematics, js.feasibility, js.workspace_fraction):
        for section in ("Args:", "Returns:", "Raises:", "Example:"):
            assert section in function.__doc__


def test_metadata_agrees_with_the_promises():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {re.split("[>=]", d)[0] for d in project["dependencies"]} == {"jax", "numpy", "optax", "matplotlib"}
    assert {"test", "bench", "notebooks", "dev"} <= set(project["optional-dependencies"])
    assert js.__version__ == project["version"]
    assert (SOURCE / "py.typed").exists()


def test_readme_shows_a_result_early_and_its_commands_exist():
    lines = (ROOT / "README.md").read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if "CONVERGED" in line)
    assert first < 30
    commands = [line for line in lines if line.startswith("python3 -m venv")]
    assert len(commands) == 2
    for path in re.findall(r"examples/\S+?\.(?:py|png)", "\n".join(lines)):
        assert (ROOT / path).exists(), path
