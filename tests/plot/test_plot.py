"""Pictures of every robot: that what is drawn is finite, and stands where the robot is."""

import dataclasses

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.plot._robot import _RAIL_COLOR, LEG_COLORS
from tests.toys import Planar3RPR, PRSLeg, ThreePRS


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def drawn(ax, color, marker="o"):
    """The segments of a color, each ``(points, dimensions)``."""
    lines = [line for line in ax.lines if line.get_color() == color and line.get_marker() == marker]
    return [np.array(line.get_data_3d() if ax.name == "3d" else line.get_data()).T for line in lines]


def attached(robot, pose):
    """The points that the platform's legs hold, as rows."""
    parts = robot.attachments(*robot.space.place(jnp.asarray(pose)))
    return np.array([part.array() for part in parts])


def test_every_robot_is_drawn_where_it_is(robot):
    ax = js.plot.robot(robot)
    pose, _ = robot.home()
    points, size = attached(robot, pose), robot.space.translations
    assert ax.name == ("3d" if size == 3 else "rectilinear")
    assert ax.get_title() == "" and ax.get_aspect() in ("equal", 1)
    assert [ax.get_xlabel(), ax.get_ylabel()] == ["x (m)", "y (m)"] and (size == 2 or ax.get_zlabel() == "z (m)")
    everything = [np.array(line.get_data_3d() if size == 3 else line.get_data()) for line in ax.lines]
    assert all(np.isfinite(line).all() and len(line) == size for line in everything)

    (plate,) = drawn(ax, "black")
    assert np.abs(plate - points[[*range(len(points)), 0]]).max() < 1e-12 * float(robot.length)
    for color, point in zip(LEG_COLORS, points, strict=False):
        bars = drawn(ax, color)
        ends = np.concatenate(bars)
        if isinstance(robot, js.NavaroII):  # the guide's middle
            ends = np.array([bar.mean(axis=0) for bar in bars])
        assert np.linalg.norm(ends - point, axis=1).min() < 1e-9 * float(robot.length), "the leg holds the platform"
    grounded = not isinstance(robot, Planar3RPR)
    assert bool(drawn(ax, _RAIL_COLOR)) == grounded, "the base is to be seen"


@pytest.mark.parametrize("spatial", [False, True])
def test_scissors_of_a_planar_robot_lie_beside_their_legs_or_stand(spatial):
    """Every bar has its length in the picture; the drawn legs end at A and B."""
    robot, pose = js.NavaroII.prototype(6), np.array([38.0, 25.0, 0.5])
    ax = plt.figure().add_subplot(projection="3d" if spatial else None)
    assert js.plot.robot(robot, pose, ax=ax, unit="") is ax and ax.get_xlabel() == "x"
    pad = [0.0] * spatial
    for color, anchor, tip in zip(LEG_COLORS, np.asarray(robot.base), attached(robot, pose), strict=False):
        *bars, screw, guide = drawn(ax, color)
        lengths = [np.linalg.norm(b - a) for a, b in bars]
        assert len(bars) == 8 and np.abs(np.array(lengths) - np.sqrt(6481) / 4).max() < 1e-9  # [NAV19 eq. 30]
        for part, middle in ((screw, anchor), (guide, tip)):
            assert np.abs(part.mean(axis=0) - [*middle, *pad]).max() < 1e-9
            across = part[1] - part[0]
            assert abs(across[:2] @ (tip - anchor)) < 1e-9
            rho = np.linalg.norm(tip - anchor)
            assert np.linalg.norm(across) == pytest.approx(np.sqrt(6481 / 16 - (rho / 4) ** 2))  # mu
            assert not spatial or np.abs(across[:2]).max() < 1e-9, "upright"
    rails = [np.linalg.norm(rail[1] - rail[0]) for rail in drawn(ax, _RAIL_COLOR, "None")]
    assert rails == pytest.approx([0, 71] * 3), "anchor and stroke"


def test_the_picture_of_a_robot_shows_every_bar_slide_and_the_plate(prototype):
    ax = js.plot.robot(prototype, [0.1, 0.05, 1.1, 0.1, 0.2, 0.3])
    assert len(ax.lines) == 3 * (2 + 6 + 2) + 2, "rails, bars and sliders; base and platform"
    plate = np.array(ax.lines[-1].get_data_3d()).T
    position, rotation = js.SE3.place(jnp.array([0.1, 0.05, 1.1, 0.1, 0.2, 0.3]))
    apices = np.stack([np.asarray(a.array()) for a in prototype.attachments(position, rotation)])
    assert np.abs(plate[:3] - apices).max() < 1e-12
    bars = [np.array(line.get_data_3d()).T for line in ax.lines[2:8]]
    assert np.abs(np.array([bar[1] for bar in bars[-2:]]) - apices[0]).max() < 1e-9, "the last bars meet in the apex"
    with pytest.raises(ValueError, match="does not reach"):
        js.plot.robot(prototype, [0, 0, 3.0, 0, 0, 0])


