"""Sums over a mesh of devices, over processes, and over jobs that are stopped and resumed."""

import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor._engine import checkpoint, map_reduce
from tests import toys
from tests.conftest import exhaustive
from tests.toys import Planar3RPR

Execution = js.workspace.Execution
ROOT = pathlib.Path(__file__).parents[2]
REGION = js.Box([0.0, 0.0, -0.3], [0.9, 0.8, 0.3])
SAMPLE = REGION.quasi_random(5001)
NAMES = ["fraction", "fraction per metre of radius", "fractions of four designs"]  # as the example prints them
FUNCTIONS = {
    "hard": partial(js.workspace.fraction, poses=SAMPLE, execution=Execution(chunk_size=128)),
    "soft": partial(js.workspace.soft_fraction, poses=SAMPLE, execution=Execution(chunk_size=128)),
    "exact": partial(js.workspace.ray_fraction, region=REGION, rays=300, axes=(0, 1), cells=16),
}


@pytest.fixture(scope="module")
def mesh():
    """All virtual devices, by axes of any names and of the types that JAX gives by default."""
    return jax.make_mesh((4, 2), ("hosts", "devices"), devices=jax.devices("cpu"))


def agree(one, other):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["hard", "soft", *exhaustive("exact")])
def test_many_devices_give_what_one_gives(name, mesh):
    robot, function = Planar3RPR.example(), FUNCTIONS[name]
    agree(
        *(
            jax.value_and_grad(function)(robot, execution=Execution(mesh=devices, chunk_size=128))
            for devices in (None, mesh)
        )
    )


@pytest.mark.parametrize("function", [FUNCTIONS["hard"], jax.grad(FUNCTIONS["soft"])], ids=["hard", "gradient"])
def test_a_batch_of_designs_is_shared_out_alike(function, mesh):
    designs = jax.vmap(lambda s: jax.tree.map(lambda x: s * x, Planar3RPR.example()))(jnp.array([1.0, 1.1, 1.2]))
    one, many = (
        jax.vmap(partial(function, execution=Execution(mesh=devices, chunk_size=128)))(designs)
        for devices in (None, mesh)
    )
    agree(one, many)
    assert all(jnp.ptp(leaf) > 0.01 for leaf in jax.tree.leaves(one))


@pytest.mark.parametrize("name", ["hard", "designs", "soft", *exhaustive("exact")])
def test_the_only_communication_is_one_sum(name, mesh):
    robot, many = Planar3RPR.example(), Execution(mesh=mesh, chunk_size=128)
    programs = {name: jax.value_and_grad(partial(function, execution=many)) for name, function in FUNCTIONS.items()}
    programs["designs"] = jax.vmap(partial(FUNCTIONS["hard"], execution=many))
    argument = jax.tree.map(lambda x: jnp.stack([x, x]), robot) if name == "designs" else robot
    text = jax.jit(programs[name]).lower(argument).compile().as_text()
    collectives = r"\b(all-reduce|all-gather|all-to-all|reduce-scatter|collective-\w+|send|recv)(?:-start)?\("
    assert re.findall(collectives, text) == ["all-reduce"]


def test_stored_poses_and_few_of_them_are_shared_out_too(mesh):
    robot = Planar3RPR.example()
    for count in (3, 5001):
        poses = SAMPLE[:count]
        assert js.workspace.fraction(robot, poses) == js.workspace.fraction(
            robot, poses, execution=Execution(mesh=mesh)
        )


def test_a_mesh_in_use_may_be_given(mesh):
    robot = Planar3RPR.example()
    with jax.set_mesh(mesh):
        shared = js.workspace.fraction(robot, SAMPLE, execution=Execution(mesh=mesh))
    assert shared == js.workspace.fraction(robot, SAMPLE)


