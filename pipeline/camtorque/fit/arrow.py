"""Symmetric matrices of many recordings: one small block each, which meet in the shared parameters only.

The sum is an arrow. Its equations are solved, and its inverse is told, by eliminating each recording's own parameters:
time and memory are linear in the number of recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.fit.problem import Indices
from camtorque.records import Array, Mask, ReadOnly

SMALLEST_EIGENVALUE = 1.0e-12
"""Relative to the largest one; what is weaker is no direction in which a step promises anything."""
REGULARISED = 1.0e-12
"""Added to the diagonal of an information matrix in units of itself before it is inverted."""


@dataclass(frozen=True)
class Arrow(ReadOnly):
    """A symmetric matrix that is the sum of one small block a recording and a diagonal.

    places : per recording the indices of its parameters; blocks : (p, p) each; diagonal : (k,)
    recording : (k,) whose own each parameter is, -1: shared
    """

    places: tuple[Indices, ...]
    blocks: tuple[Array, ...]
    diagonal: Array
    recording: Indices

    def main_diagonal(self) -> Array:
        """Return the diagonal of the sum, (k,)."""
        total = self.diagonal.copy()
        for place, block in zip(self.places, self.blocks, strict=True):
            total[place] += np.diag(block)
        return total

    def times(self, vector: Array) -> Array:
        """Return the product with a vector (k,)."""
        total = self.diagonal * vector
        for place, block in zip(self.places, self.blocks, strict=True):
            total[place] += block @ vector[place]
        return total

    def reduced(
        self, index: int, vector: Array, free: Mask, pseudo: bool = False
    ) -> tuple[Indices, Array, Array, Array]:
        """Return a recording's share of the equations of the shared parameters, its own ones eliminated.

        Returns
        -------
        shared, matrix, vector : places of its shared parameters, (s, s), what the vector of those changes by (s,)
        back : (o, s + 1) own parameters = last column - the others @ shared ones
        """
        place, block = self.places[index], self.blocks[index]
        own = (self.recording[place] >= 0) & free[place]
        shared = (self.recording[place] < 0) & free[place]
        cross = block[np.ix_(own, shared)]
        inner = block[np.ix_(own, own)] + np.diag(self.diagonal[place[own]])
        columns = np.column_stack([cross, vector[place[own]]])
        back = _least(inner, columns) if pseudo else np.asarray(np.linalg.solve(inner, columns))
        matrix = block[np.ix_(shared, shared)] - cross.T @ back[:, :-1]
        return place[shared], matrix, -cross.T @ back[:, -1], back

    def solve(self, free: Mask, vector: Array, pseudo: bool = False) -> Array:
        """Return x (k,) with ``M x = vector`` in the free parameters, zero in the others.

        ``pseudo`` leaves directions out that the matrix says nothing of.
        """
        shared = np.flatnonzero((self.recording < 0) & free)
        head, top = np.diag(self.diagonal[shared]), vector[shared].copy()
        backs = []
        for index in range(len(self.places)):
            place, matrix, part, back = self.reduced(index, vector, free, pseudo)
            at = np.searchsorted(shared, place)
            head[np.ix_(at, at)] += matrix
            top[at] += part
            backs.append((place, back))
        x = np.zeros(vector.size)
        x[shared] = _least(head, top) if pseudo else np.linalg.solve(head, top)
        for place, (used, back) in zip(self.places, backs, strict=True):
            own = place[(self.recording[place] >= 0) & free[place]]
            x[own] = back[:, -1] - back[:, :-1] @ x[used]
        return x


def _least(matrix: Array, right: Array) -> Array:
    """Return the shortest x of least ``|M x - right|``, whatever the units of M (symmetric)."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    column = scale.reshape(-1, *[1] * (right.ndim - 1))
    with np.errstate(over="ignore", invalid="ignore"):
        scaled, goal = matrix * np.outer(scale, scale), column * right
    if not (np.all(np.isfinite(scaled)) and np.all(np.isfinite(goal))):
        raise np.linalg.LinAlgError("a matrix far from anything physical is not finite")
    return np.asarray(column * np.linalg.lstsq(scaled, goal, rcond=SMALLEST_EIGENVALUE)[0])


