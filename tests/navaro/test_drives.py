"""The drives of NaVARo II against the scissor's formula written out, differences, and the rank of all constraints."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js

CROSSES, BAR2, HEIGHT = 4, 6481 / 16, 9 / 4  # [NAV19 eq. 30] for n = 4: l^2 and h
TURN, SCREW, LEAD = 40.0, 2.5, 0.8
ADVANCE = LEAD / (2 * np.pi * SCREW)


@pytest.fixture(scope="module")
def drive():
    return js.navaro.DriveTrain(js.NavaroII.prototype().scissor, TURN, SCREW, LEAD)


@pytest.fixture
def cases(rng):
    """Motor angles and starts between which the leg stays within its stroke."""
    screw = np.sqrt(BAR2 - (rng.uniform(12, 75, 50) / CROSSES) ** 2)
    motors = (screw - rng.uniform(HEIGHT + 0.5, 19.5, 50)) / ADVANCE
    return motors, np.column_stack([rng.uniform(-3, 3, 50), CROSSES * np.sqrt(BAR2 - screw**2)])


def screw_of(rho):
    return np.sqrt(BAR2 - (rho / CROSSES) ** 2)


def test_the_leg_draws_an_arc_a_line_or_a_spiral(drive, cases):
    motors, starts = cases
    joints = jax.jit(jax.vmap(drive.joints, (None, 0, 0)))
    tips = jax.jit(jax.vmap(drive.tip, (None, 0, 0)))

    def tip(scheme):
        theta, rho = np.asarray(joints(jnp.int32(scheme), motors, starts)).T
        point = np.asarray(tips(jnp.int32(scheme), motors, starts)) @ [1, 1j]
        assert np.abs(point - rho * np.exp(1j * theta)).max() < 1e-12
        return theta, rho, point

    (theta0, rho0), turn = starts.T, motors / TURN
    start = rho0 * np.exp(1j * theta0)
    assert np.abs(tip(js.navaro.Clutch.FREE)[2] - start).max() < 1e-12

    theta, rho, point = tip(js.navaro.Clutch.REVOLUTE)
    assert np.array_equal(rho, rho0) and np.abs(point / start - np.exp(1j * turn)).max() < 1e-12

    theta, rho, point = tip(js.navaro.Clutch.PRISMATIC)
    assert np.array_equal(theta, theta0) and np.abs((point / start).imag).max() < 1e-12
    assert np.abs(screw_of(rho0) - screw_of(rho) - ADVANCE * motors).max() < 1e-11  # a lead per turn of the screw
    assert ((rho > rho0) == (motors > 0)).all(), "a positive motor angle stretches"

    theta, rho, _ = tip(js.navaro.Clutch.COUPLED)
    screw = screw_of(rho0) - ADVANCE * TURN * (theta - theta0)  # the spiral's equation, free of the motor angle
    assert np.abs((rho / CROSSES) ** 2 + screw**2 - BAR2).max() < 1e-10
    assert np.abs(theta - theta0 - turn).max() < 1e-12


@pytest.mark.parametrize("scheme", js.navaro.Clutch)
def test_rates_are_the_derivatives_and_motor_rates_their_inverse(drive, cases, scheme):
    motors, starts = cases
    step = 1e-4
    ends = [drive.joints(scheme, jnp.asarray(s), starts[0]) for s in (-step, step)]
    differences = (ends[1] - ends[0]) / (2 * step)
    assert np.abs(drive.rates(scheme, starts[0], 1.0) - differences).max() < 1e-7
    jacobian = jax.jit(jax.vmap(jax.jacfwd(lambda m, s: drive.joints(scheme, m, s)), (0, 0)))(motors, starts)
    there = jax.vmap(drive.joints, (None, 0, 0))(scheme, motors, starts)
    rates = jax.vmap(drive.rates, (None, 0, None))(scheme, there, 3.0)
    assert np.abs(rates - 3 * jacobian).max() < 1e-11 * np.abs(rates).max() + 1e-15
    through = jax.vmap(drive.motor_rates)(there, rates)
    engaged = np.array(
        [3.0 * bool(scheme & js.navaro.Clutch.REVOLUTE), 3.0 * bool(scheme & js.navaro.Clutch.PRISMATIC)]
    )
    assert np.abs(np.asarray(through) - engaged).max() < 1e-12


def test_screws_are_those_of_the_papers_scissor(drive):
    """[NAV19 eqs. 27-28]: at rho = n h the screw is at sqrt(l^2 - h^2), at the greatest rho at h; slope by hand."""
    for rho in (9.0, 30.0, 80.0):
        stretch = float(drive.gears([0.0, rho])[1]) / ADVANCE
        assert stretch == pytest.approx(CROSSES**2 * screw_of(rho) / rho)
    assert float(drive.scissor.width(80.0)) == pytest.approx(HEIGHT)
    travel = float(drive.motor_rates([0.0, 80.0], [0.0, 1.0])[1] * drive.gears([0.0, 80.0])[1])
    assert travel == pytest.approx(1)
    span = (np.sqrt(BAR2 - HEIGHT**2) - HEIGHT) / ADVANCE
    assert float(drive.joints(js.navaro.Clutch.PRISMATIC, span, [0.0, 9.0])[1]) == pytest.approx(80)


def test_equal_maxima_of_speed_take_the_height_of_a_bar_per_radian(drive):
    even = drive.with_equal_speeds(80.0, 9.0)
    assert float(even.turn_ratio) == pytest.approx(HEIGHT / ADVANCE)
    rho = np.linspace(9, 80, 500)
    gears = np.asarray(jax.vmap(even.gears)(np.column_stack([0 * rho, rho])))
    turning, stretching = rho * gears[:, 0], gears[:, 1]
    assert turning.max() == pytest.approx(stretching.max())
    here = drive.with_equal_speeds(30.0, 30.0)
    speeds = [np.linalg.norm(jax.jacfwd(lambda m, s=s: here.tip(s, m, [0.3, 30.0]))(0.0)) for s in (1, 2)]
    assert speeds[0] == pytest.approx(speeds[1])
    assert float(here.with_equal_speeds(40.0, 40.0).screw_ratio) == SCREW


def test_equal_speeds_of_the_legs_are_equal_speeds_of_the_platform(drive):
    """In the middle of the base the legs are alike, and modes 1 and 8 move the platform equally fast."""
    pose, speeds = np.array([45, 15 * np.sqrt(3), 0.4]), []
    for mode, column in ((1, 0), (8, 1)):
        robot = js.NavaroII.prototype(mode)
        joints = js.inverse_kinematics(robot, pose).value
        even = drive.with_equal_speeds(joints[1], joints[1])
        motor = js.inverse_jacobian(robot, pose, rates="twist") / even.gears(joints[:2])[column]
        platform = np.linalg.inv(motor)
        speeds.append([np.linalg.norm(platform[:2] @ s) for s in itertools.product((-1, 1), repeat=3)])
    assert np.ptp(joints[1::2]) < 1e-12
    assert max(speeds[0]) > 0 and np.abs(np.subtract(*speeds)).max() < 1e-12 * max(speeds[0])


def freedoms(a, b, gears, schemes, held):
    """Dimension of the platform's motions that closures, engaged clutches and held motors leave, by rank."""
    rows = [np.hstack([a, b, np.zeros((6, 3))])]
    for leg, scheme in enumerate(schemes):
        for joint in (0, 1):
            if scheme & (1 << joint):
                row = np.zeros((1, 12))
                row[0, 3 + 2 * leg + joint] = 1
                row[0, 9 + leg] = 0 if held else -gears[leg, joint]
                rows.append(row)
    _, values, vectors = np.linalg.svd(np.vstack(rows))
    rank = (values > 1e-9 * values[0]).sum()
    return np.linalg.matrix_rank(vectors[rank:, :3], tol=1e-7)


