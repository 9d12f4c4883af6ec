"""A plane frame by the direct stiffness method, in NumPy alone: what bars in pins are compared with."""

import itertools

import numpy as np


class Frame:
    """Bars of straight beam elements; any displacement may be tied to another or held, by multipliers.

    Degrees of freedom are (along x, along y, turn) per node of every bar, numbered by ``dof``.
    """

    def __init__(self, bars, axial, bending):
        self.bars = [np.asarray(bar, float) for bar in bars]
        self.first = np.cumsum([0, *(3 * len(bar) for bar in self.bars)])
        size = self.first[-1]
        self.stiffness, self.loads, self.rows = np.zeros((size, size)), np.zeros(size), []
        self.elements = []
        for number, bar in enumerate(self.bars):
            for node, (p, q) in enumerate(itertools.pairwise(bar)):
                length, (c, s) = np.linalg.norm(q - p), (q - p) / np.linalg.norm(q - p)
                a, b = axial / length, bending / length**3
                local = np.array([
                    [a, 0, 0, -a, 0, 0],
                    [0, 12 * b, 6 * b * length, 0, -12 * b, 6 * b * length],
                    [0, 6 * b * length, 4 * b * length**2, 0, -6 * b * length, 2 * b * length**2],
                    [-a, 0, 0, a, 0, 0],
                    [0, -12 * b, -6 * b * length, 0, 12 * b, -6 * b * length],
                    [0, 6 * b * length, 2 * b * length**2, 0, -6 * b * length, 4 * b * length**2],
                ])  # fmt: skip
                turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
                at = np.arange(6) + self.dof(number, node, 0)
                self.stiffness[np.ix_(at, at)] += turn.T @ local @ turn
                self.elements.append((number, at, turn, local, length, np.zeros(6)))

    def dof(self, bar, node, component):
        return self.first[bar] + 3 * node + component

    def hold(self, one, other=None):
        row = np.zeros(self.first[-1])
        row[one] = 1
        if other is not None:
            row[other] = -1
        self.rows.append(row)

    def pin(self, bar, node, other, other_node):
        for component in (0, 1):
            self.hold(self.dof(bar, node, component), self.dof(other, other_node, component))

    def spread(self, weights):
        """Weight of every bar, spread evenly along it."""
        for number, at, turn, _, length, load in self.elements:
            bar = self.bars[number]
            whole = np.sum(np.linalg.norm(np.diff(bar, axis=0), axis=1))
            along, across = turn[:2, :2] @ weights[number] * length / whole
            load += [along / 2, across / 2, across * length / 12, along / 2, across / 2, -across * length / 12]
            self.loads[at] += turn.T @ load

    def solve(self):
        """Displacements, and the multipliers: what holds and ties exert, in the order in which they were made."""
        rows = np.array(self.rows)
        whole = np.block([[self.stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        found = np.linalg.solve(whole, np.concatenate([self.loads, np.zeros(len(rows))]))
        return found[: len(self.loads)], found[len(self.loads) :]

    def greatest(self, shifts, area, modulus):
        """Of every bar, at the ends of its elements: the greatest axial force, moment and normal stress."""
        axial, bending, stress = np.zeros((3, len(self.bars)))
        for number, at, turn, local, _, load in self.elements:
            ends = local @ (turn @ shifts[at]) - load
            for force, moment in ((-ends[0], ends[2]), (ends[3], ends[5])):
                axial[number] = max(axial[number], force, key=abs)
                bending[number] = max(bending[number], abs(moment))
                stress[number] = max(stress[number], abs(force) / area + abs(moment) / modulus)
        return axial, bending, stress
