"""Independent solutions, in numpy and scipy alone, that the library is compared with."""

import numpy as np


def apices(ratios, poses):
    """Local apex coordinates (x, y, z) of the three legs of a unit-length TSE [RAL17 eq. 3], three of ``(3, n)``."""
    _, _, k3, k4 = ratios
    x, y, z, roll, pitch, yaw = np.asarray(poses).T
    one, none = np.ones_like(x), np.zeros_like(x)
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    about_x = np.array([[one, none, none], [none, cr, -sr], [none, sr, cr]])
    about_y = np.array([[cp, none, sp], [none, one, none], [-sp, none, cp]])
    about_z = np.array([[cy, -sy, none], [sy, cy, none], [none, none, one]])
    rotation = np.einsum("ijn,jkn,kln->iln", about_x, about_y, about_z)
    legs = []
    for azimuth in 2 * np.pi * np.arange(3) / 3:
        c, s = np.cos(azimuth), np.sin(azimuth)
        apex = np.array([x, y, z]) + k4 * (rotation[:, 0] * c + rotation[:, 1] * s)
        apex -= k3 * np.array([[c], [s], [0]])
        legs.append(np.array([apex[0] * s - apex[1] * c, apex[0] * c + apex[1] * s, apex[2]]))
    return legs


def quartic_joints(ratios, apex):
    """All roots of one leg by companion-matrix eigenvalues of its quartic in u = p - 2 y sin(eta).

    Returns (s_A, s_B), whether the root is real, u, and the determinant d(eq. 10, eq. 13)/d(p, m), each ``(n, 4)``.
    """
    k1, eta = ratios[:2]
    x, y, z = apex
    c, s, k = np.cos(eta), np.sin(eta), 1 / (4 * k1**2)
    a, b = 2 * y * s, 2 * x * c
    p2, m2 = s * s / 4 + k * c * c, c * c / 4 + k * s * s
    linear, constant = (2 * p2 - 0.5) * a, x * x + y * y + z * z - 1 + (p2 - 0.5) * a**2 + (m2 - 0.5) * b**2
    beta, gamma = (2 * m2 - 0.5) * a * b**2, m2 * a**2 * b**2
    companion = np.zeros((len(x), 4, 4))
    for column, coefficient in enumerate((linear, constant, beta, gamma)):
        companion[:, 0, column] = -coefficient / p2
    companion[:, [1, 2, 3], [0, 1, 2]] = 1
    u = np.linalg.eigvals(companion)
    real = np.abs(u.imag) < 1e-7 * np.maximum(1e-3, np.abs(u))
    u = u.real
    linear, constant, beta, gamma, a, b = (v[:, None] for v in (linear, constant, beta, gamma, a, b))
    for _ in range(3):
        value = (((p2 * u + linear) * u + constant) * u + beta) * u + gamma
        slope = ((4 * p2 * u + 3 * linear) * u + 2 * constant) * u + beta
        step = value / np.where(slope == 0, 1, slope)
        u = u - np.where(np.abs(step) < 1e-3, step, 0)
    with np.errstate(all="ignore"):
        p, m = u + a, b + a * b / u
        determinant = -u * (2 * p2 * u + linear - beta / u**2 - 2 * gamma / u**3)
    return np.stack([(p + m) / 2, (p - m) / 2], axis=-1), real, u, determinant


def continue_from_home(ratios, start_apex, joints, apex, steps=400):
    """Follow the closure of one leg along the straight line between two apices; ``None`` if it folds."""
    k1, eta = ratios[:2]
    c, s, k = np.cos(eta), np.sin(eta), 1 / (4 * k1**2)

    def equations(q, r):
        p, m = q[0] + q[1], q[0] - q[1]
        a, b = 2 * r[1] * s, 2 * r[0] * c
        p2, m2 = s * s / 4 + k * c * c, c * c / 4 + k * s * s
        values = np.array([m * (p - a) - b * p, r @ r - (p * a + m * b) / 2 + p2 * p * p + m2 * m * m - 1])
        by_p, by_m = np.array([m - b, 2 * p2 * p - a / 2]), np.array([p - a, 2 * m2 * m - b / 2])
        return values, np.stack([by_p + by_m, by_p - by_m], axis=-1)

    q = np.array(joints, float)
    sign = np.sign(np.linalg.det(equations(q, start_apex)[1]))
    for t in np.linspace(0, 1, steps + 1)[1:]:
        r = (1 - t) * start_apex + t * apex
        for _ in range(30):
            values, jacobian = equations(q, r)
            if np.abs(values).max() < 1e-13:
                break
            step = np.linalg.solve(jacobian, values)
            if np.abs(step).max() > 0.2:
                return None
            q = q - step
        values, jacobian = equations(q, r)
        if np.abs(values).max() > 1e-10 or np.sign(np.linalg.det(jacobian)) != sign:
            return None
    return q
