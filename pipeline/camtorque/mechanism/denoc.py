"""The mechanism in the matrix form of the paper: decoupled natural orthogonal complements of the cut mechanism.

The loop is cut at the contact Q of cam and roller. Sub-system I is the camshaft, one link per lobe, joined by revolute
joints; sub-system II of each pump is the follower (prismatic along Y1) that carries the roller (revolute at O2)::

    M t' + W M E t = w                                   free bodies, equation (1)
    t = N qdot,  N = N_l N_d                             equation (3)
    N^T (M t' + W M E t) = N^T w^e + N^T w^lambda        equation (4) with the wrench at the cut

Twists are t_i = [omega_i; v_i], wrenches w_i = [n_i; f_i], six entries, referred to the mass centre of each link. The
arrays carry the cam angle as their first axis. Everything is in the frame that runs with the cam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.kinematics import Kinematics
from camtorque.mechanism.mounting import Mounting, assumed_roller, moving_mass
from camtorque.records import Array

AXIS_Y = np.array([0.0, 1.0, 0.0])
REVOLUTE, PRISMATIC = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
"""Joint-motion vectors p: revolute about Z at the mass centre, [e; e x d] with d = 0; prismatic along Y1, [0; e]."""


def cross_matrix(vector: Array) -> Array:
    """Return the 3 x 3 matrix of the cross product with a vector (leading axes allowed)."""
    x, y, z = np.moveaxis(np.asarray(vector), -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)


def twist_propagation(arm: Array) -> Array:
    """Return B_ij = [[1, 0], [a_ij x 1, 1]], which carries a twist from link j to link i (a_ij from i to j)."""
    matrix = np.eye(6)
    matrix[3:, :3] = cross_matrix(arm)
    return matrix


@dataclass(frozen=True)
class Chain:
    """An open serial chain: N = N_l N_d (6n x n), M (6n x 6n) and E (6n x 6n).

    The axes keep their direction and the arms are zero (links share the cam axis; the roller sits at the follower's
    reference point O2), so that none of them depends on the angle.
    """

    complement: Array
    mass: Array
    coupling: Array

    @property
    def size(self) -> int:
        """Return the number of links."""
        return self.complement.shape[1]


def build_chain(joints: list[Array], masses: list[float], inertias: list[float]) -> Chain:
    """Return the chain of links with these joint-motion vectors, masses [kg] and moments of inertia about Z."""
    size = len(joints)
    lower = np.asarray(np.kron(np.tril(np.ones((size, size))), twist_propagation(np.zeros(3))), dtype=np.float64)
    motion = np.zeros((6 * size, size))
    mass, coupling = np.zeros((6 * size, 6 * size)), np.zeros((6 * size, 6 * size))
    for i, (joint, m, inertia) in enumerate(zip(joints, masses, inertias, strict=True)):
        link = slice(6 * i, 6 * i + 6)
        motion[link, i] = joint
        # a planar motion sees I_zz alone; the other two are set equal so that M stays positive
        mass[link, link] = np.diag([inertia] * 3 + [m] * 3)
        coupling[link, link] = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return Chain(lower @ motion, mass, coupling)


def camshaft_chain(pumps: list[PumpData]) -> Chain:
    """Return sub-system I: one link per lobe, each with the mass and inertia of its cam."""
    return build_chain([REVOLUTE] * len(pumps), [p.cam_mass for p in pumps], [p.cam_inertia for p in pumps])


def follower_chain(pump: PumpData, mounting: Mounting) -> Chain:
    """Return sub-system II of one pump: follower (spring third included), then roller."""
    roller = assumed_roller(pump)
    follower = moving_mass(pump, mounting) - roller.mass
    # the follower does not turn; any positive inertia keeps M positive and drops out
    return build_chain([PRISMATIC, REVOLUTE], [follower, roller.mass], [roller.inertia, roller.inertia])


def angular_velocity_matrix(twist: Array) -> Array:
    """Return W = diag(omega_i x, 0) of the links, (n_theta, 6n, 6n)."""
    count, size = twist.shape
    matrix = np.zeros((count, size, size))
    for i in range(0, size, 6):
        matrix[:, i : i + 3, i : i + 3] = cross_matrix(twist[:, i : i + 3])
    return matrix


def inertia_wrench(chain: Chain, rate: Array, rate_change: Array) -> Array:
    """Return M t' + W M E t for joint rates and their derivatives (n_theta, n), as (n_theta, 6n)."""
    twist = rate @ chain.complement.T
    # N is constant here, so t' = N qddot
    twist_rate = rate_change @ chain.complement.T
    gyroscopic = angular_velocity_matrix(twist) @ chain.mass @ chain.coupling @ twist[:, :, None]
    return twist_rate @ chain.mass.T + gyroscopic[:, :, 0]


def point_force(arm: Array, force: Array) -> Array:
    """Return the wrench [arm x f; f] of a force that acts at an arm from the mass centre, (n_theta, 6)."""
    return np.concatenate([np.cross(arm, force), force], axis=-1)


def follower_rates(path: Kinematics, speed: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the rates (sdot, omega_2) of sub-system II and their derivatives from loop closure, (n_theta, 2)."""
    rate = np.stack([path.velocity * speed, path.roller_ratio * speed], axis=-1)
    change = np.stack(
        [
            path.acceleration * speed**2 + path.velocity * acceleration,
            path.roller_ratio_slope * speed**2 + path.roller_ratio * acceleration,
        ],
        axis=-1,
    )
    return rate, change


def external_wrench(chain: Chain, force_along: Array, gravity: Array) -> Array:
    """Return w^e of sub-system II: weights, and spring and fluid along Y1 on the follower, (n_theta, 12)."""
    wrench = np.zeros((force_along.size, 6 * chain.size))
    for i in range(chain.size):
        wrench[:, 6 * i + 3 : 6 * i + 6] = chain.mass[6 * i + 3, 6 * i + 3] * gravity
    wrench[:, 4] += force_along
    return wrench


def cut_wrench_basis(arm: Array) -> Array:
    """Return the wrench on the roller per unit lambda_x and lambda_y at the cut, (n_theta, 12, 2)."""
    columns = []
    for axis in (np.array([1.0, 0.0, 0.0]), AXIS_Y):
        wrench = point_force(arm, np.broadcast_to(axis, arm.shape))
        columns.append(np.concatenate([np.zeros_like(wrench), wrench], axis=-1))
    return np.stack(columns, axis=-1)


def lagrange_multipliers(chain: Chain, inertia: Array, external: Array, basis: Array) -> Array:
    """Solve N^T (M t' + W M E t - w^e) = N^T A lambda for the two multipliers of one pump, (n_theta, 2)."""
    complement = chain.complement
    free = ((inertia - external) @ complement)[:, :, None]
    return np.asarray(np.linalg.solve(complement.T @ basis, free)[:, :, 0], dtype=np.float64)


def joint_reactions(chain: Chain, inertia: Array, applied: Array) -> Array:
    """Return the wrench on each link at its joint, from the free bodies, outermost first, (n_theta, n, 6).

    w^c_i = (M t' + W M E t)_i - w^e_i + w^c_(i+1); the arms between the links are zero, so B^T is the identity.
    """
    bodies = (inertia - applied).reshape(inertia.shape[0], chain.size, 6)
    return np.cumsum(bodies[:, ::-1], axis=1)[:, ::-1]
