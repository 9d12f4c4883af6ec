"""Calibration against closed forms, differences, robots and measurements drawn at random, and counts of freedoms."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import jaxscissor as js
from jaxscissor.calibration._model import modeled, starts_of
from tests.conftest import exhaustive
from tests.toys import AZIMUTHS, LinearDelta, Planar3RPR, ThreePRS

identify, identifiability = js.calibration.identify, js.calibration.identifiability
DELTA = LinearDelta.example()
LENGTHS = {"radius": 2e-3, "rod": 2e-3}


def delta_joints(positions, radius, rod):
    """Inverse kinematics of the linear delta in closed form, a radius and a rod for each leg."""
    feet = np.stack([radius * np.cos(AZIMUTHS), radius * np.sin(AZIMUTHS)], axis=-1)
    across2 = np.sum((positions[:, None, :2] - feet) ** 2, axis=-1)
    return positions[:, 2:] + np.sqrt(rod**2 - across2)


def delta_positions(joints, radius, rod):
    """Forward kinematics in closed form: the lower of two points at three distances from three points."""
    feet = np.stack([radius * np.cos(AZIMUTHS), radius * np.sin(AZIMUTHS)], axis=-1)
    centers = np.concatenate([np.broadcast_to(feet, (len(joints), 3, 2)), joints[..., None]], axis=-1)
    first, second, third = np.moveaxis(centers, 1, 0)
    span = np.linalg.norm(second - first, axis=1, keepdims=True)
    along = (second - first) / span
    i = np.sum(along * (third - first), axis=1, keepdims=True)
    across = third - first - i * along
    j = np.linalg.norm(across, axis=1, keepdims=True)
    across = across / j
    x = (rod[0] ** 2 - rod[1] ** 2 + span**2) / (2 * span)
    y = (rod[0] ** 2 - rod[2] ** 2 + i**2 + j**2) / (2 * j) - i * x / j
    return first + x * along + y * across - np.sqrt(rod[0] ** 2 - x**2 - y**2) * np.cross(along, across)


def made_delta(rng, offsets=1e-3):
    """Dimensions of a delta that is not exact, and the zeros of its sensors."""
    radius, rod = 0.5 + LENGTHS["radius"] * rng.normal(size=3), 1.0 + LENGTHS["rod"] * rng.normal(size=3)
    return radius, rod, offsets * rng.normal(size=3)


def in_disc(rng, count, radius=0.25):
    """Points spread over a disc."""
    angle, away = np.arange(count) * 2.4, radius * np.sqrt((np.arange(count) + 0.5) / count)
    return np.stack([away * np.cos(angle), away * np.sin(angle)], axis=-1)


def in_units(found, dims):
    """What is left of the errors, along what is seen, in standard deviations of the noise."""
    seen = found.identifiability
    error = (found.changes - dims) / seen.prior
    return seen.singular_values[: seen.rank] * (seen.directions[: seen.rank] @ error)


def printed_and_probed(rng, noise):
    """A linear delta's 19 heights and 7 printed points, as owners of such printers measure them."""
    radius, rod, offsets = made_delta(rng)
    where = np.concatenate([in_disc(rng, 19), in_disc(rng, 7)])
    positions = np.column_stack([where, 0.02 * rng.normal(size=26)])
    measured = positions + noise * rng.normal(size=positions.shape)
    measured[:19, :2], measured[19:, 2] = np.nan, np.nan
    readings = delta_joints(positions, radius, rod) - offsets
    return readings, measured, np.concatenate([radius - 0.5, rod - 1.0, offsets])


def test_a_linear_delta_from_19_heights_and_7_printed_points(rng):
    readings, measured, dims = printed_and_probed(rng, 0.0)
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": 1e-9}
    exact = identify(js.per_leg(DELTA), readings, measured, **settings)
    assert exact.ok and exact.identifiability.rank == 9 and np.isnan(exact.residuals).sum() == 19 * 2 + 7
    assert np.abs(exact.changes - dims).max() < 1e-11
    assert np.abs(exact.robot.copies.radius - 0.5 - dims[:3]).max() < 1e-11
    assert np.abs(exact.offsets - dims[6:]).max() < 1e-11
    readings, measured, dims = printed_and_probed(rng, 2e-5)
    found = identify(js.per_leg(DELTA), readings, measured, **settings | {"sigma": 2e-5})
    assert found.degrees == 19 + 2 * 7 - 9 and 0.5 < found.chi_square / found.degrees < 2
    assert np.sum(in_units(found, dims) ** 2) < chi2.ppf(0.999, 9)
    assert (np.abs(found.changes - dims) < 4 * np.sqrt(np.diagonal(found.covariance))).all()