def test_mobility_is_the_rank_of_all_constraints(drive):
    robot, pose = js.NavaroII.prototype(), np.array([38.0, 29.0, 0.6])
    joints = js.inverse_kinematics(robot, pose).value
    a, b = (np.asarray(part) for part in js.closure_jacobians(robot, pose, joints=joints))
    scale = np.array([90.0, 90.0, 1.0])
    gears = np.array([drive.gears(leg) for leg in np.asarray(joints).reshape(3, 2)])
    modes = []
    for schemes in itertools.product(js.navaro.Clutch, repeat=3):
        count = js.navaro.drive_mobility(schemes)
        free, held = (freedoms(a * scale, b, gears, schemes, held) for held in (False, True))
        assert (max(count.motors_free, 0), max(count.motors_held, 0)) == (free, held), schemes
        modes.append((js.navaro.drive_mode(schemes), schemes))
        if modes[-1][0]:
            assert count == (3, 0), "the motors of an actuation mode determine the pose, and any pose near"
    assert {mode: schemes for mode, schemes in modes if mode} == {
        mode: tuple({"theta": js.navaro.Clutch.REVOLUTE, "rho": js.navaro.Clutch.PRISMATIC}[name] for name in names)
        for mode, names in js.navaro.ACTUATION_MODES.items()
    }
    assert sum(mode is None for mode, _ in modes) == 64 - 8


def test_legs_of_different_schemes_are_one_vmap_and_differentiable(drive):
    starts = jnp.array([[0.0, 30.0], [1.0, 40.0], [2.0, 50.0]])
    three = jax.vmap(drive.joints, (0, None, 0))(jnp.array([0, 2, 3]), 2.0, starts)
    alone = [drive.joints(js.navaro.Clutch(c), 2.0, start) for c, start in zip((0, 2, 3), starts, strict=True)]
    assert np.abs(three - jnp.stack(alone)).max() < 1e-13
    gradient = jax.grad(lambda d: d.joints(js.navaro.Clutch.COUPLED, 2.0, starts[0])[1])(drive)
    shifts = [js.navaro.DriveTrain(drive.scissor, TURN, SCREW, LEAD + s) for s in (-1e-5, 1e-5)]
    low, high = (float(d.joints(js.navaro.Clutch.COUPLED, 2.0, starts[0])[1]) for d in shifts)
    assert float(gradient.lead) == pytest.approx((high - low) / 2e-5, rel=1e-6) and float(gradient.turn_ratio) == 0
    small = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), drive)
    assert small.joints(js.navaro.Clutch.COUPLED, np.float32(1), np.ones(2, np.float32)).dtype == jnp.float32


def test_impossible_drives_are_refused(drive):
    for change, message in [((-1.0, 1.0, 1.0), "turn_ratio = -1"), ((1.0, 1.0, np.inf), "lead = inf")]:
        with pytest.raises(ValueError, match=message):
            js.navaro.DriveTrain(drive.scissor, *change)
    with pytest.raises(ValueError, match=r"shape \(3,\)"):
        js.navaro.DriveTrain(drive.scissor, np.ones(3), 1.0, 1.0)
    for schemes in ([0, 1], [0, 1, 4]):
        with pytest.raises(ValueError, match="three legs"):
            js.navaro.drive_mobility(schemes)
        with pytest.raises(ValueError, match="three legs"):
            js.navaro.drive_mode(schemes)
