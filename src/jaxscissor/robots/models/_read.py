"""What a MuJoCo model says of its bodies, joints and equalities, read by MuJoCo."""

from __future__ import annotations

import importlib
import pathlib
import re
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from jaxscissor.robots.models._graph import Graph, Loop, Part, PartJoint

_NEARBY = 0.02  # in radians and lengths of the model
_KINDS = {1: "B", 2: "P", 3: "R"}  # of mjtJoint; 0 is free


def read(
    path: pathlib.Path, platform: str, base: str, length: float = 0.0
) -> tuple[Graph, tuple[str, ...], np.ndarray]:
    """The model in the frame of its base, the joints that its actuators move, and how the platform is turned.

    At home, or a random step away from there, which is small by a length of the model's.

    1. MuJoCo parses the file; what is to be seen and touched is taken out, so that no other file is opened.
    2. The configuration is moved to where the loops close.
    3. Bodies that no joint moves against one another are one part.

    Raises:
      ValueError: see ``from_mjcf``.
    """
    mujoco: Any = importlib.import_module("mujoco")  # an extra, of which type checkers know nothing
    model = _compiled(mujoco, path)
    data = _closed(mujoco, model, length)
    numbers = {name: mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in (platform, base)}
    for name, number in numbers.items():
        if number < 0:
            raise ValueError(f"Got {name!r}, which is no body; expected one of {_names(mujoco, model)}.")
    origin, turned = data.xpos[numbers[base]].copy(), data.xmat[numbers[base]].reshape(3, 3).copy()

    def here(point: np.ndarray) -> np.ndarray:
        return turned.T @ (np.asarray(point) - origin)

    root = model.body_weldid
    parts = {}
    for number in sorted(set(root.tolist())):
        kinds = [model.jnt_type[j] for j in _joints_of(model, number)]
        joints = [_joint(mujoco, model, data, j, here, turned) for j in _joints_of(model, number) if model.jnt_type[j]]
        parent = None if number == root[0] else int(root[model.body_parentid[number]])
        parts[number] = Part(_name(mujoco, model, "body", number), parent, here(data.xpos[number]), joints, 0 in kinds)
    top, bottom = int(root[numbers[platform]]), int(root[numbers[base]])
    if top == bottom:
        raise ValueError(f"Got {platform!r}, which no joint moves against {base!r}.")
    parts[bottom].origin, parts[bottom].parent, parts[bottom].joints = np.zeros(3), None, []
    loops = [_loop(mujoco, model, data, i, here) for i in range(model.neq) if data.eq_active[i]]
    for loop in loops:
        if loop.kind != "gear" and {loop.first, loop.second} == {top, bottom} and parts[top].loose:
            raise ValueError(f"Got the equality {loop.name!r} between base and platform; expected bodies between them.")
    moved = [model.actuator_trnid[i, 0] for i in range(model.nu) if model.actuator_trntype[i] == 0]
    actuated = tuple(dict.fromkeys(_name(mujoco, model, "joint", int(j)) for j in moved))
    graph = Graph(parts, loops, bottom, top, here(data.xpos[numbers[platform]]))
    return graph, actuated, turned.T @ data.xmat[numbers[platform]].reshape(3, 3)