def test_heights_alone_do_not_see_what_printed_points_do(rng):
    readings, measured, _ = printed_and_probed(rng, 2e-5)
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": 2e-5}
    robot = js.per_leg(DELTA)
    by_heights = identifiability(robot, readings[:19], measure=js.calibration.heights, **settings)
    assert by_heights.rank < 9 == identifiability(robot, readings, **settings).rank
    assert len(by_heights.unseen) == 9 - by_heights.rank and "not seen" in repr(by_heights)
    found = identify(robot, readings[:19], measured[:19, 2], measure=js.calibration.heights, **settings)
    left = by_heights.directions[by_heights.rank :] @ (found.changes / by_heights.prior)
    assert found.ok and np.abs(left).max() < 1e-9 and "left as they were" in repr(found)
    deviations = np.sqrt(np.diagonal(found.covariance))
    assert (deviations <= by_heights.prior * (1 + 1e-9)).all() and np.abs(
        deviations / by_heights.deviations - 1
    ).max() < 0.1


def hexapod_joints(poses, base, platform):
    """Leg lengths in closed form."""
    turned = np.einsum("nij,lj->nli", Rotation.from_euler("XYZ", poses[:, 3:]).as_matrix(), platform)
    return np.linalg.norm(poses[:, None, :3] + turned - base, axis=-1)


def around_home(rng, robot, count, share=0.1):
    home = np.asarray(robot.home()[0])
    unit = np.where(np.arange(len(home)) < robot.space.translations, float(robot.length), 1.0)
    return home + share * unit * rng.uniform(-1, 1, (count, len(home)))


def seen_by_camera(poses, points, frame):
    """Positions of markers in a camera's frame, by SciPy."""
    turned = np.einsum("nij,kj->nki", Rotation.from_euler("XYZ", poses[:, 3:]).as_matrix(), points)
    camera = Rotation.from_euler("XYZ", frame[3:]).as_matrix()
    return ((poses[:, None, :3] + turned - frame[:3]) @ camera).reshape(len(poses), -1)


def test_frames_that_nobody_has_measured_are_the_directions_not_seen(rng):
    """With base, camera, platform and markers all unknown, both frames are free: two times six directions."""
    robot = js.StewartGough.prototype()
    points = 0.1 * rng.normal(size=(4, 3))
    camera = js.calibration.Markers(points, np.array([1.0, 0.5, 2.0, 0.3, -0.2, 0.1]))
    joints = hexapod_joints(around_home(rng, robot, 40), np.asarray(robot.base), np.asarray(robot.platform))
    prior = {"base": 0.1, "platform": 0.1, "points": 0.1, "frame": 0.1}
    found = identifiability(robot, joints, prior=prior, offsets=0.1, sigma=1e-7, measure=camera)
    assert len(found.names) == 18 + 18 + 6 + 12 + 6 and found.names[-1] == "frame[5]"
    assert found.rank == len(found.names) - 12 == 48 and len(found.unseen) == 12


def test_markers_in_a_camera_frame_recover_robot_and_camera(rng):
    robot = js.StewartGough.prototype()
    base = np.asarray(robot.base) + 1e-3 * rng.normal(size=(6, 3))
    points, frame = 0.1 * rng.normal(size=(4, 3)), np.array([1.0, 0.5, 2.0, 0.3, -0.2, 0.1])
    off = np.array([0.02, -0.03, 0.01, 0.02, 0.01, -0.02])
    poses, zeros = around_home(rng, robot, 40), 1e-3 * rng.normal(size=6)
    readings = hexapod_joints(poses, base, np.asarray(robot.platform)) - zeros
    measured = seen_by_camera(poses, points, frame + off)
    measured[3, :3], measured[7] = np.nan, np.nan  # a marker and a pose that the cameras did not see
    prior = {
        "base": np.repeat([1e-3, 0.0], 3)[:, None],
        "frame": 0.05,
    }  # three joints that are known hold the base frame
    exact = dataclasses.replace(robot, base=np.concatenate([np.asarray(robot.base)[:3], base[3:]]))
    camera = js.calibration.Markers(points, frame)
    found = identify(exact, readings, measured, prior=prior, offsets=1e-3, sigma=1e-8, measure=camera)
    assert found.identifiability.rank == 9 + 6 + 6 and type(found.robot) is js.StewartGough
    assert np.abs(found.robot.base - base).max() < 1e-9 and np.abs(found.offsets - zeros).max() < 1e-9
    assert np.abs(found.measure.frame - frame - off).max() < 1e-9 and np.abs(found.measure.points - points).max() == 0
    assert (found.weights[7] == 0).all() and np.isnan(found.residuals[3, :3]).all()