@pytest.mark.exhaustive
def test_two_processes_give_what_one_device_gives():
    command = [sys.executable, ROOT / "examples" / "many_devices.py", "--small", "--devices", "4", "--processes", "2"]
    text = subprocess.run(command, check=True, capture_output=True, text=True, timeout=600).stdout
    assert "4 devices, 2 processes" in text
    fraction, slope, designs = (json.loads(re.search(rf"^{name} .* s  (.*)$", text, re.M)[1]) for name in NAMES)
    robot = js.TripleScissorExtender.prototype()
    sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(100_000)
    gradient = jax.grad(js.workspace.soft_fraction)(robot, sample)
    agree((fraction, slope), (js.workspace.fraction(robot, sample), gradient.actuator_radius))
    assert len(designs) == 4 and sorted(designs) == designs


JOB = """
import sys, jax
jax.config.update("jax_enable_x64", True)
from tests.engine import test_map_reduce
from tests.toys import Planar3RPR
out = test_map_reduce.long_job(sys.argv[1], sys.argv[2])(Planar3RPR.example())
print([x.tobytes().hex() for x in map(jax.device_get, jax.tree.leaves(out))])
"""


def long_job(name, path):
    """More than a hundred blocks."""
    hard, soft = js.workspace.fraction, jax.value_and_grad(js.workspace.soft_fraction)
    execution = Execution(chunk_size=20, checkpoint=path)
    return partial(hard if name == "hard" else soft, poses=REGION.quasi_random(200_000), execution=execution)


@pytest.mark.parametrize("name", ["hard", *exhaustive("gradient")])
def test_a_job_killed_in_the_middle_ends_with_the_identical_result(name, tmp_path):
    def start(path):
        return subprocess.Popen([sys.executable, "-c", JOB, name, path], stdout=subprocess.PIPE, cwd=ROOT, text=True)

    undisturbed, path = start(tmp_path / "undisturbed.npz"), tmp_path / "killed.npz"
    expected = undisturbed.communicate(timeout=300)[0]
    job = start(path)
    while not path.exists() or np.load(path)["done"] < 500:
        assert job.poll() is None
        time.sleep(0.002)
    job.send_signal(signal.SIGKILL)
    job.communicate()
    with np.load(path) as killed, np.load(tmp_path / "undisturbed.npz") as whole:
        assert 500 <= killed["done"] < whole["done"]
    resumed = start(path).communicate(timeout=300)[0]
    assert resumed == expected and len(expected) > 10
    with np.load(path) as resumed, np.load(tmp_path / "undisturbed.npz") as whole:
        assert resumed["done"] == whole["done"]


def test_a_checkpoint_is_of_one_job_only(tmp_path):
    robot, path = Planar3RPR.example(), tmp_path / "job.npz"
    first = js.workspace.fraction(robot, SAMPLE, execution=Execution(checkpoint=path))
    assert js.workspace.fraction(robot, SAMPLE, execution=Execution(checkpoint=path)) == first
    wider = jax.tree.map(lambda x: 1.1 * x, robot)
    others = {
        "robot": lambda: js.workspace.fraction(wider, SAMPLE, execution=Execution(checkpoint=path)),
        "sample": lambda: js.workspace.fraction(
            robot, REGION.quasi_random(5001, seed=1), execution=Execution(checkpoint=path)
        ),
        "size": lambda: js.workspace.fraction(
            robot, REGION.quasi_random(5002), execution=Execution(chunk_size=5001, checkpoint=path)
        ),
        "chunk": lambda: js.workspace.fraction(robot, SAMPLE, execution=Execution(chunk_size=77, checkpoint=path)),
        "function": lambda: js.workspace.soft_fraction(robot, SAMPLE, execution=Execution(checkpoint=path)),
    }
    for name, other in others.items():
        with pytest.raises(ValueError, match=f"a job with another .*{name}"):
            other()
    with pytest.raises(ValueError, match="inside jit or vmap"):
        jax.jit(partial(js.workspace.fraction, poses=SAMPLE, execution=Execution(checkpoint=path)))(robot)