def test_sliders_are_marked_on_their_rails(prototype):
    counts = {js.TriScott: 2, js.Micabo: 2, ThreePRS: 1}
    for robot in (js.TriScott.prototype(), js.Micabo.prototype(), ThreePRS.example()):
        ax = js.plot.robot(robot)
        _, joints = robot.home()
        for leg, color in enumerate(LEG_COLORS[:3]):
            marks = np.array([mark[0] for mark in drawn(ax, color, "s")])
            assert len(marks) == counts[type(robot)]
            if isinstance(robot, js.Micabo):
                assert sorted(marks[:, 2]) == pytest.approx(np.sort(joints[leg::3]))
                assert np.abs(marks[:, :2] - np.asarray(robot.masts[leg])).max() < 1e-12
    assert len(drawn(js.plot.robot(prototype), LEG_COLORS[0], "s")) == 2


@js.pytree
class AxisLeg(PRSLeg):
    def bars(self, joints, attachment):
        return PRSLeg.bars(self, joints, attachment[0])


@js.pytree
class AxisPRS(ThreePRS):
    """The 3-PRS whose legs see a point and an axis of the platform, or a frame."""

    framed: bool = js.static(default=False)

    def legs(self):
        plain = ThreePRS.legs(self)
        return AxisLeg(plain.slide, plain.rod)

    def attachments(self, position, rotation):
        points = ThreePRS.attachments(self, position, rotation)
        return [(point, rotation if self.framed else rotation.columns[2]) for point in points]


@pytest.mark.parametrize("framed", [False, True])
def test_the_platform_is_outlined_through_points_with_axes_and_frames(framed):
    plain = ThreePRS.example()
    robot = AxisPRS(plain.rod, plain.top_radius, framed)
    pose, joints = plain.home()
    (plate,) = drawn(js.plot.robot(robot, pose, joints=joints), "black")
    points = attached(plain, pose)
    assert np.abs(plate - points[[0, 1, 2, 0]]).max() < 1e-12


def test_spatial_robots_need_spatial_axes(prototype):
    with pytest.raises(ValueError, match="flat axes for a spatial robot"):
        js.plot.robot(prototype, ax=plt.figure().add_subplot())


def test_a_scissor_without_end_of_stroke_is_drawn():
    good = js.NavaroII.prototype()
    endless = dataclasses.replace(good, stroke=(0.0, np.inf))
    ax = js.plot.robot(endless)
    assert all(np.isfinite(line.get_data()).all() for line in ax.lines)
    assert jax.tree.structure(endless) == jax.tree.structure(good)


def lines_of(ax, width):
    """Vertices ``(n, 2)`` of the contour lines of a width."""
    sets = [c for c in ax.collections if hasattr(c, "levels") and np.allclose(c.get_linewidths(), width)]
    return np.concatenate([path.vertices for c in sets for path in c.get_paths()])


def test_a_singularity_map_shows_the_locus_inside_the_workspace():
    """Mode 8 of NaVARo II: alpha = 0 in any slice, and a circle about the middle [NAV19 eq. 38]."""
    robot = dataclasses.replace(js.NavaroII.prototype(8), stroke=(0.0, np.inf))
    low, high = (-60.0, -60.0), (150.0, 150.0)
    ax = js.plot.singularity_map(robot, [0.0, 0.0, 0.5], low=low, high=high, resolution=60, unit="mm")
    circle = lines_of(ax, 2) - np.array([45.0, 15 * np.sqrt(3)])
    off = np.abs(np.linalg.norm(circle, axis=1) - np.sqrt(3000 - 1800 * np.cos(0.5)))
    assert np.median(off) < 0.1 and off.max() < 3.6, "within a cell, also where a leg vanishes"
    assert np.ptp(np.arctan2(*circle.T)) > 6 and ax.get_title() == ""
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x (mm)", "y (mm)", 1)

    limited = js.NavaroII.prototype(8)
    low, high = (-60.0, -3.0), (150.0, 3.0)
    ax = js.plot.singularity_map(limited, [0.0, 20.0, 0.0], ("x", "alpha"), low=low, high=high, resolution=60, unit="")
    locus = lines_of(ax, 2)
    off = np.hypot(locus[:, 0] - 45, 20 - 15 * np.sqrt(3)) - np.sqrt(3000 - 1800 * np.cos(locus[:, 1]))
    assert np.minimum(np.abs(locus[:, 1]) / 0.1, np.abs(off) / 3.6).max() < 1, "either factor vanishes, within a cell"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "alpha (rad)")
    margins = [float(js.feasibility(limited, [x, 20.0, alpha]).margin) for x, alpha in locus[::5]]
    assert min(margins) > -0.01
    assert len(ax.lines[-1].get_xdata()) == 0, "limits of the stroke are not singular"
    with pytest.raises(ValueError, match="expected two of"):
        js.plot.singularity_map(limited, [0.0, 20.0, 0.0], ("x", "z"), low=low, high=high)


