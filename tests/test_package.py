"""The package as a whole: what its rooms show, an inert import, documented names, metadata, README commands."""

import ast
import importlib
import inspect
import pathlib
import re
import subprocess
import sys
import tomllib

import jax

import jaxscissor as js

ROOT = pathlib.Path(__file__).parents[1]
SOURCE = ROOT / "src" / "jaxscissor"
ROOMS = ("calibration", "design", "export", "kinematics", "motion", "navaro", "plot", "regions", "robots")
ROOMS += ("singularities", "statics", "workspace")


def test_rooms_show_what_their_doors_say_and_nothing_else():
    assert {name for name in vars(js) if not name.startswith("_")} <= {*js.__all__, *ROOMS}
    assert set(dir(js)) == {*js.__all__, "__version__"} and len({*js.__all__} - {*ROOMS}) < 50
    for room in ROOMS:
        door = importlib.import_module(f"jaxscissor.{room}")
        shown = {name for name in vars(door) if not name.startswith("_")}
        families = {path.parent.name for path in (SOURCE / room).glob("*/__init__.py")}
        assert shown - families == set(door.__all__), room


def test_nothing_but_the_runtime_packages_is_imported():
    allowed = {"jax", "numpy", "scipy", "optax", "matplotlib", "mpl_toolkits", "tqdm", "jaxscissor", "__future__"}
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= allowed | sys.stdlib_module_names, path


def test_import_changes_nothing():
    code = (
        "import sys, jax; before = dict(jax.config.values); import jaxscissor; "
        "assert dict(jax.config.values) == before; assert 'matplotlib.pyplot' not in sys.modules; "
        "jax.config.update('jax_num_cpu_devices', 2); assert jax.device_count() == 2"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_public_name_is_documented_and_has_an_example_where_it_computes():
    rooms = (js.calibration, js.design, js.export, js.motion, js.navaro, js.plot, js.singularities, js.statics)
    for room in (js, js.workspace, *rooms):
        for name in room.__all__:
            thing = getattr(room, name)
            if callable(thing):
                assert thing.__doc__ and len(thing.__doc__.split("\n")[0]) > 15, name
    for function in (js.inverse_kinematics, js.forward_kinematics, js.feasibility, js.workspace.fraction):
        for section in ("Args:", "Returns:", "Raises:", "Example:"):
            assert section in function.__doc__


def test_what_a_function_returns_and_a_docstring_names_can_be_had_by_that_name():
    doors = {room: importlib.import_module(f"jaxscissor.{room}") for room in ROOMS}
    for room, door in doors.items():
        for function in filter(inspect.isfunction, map(door.__dict__.get, door.__all__)):
            record = function.__globals__.get(function.__annotations__.get("return"))
            if inspect.isclass(record) and record.__module__.startswith("jaxscissor"):
                assert record.__name__ in [*door.__all__, *js.__all__], (
                    f"{room}.{function.__name__} gives a {record.__name__}"
                )
    for path in [*SOURCE.rglob("*.py"), ROOT / "README.md"]:
        for room, name in re.findall(r"``?(?:js\.)?([a-z]+)\.([A-Za-z_]+)", path.read_text()):
            assert room not in doors or hasattr(doors[room], name), f"{path.name} names {room}.{name}"


def test_metadata_agrees_with_the_promises():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {re.split("[>=]", d)[0] for d in project["dependencies"]} == {"jax", "numpy", "scipy", "optax", "matplotlib"}
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


def test_robots_are_equal_if_class_and_dimensions_are():
    robot, other = js.TripleScissorExtender.prototype(), js.TripleScissorExtender.prototype()
    assert robot == other and hash(robot) == hash(other) and robot in [other]
    changed = jax.tree.map(lambda x: x * (1 + 1e-15), robot)
    assert robot != changed and robot != js.NavaroII.prototype() and robot != 1