def test_the_same_numbers_in_another_robot_are_another_job(tmp_path):
    """Neither the class's short name nor the arrays tell them apart, only what is computed."""

    def named_alike(reach):
        class Planar3RPR(toys.Planar3RPR):
            def attachments(self, position, rotation):
                return [point * reach for point in super().attachments(position, rotation)]

        return js.pytree(Planar3RPR)(*jax.tree.leaves(toys.Planar3RPR.example()))

    path = tmp_path / "job.npz"
    js.workspace.fraction(named_alike(1.0), SAMPLE, execution=Execution(checkpoint=path))
    with pytest.raises(ValueError, match=r"a job with another .*function"):
        js.workspace.fraction(named_alike(1.1), SAMPLE, execution=Execution(checkpoint=path))


def test_a_damaged_checkpoint_is_refused(tmp_path, rng):
    robot, path = Planar3RPR.example(), tmp_path / "job.npz"

    def resume():
        return js.workspace.fraction(robot, SAMPLE, execution=Execution(checkpoint=path))

    expected, good = float(resume()), path.read_bytes()
    content = dict(np.load(path))
    changes = [{"done": np.int64(-5)}, {"total_0": np.float64(3.5)}, {"total_0": np.zeros((3, 2), np.uint32)}]
    for change in changes:
        np.savez(path, **{**content, **change})
        with pytest.raises(ValueError, match="content was changed"):
            resume()
    for name in content:
        np.savez(path, **{key: value for key, value in content.items() if key != name})
        with pytest.raises(ValueError, match=r"content was changed|another"):
            resume()
    for raw in (b"", b"notes", good[:100]):
        path.write_bytes(raw)
        with pytest.raises(ValueError, match="no checkpoint"):
            resume()
    for place in rng.integers(0, len(good), 100):
        flipped = bytearray(good)
        flipped[place] ^= 1 << rng.integers(8)
        path.write_bytes(flipped)
        try:
            assert float(resume()) == expected  # a bit that nobody reads
        except ValueError as error:
            assert "checkpoint" in str(error)
    path.unlink()
    path.mkdir()
    with pytest.raises(ValueError, match="no checkpoint"):
        resume()


def test_two_processes_on_one_checkpoint_both_end(tmp_path, monkeypatch):
    """The other one saves after this one has written its file, and before it puts it in place."""
    path, replace = str(tmp_path / "job.npz"), os.replace

    def meanwhile(source, target):
        monkeypatch.setattr(os, "replace", replace)
        checkpoint.save(path, {"job": 1}, 7, np.float64(0.7))
        replace(source, target)

    monkeypatch.setattr(os, "replace", meanwhile)
    checkpoint.save(path, {"job": 1}, 3, np.float64(0.3))
    assert checkpoint.restore(path, {"job": 1}, np.float64(0)) == (3, 0.3)
    assert os.listdir(tmp_path) == ["job.npz"]


def test_a_checkpoint_resumes_on_another_number_of_devices(tmp_path, mesh):
    robot, path = Planar3RPR.example(), tmp_path / "job.npz"
    few = partial(js.workspace.soft_fraction, robot, SAMPLE)
    one, many = (Execution(mesh=devices, chunk_size=128, checkpoint=path) for devices in (None, mesh))
    agree(few(execution=one), few(execution=many))


@pytest.mark.parametrize("function", [js.workspace.limiting_constraints, js.workspace.soft_gradient])
def test_sums_of_many_numbers_are_shared_out_and_resumed_too(function, tmp_path, mesh):
    robot, saved = Planar3RPR.example(), Execution(chunk_size=128, checkpoint=tmp_path / "job.npz")
    plain = function(robot, SAMPLE)
    for execution in (Execution(mesh=mesh, chunk_size=128), saved, saved):
        agree(plain, function(robot, SAMPLE, execution=execution))


def test_blocks_and_progress_change_no_result(monkeypatch):
    robot = Planar3RPR.example()
    whole = {name: jax.value_and_grad(function)(robot) for name, function in FUNCTIONS.items()}
    monkeypatch.setattr(map_reduce, "_BLOCK", 2)
    for name, function in FUNCTIONS.items():
        agree(whole[name], jax.value_and_grad(function)(robot))