def test_a_singularity_map_marks_the_folds_of_the_home_mode(prototype):
    low, high = (-0.9, -1.0), (0.9, 1.0)
    pose, axes = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], ("x", "yaw")
    ax = js.plot.singularity_map(prototype, pose, axes, low=low, high=high, resolution=24)
    dots = np.array(ax.lines[-1].get_data()).T
    assert len(dots)
    for x, yaw in dots:  # on one side of the fold the leg is nearly singular, on the other the mode is lost
        sides = [js.singularities.measures(prototype, [x + dx, 0.0, 1.0, 0.0, 0.0, yaw]) for dx in (-1e-6, 1e-6)]
        nearest = np.sort([float(jnp.abs(side.type1).min()) for side in sides])  # nan comes last
        assert nearest[0] < 0.01 and np.isnan(nearest[1])


def test_a_singular_surface_is_drawn_in_its_box():
    robot = js.NavaroII.prototype(8)
    box = js.Box([20.0, 10.0, -1.0], [70.0, 40.0, 1.0])
    ax = js.plot.surface(robot, box, shape=(5, 4, 5), unit="mm")
    (surface,) = ax.collections
    assert [ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()] == ["x (mm)", "y (mm)", "alpha (rad)"]
    assert ax.get_zlim() == (-1, 1) and np.ptp(surface.get_facecolor()[:, 0]) >= 0
    empty = js.plot.surface(robot, js.Box([40.0, 20.0, 0.5], [50.0, 30.0, 0.7]), shape=(2, 2, 2))
    assert not empty.collections


def test_frames_of_an_animation_show_the_path_within_one_frame(tmp_path):
    robot = js.NavaroII.prototype(6)
    path = np.linspace([30.0, 20.0, 0.3], [55.0, 35.0, -0.2], 4)
    moving = js.plot.animate(robot, path)
    ax, limits = moving._fig.axes[0], []
    for number, pose in enumerate(path):
        moving._draw_frame(number)
        (plate,) = drawn(ax, "black")
        assert np.abs(plate[:-1] - attached(robot, pose)).max() < 1e-9
        limits.append((*ax.get_xlim(), *ax.get_ylim()))
    assert np.ptp(limits, axis=0).max() == 0
    moving.save(tmp_path / "path.gif", writer="pillow")
    assert (tmp_path / "path.gif").stat().st_size > 1000
    with pytest.raises(ValueError, match="expected"):
        js.plot.animate(robot, path[0])
    with pytest.raises(ValueError, match="does not reach"):
        js.plot.animate(js.TripleScissorExtender.prototype(), np.eye(6)[2:3] * 10)


def test_a_front_shades_what_is_dominated():
    values = jnp.array([[0.0, 3.0], [1.0, 1.0], [3.0, 0.0]])
    front = js.design.ParetoFront(values, values, jnp.zeros(3))
    ax = js.plot.front(front, labels=["mass (kg)", "error (mm)"])
    (dots,) = ax.lines
    np.testing.assert_array_equal(np.array(dots.get_data()).T, values)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("mass (kg)", "error (mm)")
    (path,) = ax.collections[0].get_paths()
    inside = [
        path.contains_point(point) for point in [(0.5, 2.9), (0.5, 3.0 + 1e-9), (1.5, 1.5), (0.9, 1.1), (2.9, 0.9)]
    ]
    assert inside == [False, False, True, False, False]
    with pytest.raises(ValueError, match="two or three metrics"):
        js.plot.front(js.design.ParetoFront(jnp.zeros((0, 2)), values, jnp.zeros(0)))


def test_sensitivities_are_elasticities():
    """Of a product of powers they are the exponents."""
    dimensions = {"width": 2.0, "lengths": np.array([3.0, 0.5]), "unused": 7.0, "zero": 0.0}
    metrics = {
        "stiffness": lambda d: 5 * d["width"] ** 3 / d["lengths"][1] + d["zero"],
        "mass": lambda d: d["width"] * d["lengths"][0] ** 2,
    }
    ax = js.plot.sensitivity(dimensions, metrics)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["['lengths'] 2", "['lengths'] 1", "['width']"]
    found = {group.get_label(): [bar.get_width() for bar in group] for group in ax.containers}
    assert found["stiffness"] == pytest.approx([-1, 0, 3]) and found["mass"] == pytest.approx([0, 2, 1])
    with pytest.raises(ValueError, match=r"'lost' with value 0\.0"):
        js.plot.sensitivity(dimensions, {"lost": lambda d: 0 * d["width"]})


def test_before_and_after_share_their_scales():
    result = js.design.optimize(lambda x: x**2, 0.5, bounds=(-1.0, 1.0), steps=3)
    one, other = js.plot.before_after(result, lambda x, ax: ax.plot([0, x - 1], [0, 2 * x]))
    assert one.get_xlim() == other.get_xlim() and one.get_ylim() == other.get_ylim()
    assert one.get_xlim()[0] < -1 < one.get_xlim()[1] and (one.get_title(), other.get_title()) == (
        "before: 0.25",
        "after: 0",
    )