def _compiled(mujoco: Any, path: pathlib.Path) -> Any:
    """The model without what is to be seen and touched, and with some mass, which MuJoCo demands."""
    text = path.read_text()
    if re.search(r"<(include|model|attach)\b", text):
        raise ValueError(f"Got {path}, which includes other files; expected one that stands alone.")
    spec = mujoco.MjSpec.from_string(text)
    for equality in spec.equalities:
        if equality.type not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD, mujoco.mjtEq.mjEQ_JOINT):
            raise ValueError(f"Got the equality {equality.name!r} of {equality.type}; expected connect, weld or joint.")
    for body in spec.bodies[1:]:
        body.explicitinertial, body.mass, body.inertia, body.ipos = True, 1.0, [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
        body.fullinertia = [np.nan] * 6
    kinds = ("keys", "sensors", "pairs", "excludes", "geoms", "cameras", "lights", "skins", "flexes", "hfields")
    for kind in (*kinds, "materials", "textures", "meshes"):
        for thing in list(getattr(spec, kind)):
            spec.delete(thing)
    return spec.compile()


def _closed(mujoco: Any, model: Any, length: float) -> Any:
    """The model's configuration with its loops closed, by steps of Gauss and Newton."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, off = mujoco.MjData(model), np.zeros(0)
    slides = np.isin(model.jnt_type[model.dof_jntid], [0, 2])  # a free joint is taken for slides: nothing hangs on it
    step = _NEARBY * np.where(slides, length, length > 0)
    mujoco.mj_integratePos(model, data.qpos, step * np.random.default_rng(0).uniform(-1, 1, model.nv), 1.0)
    for _ in range(50):
        mujoco.mj_fwdPosition(model, data)
        own = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        off = data.efc_pos[own]
        if not len(off) or np.abs(off).max() < 1e-12:
            return data
        step = -np.linalg.lstsq(data.efc_J.reshape(-1, model.nv)[own], off, rcond=1e-8)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    if np.abs(off).max() > 1e-9:
        raise ValueError(f"Got a model whose loops stay open by {np.abs(off).max():.1e}; expected that they close.")
    return data


def _joints_of(model: Any, body: int) -> range:
    return range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])


def _joint(mujoco: Any, model: Any, data: Any, number: int, here: Any, turned: np.ndarray) -> PartJoint:
    kind = _KINDS[int(model.jnt_type[number])]
    stroke = tuple(model.jnt_range[number]) if model.jnt_limited[number] and kind != "B" else (-np.inf, np.inf)
    value = 0.0 if kind == "B" else _value(model, data.qpos, number)
    axis = turned.T @ data.xaxis[number]
    return PartJoint(_name(mujoco, model, "joint", number), kind, axis, here(data.xanchor[number]), value, stroke)


def _value(model: Any, qpos: np.ndarray, joint: int) -> float:
    """The coordinate of a pin or slide."""
    return float(qpos[model.jnt_qposadr[joint]])


def _loop(mujoco: Any, model: Any, data: Any, number: int, here: Any) -> Loop:
    """One equality."""
    name, root = _name(mujoco, model, "equality", number), model.body_weldid
    first, second, values = int(model.eq_obj1id[number]), int(model.eq_obj2id[number]), model.eq_data[number]
    if model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT:
        ends = [_name(mujoco, model, "joint", j) if j >= 0 else None for j in (first, second)]
        moved = 0.0 if second < 0 else _value(model, data.qpos, second) - _value(model, model.qpos0, second)
        # a function of how far the other joint is from home, not from where the file counts
        about = Polynomial(values[:5])(Polynomial([moved, 1.0])).coef
        return Loop(
            name, "gear", ends[0], ends[1], polynomial=(0.0, *map(float, [*about[1:], *[0.0] * (5 - len(about))]))
        )
    if model.eq_objtype[number] == mujoco.mjtObj.mjOBJ_SITE:
        place, (first, second) = data.site_xpos[first], (model.site_bodyid[s] for s in (first, second))
    elif model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT:
        place = data.xpos[first] + data.xmat[first].reshape(3, 3) @ values[:3]
    else:
        place = data.xpos[second] + data.xmat[second].reshape(3, 3) @ values[:3]
    kind = "point" if model.eq_type[number] == mujoco.mjtEq.mjEQ_CONNECT else "frame"
    return Loop(name, kind, int(root[first]), int(root[second]), here(place))


def _name(mujoco: Any, model: Any, kind: str, number: int) -> str:
    """The name in the file, or the kind and the number."""
    return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), number) or f"{kind} {number}"


def _names(mujoco: Any, model: Any) -> list[str]:
    return [_name(mujoco, model, "body", i) for i in range(model.nbody)]