def heading(robot, pose):
    return pose[2]


def test_angles_alone_do_not_see_the_scale(rng):
    robot = js.NavaroII.prototype(1)  # driven by three angles
    angles = np.asarray(robot.actuated(robot.home()[1])) + 0.1 * rng.uniform(-1, 1, (30, 3))
    found = identifiability(robot, angles, prior={"base": 1.0, "platform": 1.0}, sigma=1e-5, measure=heading)
    scale = np.concatenate([np.ravel(robot.base), np.ravel(robot.platform)])
    scale = scale / np.linalg.norm(scale)
    assert np.linalg.norm(found.directions[: found.rank] @ scale) < 1e-7 < 0.1 < found.directions[0].max()


CASES = {
    "delta": (lambda: js.per_leg(DELTA), {"radius": 1e-2, "rod": 1e-2}, None),
    "navaro": (lambda: js.NavaroII.prototype(6), {"base": 0.1, "platform": 0.1}, js.calibration.Markers()),
    "hexapod": (js.StewartGough.prototype, {"base": 1e-2, "platform": 1e-2}, None),
    "three_prs": (ThreePRS.example, {"rod": 1e-2, "top_radius": 1e-2}, js.calibration.Markers()),
}


@pytest.mark.parametrize("name", ["delta", "navaro", *exhaustive("hexapod", "three_prs")])
def test_derivatives_are_those_of_differences_of_forward_kinematics(name, rng):
    make, prior, measure = CASES[name]
    robot = make()
    joints = np.asarray(robot.actuated(robot.home()[1]))
    readings = joints * (1 + 0.02 * rng.uniform(-1, 1, (3, len(joints))))
    settings = {"prior": prior, "sigma": 1.0, "offsets": 1e-2}
    model = modeled(robot, readings, None, measure=measure, **settings)
    count = len(model.unknowns.names)
    found = model.at(np.zeros(count), starts_of(model, None))
    assert (found.status == js.Status.CONVERGED).all()

    @jax.jit
    def seen(robot, actuated):
        pose = js.forward_kinematics(robot, actuated).value
        return (pose, jnp.zeros(0)) if measure is None else (pose, measure(robot, pose))

    for i, direction in enumerate(1e-3 * np.eye(count)):
        ends = [model.unknowns.applied(model.nominal, s * direction * model.unknowns.prior) for s in (1, -1)]
        for n, joints in enumerate(readings):
            (more, shown), (less, hidden) = (seen(end.robot, joints + end.offsets) for end in ends)
            place = robot.space.place
            change = robot.space.between(place(less), place(more)) if measure is None else shown - hidden
            expected = -np.asarray(change) / 2e-3
            assert np.abs(found.jacobian[n, :, i] - expected).max() < 1e-5 * np.abs(found.jacobian).max(), (i, n)


def test_the_answer_is_scipys(rng):
    """Least squares over the closed form, without the library."""
    radius, rod, offsets = made_delta(rng)
    positions = np.column_stack([in_disc(rng, 12), 0.1 * rng.normal(size=12)])
    readings = delta_joints(positions, radius, rod) - offsets
    measured = positions + 1e-6 * rng.normal(size=positions.shape)
    measured[2, 1] += 1e-4
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": 1e-6}

    def residual(dims):
        return (measured - delta_positions(readings + dims[6:], 0.5 + dims[:3], 1.0 + dims[3:6])).ravel() / 1e-6

    for outlier, loss in ((np.inf, "linear"), (3.0, "huber")):
        found = identify(js.per_leg(DELTA), readings, measured, outlier=outlier, **settings)
        start, tight = np.concatenate([radius - 0.5, rod - 1.0, offsets]), {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-10}
        best = least_squares(residual, start, "3-point", x_scale=1e-3, loss=loss, f_scale=3.0, **tight)
        deviations = np.sqrt(np.diagonal(found.covariance))
        assert found.identifiability.rank == 9
        assert np.abs((found.changes - best.x) / deviations).max() < 1e-2, loss


