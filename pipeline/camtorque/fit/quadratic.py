"""Small quadratic problems within bounds, compiled: a fit solves thousands of them, of 10 to 50 unknowns."""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit


@njit(cache=True, error_model="numpy", nogil=True)
def solve_free(matrix, diagonal, rhs, free, x):  # type: ignore[no-untyped-def]
    """Write into x the solution of ``(M + diag(d)) x = rhs`` in the free unknowns, by symmetric elimination.

    Parameters
    ----------
    matrix : (n, n) symmetric positive definite
    diagonal, rhs, free, x : (n,); x keeps what it holds in the unknowns that are not free
    """
    n = 0
    index = np.empty(free.size, dtype=np.int64)
    for k in range(free.size):
        if free[k]:
            index[n] = k
            n += 1
    work = np.empty((n, n + 1))
    for i in range(n):
        row = matrix[index[i]]
        for k in range(i, n):
            work[i, k] = row[index[k]]
        work[i, i] += diagonal[index[i]]
        work[i, n] = rhs[index[i]]
    for j in range(n):
        top = work[j]
        for i in range(j + 1, n):
            factor = top[i] / top[j]
            row = work[i]
            for k in range(i, n + 1):
                row[k] -= factor * top[k]
    for j in range(n - 1, -1, -1):
        total = work[j, n]
        for k in range(j + 1, n):
            total -= work[j, k] * x[index[k]]
        x[index[j]] = total / work[j, j]


@njit(cache=True, error_model="numpy", nogil=True)
def bounded_quadratic(matrix, vector, lower, upper, start):  # type: ignore[no-untyped-def]
    """Return the minimum of ``c^T M c / 2 - v^T c`` within bounds, by an active set.

    Parameters
    ----------
    matrix : (n, n) symmetric positive definite
    vector, lower, upper : (n,)
    start : (n,) a neighbouring solution: its active bounds are tried first
    """
    n = vector.size
    at, free = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.bool_)
    c, rhs, none = np.zeros(n), np.empty(n), np.zeros(n)
    for k in range(n):
        at[k] = 1 if start[k] >= upper[k] else -1 if start[k] <= lower[k] else 0
    for _ in range(5 * n + 10):
        for k in range(n):
            c[k] = upper[k] if at[k] > 0 else lower[k] if at[k] < 0 else 0.0
        for k in range(n):
            rhs[k] = vector[k]
            for j in range(n):
                if at[j] != 0:
                    rhs[k] -= matrix[k, j] * c[j]
        for k in range(n):
            free[k] = at[k] == 0
        solve_free(matrix, none, rhs, free, c)
        left = False
        for k in range(n):
            if at[k] == 0 and (c[k] < lower[k] or c[k] > upper[k]):
                at[k] = 1 if c[k] > upper[k] else -1
                left = True
        if left:
            continue
        worst, release = 0.0, -1
        for k in range(n):
            if at[k] != 0:
                slope = -vector[k]
                for j in range(n):
                    slope += matrix[k, j] * c[j]
                if at[k] * slope > worst:
                    worst, release = at[k] * slope, k
        if release < 0:
            break
        at[release] = 0
    for k in range(n):
        c[k] = min(max(c[k], lower[k]), upper[k])
    return c


@njit(cache=True, error_model="numpy", nogil=True)
def bounded_step(matrix, diagonal, vector, z, lower, upper):  # type: ignore[no-untyped-def]
    """Return a damped step within bounds and how much it promises: ``2 v^T s - s^T M s``.

    Parameters
    ----------
    matrix : (n, n) normal equations
    diagonal : (n,) damping that is added to their diagonal
    vector : (n,) direction of descent
    z, lower, upper : (n,) where the step begins and bounds, in units of the step
    """
    n = z.size
    free = np.empty(n, dtype=np.bool_)
    step, rhs = np.zeros(n), np.empty(n)
    for k in range(n):
        free[k] = not ((z[k] <= lower[k] and vector[k] < 0.0) or (z[k] >= upper[k] and vector[k] > 0.0))
    for _ in range(8):
        for k in range(n):
            rhs[k] = vector[k]
            for j in range(n):
                if not free[j]:
                    rhs[k] -= matrix[k, j] * step[j]
        solve_free(matrix, diagonal, rhs, free, step)
        over = False
        for k in range(n):
            if free[k] and (z[k] + step[k] < lower[k] or z[k] + step[k] > upper[k]):
                over, free[k] = True, False
        if not over:
            break
        for k in range(n):
            step[k] = min(max(step[k], lower[k] - z[k]), upper[k] - z[k])
    promise = 0.0
    for k in range(n):
        pull = 0.0
        for j in range(n):
            pull += matrix[k, j] * step[j]
        promise += step[k] * (2.0 * vector[k] - pull)
    return step, promise


@njit(cache=True, error_model="numpy", nogil=True)
def weighted_columns(linear, chosen, rest, held, weight):  # type: ignore[no-untyped-def]
    """Return weighted columns of linear parameters, (n, k), and what is left for them to explain, (n,).

    Parameters
    ----------
    linear : (n, m) all columns; chosen : (k,) those wanted
    rest, held, weight : (n,) torque without linear parameters; (m,) coefficients that are held; (n,)
    """
    n, k = rest.size, chosen.size
    columns, target = np.empty((n, k)), np.empty(n)
    for i in range(n):
        total = rest[i]
        for j in range(held.size):
            total -= linear[i, j] * held[j]
        target[i] = total * weight[i]
        for j in range(k):
            columns[i, j] = linear[i, chosen[j]] * weight[i]
    return columns, target


@njit(cache=True, error_model="numpy", nogil=True)
def scaled_columns(derivative, linear, chosen, weight, scale, out):  # type: ignore[no-untyped-def]
    """Write columns of the derivative, then of the linear parameters, times weight and scale.

    Parameters
    ----------
    derivative, linear : (n, m) each; chosen : (k,) those wanted, counted through both
    weight, scale : (n,), (k,)
    out : (n, k + 1) the last column is set to zero
    """
    n, k = weight.size, chosen.size
    first = derivative.shape[1]
    for i in range(n):
        for j in range(k):
            column = chosen[j]
            value = derivative[i, column] if column < first else linear[i, column - first]
            out[i, j] = value * weight[i] * scale[j]
        out[i, k] = 0.0