@dataclass(frozen=True)
class ArrowCovariance(ReadOnly):
    """A covariance as an arrow has it: own parameters are a linear function of the shared ones, and a rest.

    The rest of one recording has nothing to do with that of another.

    Attributes
    ----------
    shared : (s,) places of the shared parameters; matrix : (s, s) their covariance
    own : per recording the places of its own parameters (o,)
    through : per recording (o, s) how they follow the shared ones; rest : (o, o) covariance of what does not
    """

    shared: Indices
    matrix: Array
    own: tuple[Indices, ...] = ()
    through: tuple[Array, ...] = ()
    rest: tuple[Array, ...] = ()

    @classmethod
    def whole(cls, matrix: Array) -> ArrowCovariance:
        """Return the covariance of parameters of which none is a recording's own."""
        return cls(np.arange(len(matrix)), matrix)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.shared.size + sum(place.size for place in self.own))

    @property
    def std(self) -> Array:
        """Standard deviations, (k,)."""
        variance = np.zeros(self.size)
        variance[self.shared] = np.diag(self.matrix)
        for place, through, rest in zip(self.own, self.through, self.rest, strict=True):
            variance[place] = np.einsum("ij,jk,ik->i", through, self.matrix, through) + np.diag(rest)
        return np.sqrt(variance)

    def times(self, vector: Array) -> Array:
        """Return the product with a vector (k,)."""
        shared = vector[self.shared].copy()
        for place, through in zip(self.own, self.through, strict=True):
            shared += through.T @ vector[place]
        total = np.zeros(self.size)
        total[self.shared] = shared = self.matrix @ shared
        for place, through, rest in zip(self.own, self.through, self.rest, strict=True):
            total[place] = through @ shared + rest @ vector[place]
        return total

    def of(self, recording: int) -> tuple[Indices, Array]:
        """Return the places of the shared parameters and of a recording's own (m,), and their covariance (m, m)."""
        weight = np.vstack([np.eye(self.shared.size), self.through[recording]])
        matrix = weight @ self.matrix @ weight.T
        matrix[self.shared.size :, self.shared.size :] += self.rest[recording]
        return np.concatenate([self.shared, self.own[recording]]), matrix

    def among(self, index: Sequence[int] | Indices) -> Array:
        """Return the covariance of some parameters (m, m), own ones of several recordings among them."""
        chosen = np.asarray(index, dtype=np.int64)
        weight, rest = np.zeros((chosen.size, self.shared.size)), np.zeros((chosen.size, chosen.size))
        for row, column in zip(*np.nonzero(chosen[:, None] == self.shared), strict=True):
            weight[row, column] = 1.0
        for place, through, alone in zip(self.own, self.through, self.rest, strict=True):
            found = chosen[:, None] == place
            rows, inside = np.nonzero(found)
            if rows.size:
                weight[rows] = through[inside]
                rest[np.ix_(rows, rows)] = alone[np.ix_(inside, inside)]
        return np.asarray(weight @ self.matrix @ weight.T + rest)


def arrow_inverse(matrix: Arrow) -> ArrowCovariance:
    """Return the inverse of a positive definite arrow of badly mixed units."""
    scale = 1.0 / np.sqrt(matrix.main_diagonal())
    recording = matrix.recording
    shared = np.flatnonzero(recording < 0)
    head = np.diag(matrix.diagonal[shared] * scale[shared] ** 2 + REGULARISED)
    found = []
    for place, block in zip(matrix.places, matrix.blocks, strict=True):
        scaled, mine = block * np.outer(scale[place], scale[place]), recording[place] >= 0
        own, other = place[mine], np.searchsorted(shared, place[~mine])
        inner = scaled[np.ix_(mine, mine)] + np.diag(matrix.diagonal[own] * scale[own] ** 2 + REGULARISED)
        cross, alone = scaled[np.ix_(mine, ~mine)], np.linalg.inv(inner)
        head[np.ix_(other, other)] += scaled[np.ix_(~mine, ~mine)] - cross.T @ alone @ cross
        found.append((own, other, -alone @ cross, alone))
    owns, through, rest = [], [], []
    for place, other, back, alone in found:
        full = np.zeros((place.size, shared.size))
        full[:, other] = back
        owns.append(place)
        through.append(full * scale[place][:, None] / scale[shared])
        rest.append(alone * np.outer(scale[place], scale[place]))
    top = np.linalg.inv(head) * np.outer(scale[shared], scale[shared])
    return ArrowCovariance(shared, top, tuple(owns), tuple(through), tuple(rest))