def trials(robot, readings, shown, noise, dims, count, rng, **settings):
    """Errors of the dimensions and chi-squares of calibrations from measurements drawn at random."""
    errors, chi_squares = [], []
    for _ in range(count):
        found = identify(robot, readings, shown + noise * rng.normal(size=shown.shape), sigma=noise, **settings)
        assert found.ok
        errors.append(found.changes - dims)
        chi_squares.append(found.chi_square)
    return np.array(errors), np.array(chi_squares), found


def assert_consistent(errors, chi_squares, found):
    """Errors as the covariance says, along what is seen, and chi-squares as their degrees of freedom say."""
    seen, count = found.identifiability, len(errors)
    along = errors / seen.prior @ seen.directions[: seen.rank].T
    covariance = seen.directions[: seen.rank] @ (found.covariance / np.outer(seen.prior, seen.prior))
    covariance = covariance @ seen.directions[: seen.rank].T
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), along.T).T
    squares = np.sum(whitened**2)
    assert chi2.ppf(1e-3, whitened.size) < squares < chi2.ppf(1 - 1e-3, whitened.size)
    # the extreme eigenvalues of a sample covariance lie within (1 -+ sqrt(p / n))^2 and a little more
    spread, aspect = np.linalg.eigvalsh(whitened.T @ whitened / count), np.sqrt(seen.rank / count)
    assert spread.max() < (1.25 + aspect) ** 2 and spread.min() > max(0.75 - aspect, 0) ** 2
    total = count * found.degrees
    assert chi2.ppf(1e-3, total) < np.sum(chi_squares) < chi2.ppf(1 - 1e-3, total)


def test_covariance_is_that_of_a_monte_carlo(rng):
    radius, rod, offsets = made_delta(rng)
    positions = np.column_stack([in_disc(rng, 20), 0.1 * rng.normal(size=20)])
    readings = delta_joints(positions, radius, rod) - offsets
    dims = np.concatenate([radius - 0.5, rod - 1.0, offsets])
    settings = {"prior": LENGTHS, "offsets": 1e-3, "outlier": np.inf}
    drawn = trials(js.per_leg(DELTA), readings, positions, 3e-5, dims, 60, rng, **settings)
    assert drawn[-1].identifiability.rank == 9
    assert_consistent(*drawn)


LEGS = ("link_lengths", "actuator_angle", "actuator_radius", "top_radius", "base_offset")
TSE_PRIOR = dict.fromkeys(LEGS, 1e-3) | {"azimuths": 1e-3 * np.eye(3)}


def crooked_extender(rng, prior):
    """The laboratory's robot with dimensions and zeros wrong: joints and poses it takes, errors, and as it was made."""
    robot = js.per_leg(js.TripleScissorExtender.laboratory())
    model = modeled(robot, np.zeros((1, 6)), None, prior=prior, offsets=1e-3, sigma=1.0, measure=None)
    dims = 1e-3 * rng.normal(size=len(model.unknowns.names))
    made = model.unknowns.applied(model.nominal, dims)
    poses = np.asarray(robot.home()[0]) + rng.uniform(-1, 1, (120, 6)) * [0.25, 0.25, 0.25, 0.4, 0.4, 0.4]
    solved = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(made.robot, poses)
    usable = np.flatnonzero(solved.converged)[:40]
    return robot, np.asarray(solved.value)[usable] - np.asarray(made.offsets), poses[usable], dims, made.robot


def test_thirty_errors_of_a_triple_scissor_extender(rng):
    prior = TSE_PRIOR | {"top_offset": 1e-3}
    robot, readings, poses, dims, _ = crooked_extender(rng, prior)
    settings = {"prior": prior, "offsets": 1e-3}
    found = identify(robot, readings, poses, sigma=1e-9, **settings)
    seen = found.identifiability
    assert found.ok and len(readings) == 40 and len(dims) == 33 and seen.rank == 30
    # of the upper bars of a leg only the sum is seen [RAL17 eq. 6]
    assert set(seen.unseen) == {f"link_lengths[1] of leg {i} - link_lengths[2] of leg {i}" for i in (1, 2, 3)}
    assert np.abs(seen.directions[:30] @ (found.changes - dims) / 1e-3).max() < 1e-7
    assert identifiability(robot, readings, sigma=1e-20, **settings).rank == 30  # rounding is not seen, however exact
    noisy = poses + 1e-4 * rng.normal(size=poses.shape)
    found = identify(robot, readings, noisy, sigma=1e-4, **settings)
    assert found.ok and 0.7 < found.chi_square / found.degrees < 1.4
    assert np.sum(in_units(found, dims) ** 2) < 1.1 * chi2.ppf(0.999, found.identifiability.rank)


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", ["poses", "apices"])
def test_a_hundred_calibrations_of_a_triple_scissor_extender(by, rng):
    """With noise so small that all that is seen at all is seen; how high the plate is above its apices they do not see.

    The apices' distances know the difference of two heights of the plate to second order, which a truncated
    decomposition leaves to the prior: in their case those heights are exact.
    """
    prior, measure = TSE_PRIOR | {"top_offset": 1e-3}, None
    if by == "apices":
        prior, measure = TSE_PRIOR, js.calibration.Markers()
    robot, readings, shown, dims, made = crooked_extender(rng, prior)
    if by == "apices":
        shown = np.asarray(jax.vmap(measure, (None, 0))(made, shown))
    settings = {"prior": prior, "offsets": 1e-3, "measure": measure, "outlier": np.inf}
    errors, chi_squares, found = trials(robot, readings, shown, 1e-5, dims, 100, rng, **settings)
    assert found.identifiability.rank == len(dims) - 3 == (30 if by == "poses" else 27)
    assert_consistent(errors, chi_squares, found)


def test_an_outlier_does_not_move_the_answer(rng):
    radius, rod, offsets = made_delta(rng)
    positions = np.column_stack([in_disc(rng, 20), 0.1 * rng.normal(size=20)])
    readings = delta_joints(positions, radius, rod) - offsets
    measured = positions + 3e-5 * rng.normal(size=positions.shape)
    wrong = measured.copy()
    wrong[4, 0], wrong[11, 2] = wrong[4, 0] + 5e-3, wrong[11, 2] - 0.1
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": 3e-5}
    robot = js.per_leg(DELTA)
    clean = identify(robot, readings, measured, **settings)
    deviations = np.sqrt(np.diagonal(clean.covariance))
    robust, plain = (identify(robot, readings, wrong, outlier=c, **settings) for c in (3.0, np.inf))
    assert np.abs((robust.changes - clean.changes) / deviations).max() < 1.5
    assert np.abs((plain.changes - clean.changes) / deviations).max() > 50
    assert robust.weights[4, 0] < 0.05 and robust.weights[11, 2] < 0.01 and (robust.weights < 0.5).sum() == 2
    assert robust.chi_square < clean.chi_square + 25 and "count less" in repr(robust)


def test_what_cannot_be_used_counts_nothing(rng):
    radius, rod, offsets = made_delta(rng)
    positions = np.column_stack([in_disc(rng, 14), 0.1 * rng.normal(size=14)])
    readings = delta_joints(positions, radius, rod) - offsets
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": 1e-5}
    robot = js.per_leg(DELTA)
    good = identify(robot, readings, np.where(np.arange(14)[:, None] < 11, positions, np.nan), **settings)
    readings[11, 0], readings[12] = np.nan, [1.0, 1.0, 9.0]  # no such assembly
    positions[13] = np.nan
    found = identify(robot, readings, positions, **settings)
    assert found.ok and found.pose_status[11] == js.Status.NONFINITE and found.pose_status[12] != js.Status.CONVERGED
    assert found.degrees == good.degrees == 3 * 11 - 9 and (found.weights[11:] == 0).all()
    assert np.abs(found.changes - good.changes).max() < 1e-12
    nothing = identify(robot, readings, np.full_like(positions, np.nan), **settings)
    assert nothing.status == js.Status.NONFINITE and not nothing.changes.any() and not nothing.ok
    assert np.abs(np.sqrt(np.diagonal(nothing.covariance)) - nothing.identifiability.prior).max() < 1e-12
    assert "NONFINITE" in repr(nothing)


def test_measured_poses_choose_the_assembly_mode(rng):
    """Lengths of a planar robot of which the platform is turned by half a turn; from home it is found elsewhere."""
    robot = Planar3RPR.example()
    poses = np.asarray(robot.home()[0]) + [0, 0, np.pi] + 0.05 * rng.uniform(-1, 1, (6, 3))
    turned = np.einsum(
        "nij,lj->nli", [[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in poses[:, 2]], robot.platform
    )
    lengths = np.linalg.norm(poses[:, None, :2] + turned - np.asarray(robot.base), axis=-1)
    zeros = np.array([1e-3, -2e-3, 3e-3])
    found = identify(robot, lengths - zeros, poses, offsets=1e-2, sigma=1e-9)
    assert (found.pose_status == js.Status.CONVERGED).all() and np.abs(found.offsets - zeros).max() < 1e-11
    elsewhere = identify(robot, lengths - zeros, poses, offsets=1e-2, sigma=1e-9, guess=robot.home()[0])
    assert not (elsewhere.ok and elsewhere.chi_square < 100)
    model = modeled(robot, lengths, None, prior=None, offsets=1e-2, sigma=1.0, measure=None)
    starts = starts_of(model, poses)
    assert (model.at(np.zeros(3), starts._replace(signs=-starts.signs)).status == js.Status.OTHER_MODE).all()


def test_of_an_orientation_without_yaw_nothing_counts():
    poses = np.zeros((2, 6))
    poses[0, 5], poses[1, 2] = np.nan, np.inf
    settings = {"prior": 1e-3, "offsets": 0.0, "sigma": 1.0, "measure": None}
    missing = modeled(ThreePRS.example(), np.ones((2, 3)), poses, **settings).missing
    assert missing.tolist() == [[False] * 3 + [True] * 3, [False, False, True] + [False] * 3]


@js.pytree
class BallBar:
    """Distance from a ball on the table, of which nobody knows where it stands."""

    ball: jax.Array

    def __call__(self, robot, pose):
        return jnp.sqrt(jnp.sum((pose - self.ball) ** 2))


def test_a_users_measure_is_calibrated_with_the_robot(rng):
    radius, rod, _ = made_delta(rng)
    positions = np.column_stack([in_disc(rng, 40), 0.2 * rng.normal(size=40)])
    ball = np.array([0.1, -0.2, -0.4])
    readings, measured = delta_joints(positions, radius, rod), np.linalg.norm(positions - ball, axis=1)
    guess = BallBar(jnp.asarray(ball + 0.01))
    prior = LENGTHS | {"ball": 0.05}
    found = identify(js.per_leg(DELTA), readings, measured, prior=prior, sigma=1e-9, measure=guess)
    assert found.ok and found.identifiability.names[-1] == "ball[2]"
    # all legs alike, the table may turn about the axis of the robot, but these do not stand alike
    assert found.identifiability.rank == 9
    assert np.abs(found.measure.ball - ball).max() < 1e-8 and np.abs(found.robot.copies.rod - rod).max() < 1e-8


def test_the_next_poses_are_those_that_add_most_information():
    """Against the determinants of all choices; every one by itself, its singular values say."""
    robot, sigma = js.per_leg(DELTA), 1e-4
    candidates = js.Box([-0.3, -0.3, -0.2], [0.3, 0.3, 0.2]).quasi_random(12)[:]
    joints = delta_joints(np.asarray(candidates), np.full(3, 0.5), np.full(3, 1.0))
    settings = {"prior": LENGTHS, "offsets": 1e-3, "sigma": sigma}
    beyond = jnp.concatenate([candidates, jnp.array([[5.0, 0.0, 0.0]])])
    chosen = js.calibration.next_poses(robot, beyond, count=13, **settings)
    assert sorted(chosen) == [-1, *range(12)] and chosen[-1] == -1

    def information(rows):
        filled = np.full((3, 3), np.nan)
        filled[: len(rows)] = joints[rows]
        return np.sum(np.log1p(identifiability(robot, filled, **settings).singular_values ** 2))

    taken = []
    for k in range(3):
        best = max((i for i in range(12) if i not in taken), key=lambda i: information([*taken, i]))
        assert information([*taken, int(chosen[k])]) > information([*taken, best]) - 1e-9
        taken.append(int(chosen[k]))
    again = js.calibration.next_poses(robot, beyond, count=1, joints=joints[taken], **settings)
    assert again[0] == chosen[3]


def test_one_program_for_every_shape(rng):
    compiled = []

    def listen(event, _, **labels):
        if "backend_compile" in event:
            compiled.append(labels.get("fun_name"))

    robot = js.per_leg(DELTA)
    draws = [printed_and_probed(rng, 1e-5) for _ in range(2)]
    first = identify(robot, *draws[0][:2], prior={"radius": 1e-3}, offsets=1e-3, sigma=1e-5)
    jax.monitoring.register_event_duration_secs_listener(listen)
    again = js.per_leg(LinearDelta(jnp.asarray(0.501), jnp.asarray(1.002)))
    second = identify(again, *draws[1][:2], prior={"rod": 2e-3}, offsets=2e-3, sigma=3e-5, outlier=2.0)
    jax.monitoring.unregister_event_duration_listener(listen)
    assert not compiled and first.identifiability.names != second.identifiability.names


def test_priors_by_name_by_container_and_by_number(rng):
    robot = js.per_leg(DELTA)
    readings = np.tile(robot.home()[1], (2, 1))
    made = js.design.tolerances(DELTA, radius=1e-3, rod=2e-3)
    same = [{"radius": 1e-3, "rod": 2e-3}, made, js.per_leg(made) and dataclasses.replace(robot, copies=made)]
    found = [identifiability(robot, readings, prior=prior, sigma=1e-4) for prior in same]
    assert all((one.prior == [1e-3] * 3 + [2e-3] * 3).all() for one in found)
    assert found[0].names[:2] == ("radius of leg 1", "radius of leg 2")
    shared = identifiability(DELTA, readings, prior=1e-3, offsets=[1e-3, 0.0, 1e-3], sigma=1e-4)
    assert shared.names == ("radius", "rod", "offsets[0]", "offsets[2]")


def test_single_precision_stays_single(rng):
    robot = js.per_leg(jax.tree.map(jnp.float32, DELTA))
    positions = np.column_stack([in_disc(rng, 20), 0.1 * rng.normal(size=20)])
    readings = delta_joints(positions, np.array([0.5, 0.51, 0.5]), np.full(3, 1.0))
    found = identify(robot, readings, positions, prior={"radius": 1e-2}, sigma=1e-4)
    assert found.ok and found.robot.copies.radius.dtype == jnp.float32 == found.offsets.dtype
    assert np.abs(found.changes - [0, 0.01, 0]).max() < 1e-4


def test_what_cannot_be_asked_is_refused():
    robot, joints = js.per_leg(DELTA), np.ones((4, 3))
    refused = {
        "expected \\(n, 3\\)": {"joints": np.ones(3)},
        "expected \\(4, 3\\)": {"measured": np.ones((4, 2))},
        "nothing to calibrate": {"prior": {}},
        "expected one of the dimensions": {"prior": {"rods": 1.0}},
        "expected names": {"prior": [1.0, 2.0]},
        "negative": {"prior": {"rod": -1.0}},
        "not positive": {"sigma": 0.0},
        "broadcasts": {"sigma": np.ones(5)},
        "offsets": {"offsets": np.ones(2)},
        "guess": {"guess": np.ones(4)},
        "outlier": {"outlier": 0.0},
        "shape \\(2, 2\\)": {"measure": lambda robot, pose: jnp.ones((2, 2))},
    }
    for message, change in refused.items():
        given = {"joints": joints, "measured": np.ones((4, 3)), "prior": LENGTHS, "sigma": 1e-3} | change
        with pytest.raises(ValueError, match=message):
            identify(robot, given.pop("joints"), given.pop("measured"), **given)
    with pytest.raises(ValueError, match="points of shape"):
        js.calibration.Markers(np.ones(3))
    with pytest.raises(ValueError, match="expected a pose"):
        js.calibration.Markers(np.ones((2, 2)), np.zeros(6))(Planar3RPR.example(), np.zeros(3))
    with pytest.raises(ValueError, match="at least one"):
        js.calibration.next_poses(robot, np.zeros((3, 3)), count=0, prior=LENGTHS, sigma=1.0)
