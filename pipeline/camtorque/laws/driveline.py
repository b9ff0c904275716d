"""Driveline: the shaft twists, the drive is not infinitely heavy, and the transducer sits between them.

The trigger sits on the camshaft, so the cam angle is known at its edge and only there. Between edges (the correction
enters once, here), with T the torque of the shaft, which the transducer measures, and s = i w::

    theta = theta_nominal + d_trigger + psi - psi(edge),   psi = -C(s) T
    C(s)  = C_t / (1 + 2 zeta_t s/w_t) + a / (s^2 + w_b (s + r) / (1 + T_c s))
                            + (1/k_c) w_c^2 / (s^2 + 2 zeta_c w_c s + w_c^2)

The first term is the shaft, of compliance C_t = 1/k_t; with the inertia I_c between transducer and cam it rings at
w_t = (I_c C_t)^-1/2 with damping ratio zeta_t. The ringing tells w_t and zeta_t, not I_c and the damping c_t, so those
are the parameters: ``I_c = 1/(w_t^2 C_t)``, ``c_t = 2 zeta_t/(w_t C_t)``. The second is a drive of inertia
J = 1/a on a speed controller with proportional gain
``K_p = J w_b``, integral gain ``K_i = K_p r`` and lag T_c; a flywheel or an induction machine over its slip is the
same with w_b, r small. The third is a hub on a yielding coupling between drive and transducer; far below w_c it is
more compliance.

Before the transducer a coupling has a half of its own: with its inertia I_h a share h of the shaft's compliance lies
between it and the cam, in an elastomer or in steel, so that its damping time is q times that of the rest; 2 zeta_t/w_t
is the mean of both by their shares. With B(s) the compliance from the drive up to it and C_2(s) from there to the cam,
C_2 = h C_t / (1 + q/(1 - h + h q) 2 zeta_t s/w_t)::

    C = B + C_2 (1 + I_h s^2 B),   shaft torque / load = 1 / (1 + I_h s^2 B + I_c s^2 C)

for the transducer feels what both inertias leave of the load; without a half, I_h = 0, that is C above and
``1 / (1 + I_c s^2 C(s))``.

w_b, r and T_c act through their logarithms (they are scales without a zero); where the recording's [drive] table knows
inertia or loop, that is the prior. Sources: servo drives close their speed loop at 1-60 Hz with a reset time of 20 ms
to 1 s; hubs of 0.1-3 g m^2 on couplings swing at 40-400 Hz; torsion of shafts is damped by 0.2-10 % of critical.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camtorque.compiled import njit
from camtorque.laws.rows import parameter
from camtorque.records import Array
from camtorque.units import DEGREE

ROWS = (
    parameter("trigger_offset", "d_trigger", "deg", DEGREE, (0.0, -4.0, 4.0, 0.1), (0.0, 0.866),
            "cam angle of trigger edge minus its nominal value", "installation tolerance of the sheet, rectangular"),
    parameter("shaft_compliance", "C_t", "urad/(N m)", 1.0e-6, (150.0, 4.0, 2500.0, 30.0), (150.0, 250.0),
            "twist per torque between drive and cam", "shafts of 15-30 mm: 2000-50000 N m/rad"),
    parameter("shaft_damping_ratio", "zeta_t", "-", 1.0, (0.08, 0.005, 2.0, 0.03), (0.08, 0.10),
            "damping ratio of the shaft's torsion", "0.2-20 % of critical, bearings included"),
    parameter("shaft_resonance", "w_t", "Hz", 2.0 * np.pi, (1200.0, 60.0, 9000.0, 100.0), (1200.0, 1200.0),
            "frequency at which the cam's side rings on the shaft",
            "camshaft and coupling of 0.05-2 g m^2 on such a shaft"),
    parameter("drive_admittance", "1/J", "1/(kg m^2)", 1.0, (1.0, 0.0, 60.0, 1.0), (0.0, 12.0),
            "inverse of the drive's inertia; 0 for a drive that holds its speed", "drives of 0.03 kg m^2 and more"),
    parameter("drive_bandwidth", "ln w_b", "ln(rad/s)", 1.0, (3.5, -4.0, 8.0, 0.3), (3.5, 1.8),
            "logarithm of the drive's proportional gain over its inertia", "speed loops of 0.5-60 Hz, or slip"),
    parameter("drive_reset", "ln r", "ln(1/s)", 1.0, (1.6, -3.0, 6.0, 0.4), (1.6, 1.5),
            "logarithm of the inverse reset time of the drive's controller", "20 ms to some seconds, or none"),
    parameter("drive_lag", "ln T_c", "ln(s)", 1.0, (-6.5, -11.0, -3.0, 0.4), (-6.5, 1.3),
            "logarithm of the lag of the drive's torque", "current loops and filters: 0.2-10 ms"),
)  # fmt: skip
COUPLING_ROWS = (
    parameter("coupling_compliance", "1/k_c", "urad/(N m)", 1.0e-6, (0.0, 0.0, 5000.0, 50.0), (0.0, 600.0),
            "compliance of the coupling between drive and transducer", "catalogues of couplings: 500-50000 N m/rad"),
    parameter("coupling_resonance", "w_c", "Hz", 2.0 * np.pi, (120.0, 12.0, 4000.0, 8.0), (120.0, 120.0),
            "frequency at which the hub on the coupling swings", "0.1-10 g m^2 on such a coupling"),
    parameter("coupling_damping", "zeta_c", "-", 1.0, (0.1, 0.01, 1.5, 0.03), (0.1, 0.15),
            "damping ratio of the swing of the hub on the coupling", "elastomer couplings: 0.05-0.15"),
    parameter("half_inertia", "I_h", "kg mm^2", 1.0e-6, (0.0, 0.0, 40000.0, 200.0), (0.0, 1000.0),
            "inertia of the coupling's half between transducer and coupling",
            "catalogues: halves of couplings for 30-300 N m have 50-2000 kg mm^2"),
    parameter("half_place", "h", "-", 1.0, (0.6, 0.0, 1.0, 0.1), (0.6, 0.3),
            "share of the shaft's compliance between coupling half and cam",
            "couplings yield more than transducers, and less where they are stiff"),
    parameter("half_damping", "ln q", "ln(1)", 1.0, (0.0, -4.0, 4.0, 0.3), (0.5, 1.0),
            "logarithm of the damping time between half and cam over that of the rest of the shaft",
            "elastomers are damped up to ten times as much as steel, steel couplings as much"),
)  # fmt: skip

TWIST_BANDWIDTH_HZ = 2500.0
"""Above this the measured torque holds no twist, only noise; a smooth roll-off of order 8."""


RIGID = 1.0e-9
"""Compliance below which a shaft counts as rigid [rad/(N m)]."""
HIGHEST_HZ = 6000.0
"""Harmonics above this are left out altogether."""


@dataclass(frozen=True)
class TwistBasis:
    """What the measured torque says about the cam angle, before stiffness and drive are known.

    Attributes
    ----------
    spectrum : (k,) harmonics of the shaft's torque, noise rolled off
    omega : (k,) their angular frequencies [rad/s]
    n_theta : points of the grid
    phase : (k,) factors whose products with the harmonics of a real signal sum to n_theta times its value at the edge
    """

    spectrum: NDArray[np.complex128]
    omega: Array
    n_theta: int
    phase: NDArray[np.complex128]


def twist_basis(shaft_torque: Array, speed: float, trigger_angle: float, seen: int) -> TwistBasis:
    """Return the basis of a mean cycle of the shaft's torque (n,) [N m] at a speed [rad/s].

    A wheel on the camshaft has measured the angle up to the order ``seen``: only what is above is rebuilt.
    """
    highest = min(shaft_torque.size // 2, int(np.ceil(2.0 * np.pi * HIGHEST_HZ / speed)))
    omega = np.asarray(np.arange(highest + 1) * speed, dtype=np.float64)
    roll_off = 1.0 / np.sqrt(1.0 + (omega / (2.0 * np.pi * TWIST_BANDWIDTH_HZ)) ** 8)
    spectrum = np.fft.rfft(shaft_torque)[: highest + 1] * roll_off
    spectrum[: seen + 1] = 0.0
    phase = np.exp(1j * np.arange(omega.size) * trigger_angle)
    phase[1:] *= 2.0
    phase *= seen == 0  # a wheel has its zero from all of its teeth, not from one edge
    return TwistBasis(spectrum, omega, shaft_torque.size, phase)


COUPLING_NAMES = tuple(row.name for row in COUPLING_ROWS)
HALF_NAMES = COUPLING_NAMES[3:]
COMPLIANCE_NAMES = (*(row.name for row in ROWS[1:]), *COUPLING_NAMES)
"""Parameters of C(s), in the order of its derivatives: the first three and the last three are those of the shaft."""


def compliance(omega: Array, values: Mapping[str, float], tangents: bool) -> NDArray[np.complex128]:
    """Return C(s) on harmonics (k,) [rad/(N m)], then its derivatives by `COMPLIANCE_NAMES`, (k, 14) or (k, 1).

    The mean torque turns nothing that a trigger on the camshaft could see: the drive's term is zero at w = 0.
    """
    return compliances(omega, np.array([values[name] for name in COMPLIANCE_NAMES]), tangents)  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy")
def inverse(value):  # type: ignore[no-untyped-def]
    """Return one over a complex number far from overflow; a compiled division minds it, at ten times the cost."""
    share = 1.0 / (value.real * value.real + value.imag * value.imag)
    return complex(value.real * share, -value.imag * share)


@njit(cache=True, error_model="numpy")
def damping_shares(place, ln_longer):  # type: ignore[no-untyped-def]
    """Return the damping time behind the coupling's half and the mean of both, as multiples of that before it."""
    longer = np.exp(ln_longer)
    return longer, 1.0 - place + place * longer


@njit(cache=True, error_model="numpy", nogil=True)
def compliances(omega, values, tangents):  # type: ignore[no-untyped-def]
    """Return C(s), then its derivatives where asked for, (k, 14) or (k, 1); values in the order of the names."""
    shaft, damping, ringing, admittance, ln_band, ln_reset, ln_lag, soft, resonance, ratio, half, place, ln_longer = (
        values
    )
    band, reset, lag = np.exp(ln_band), np.exp(ln_reset), np.exp(ln_lag)
    longer, mean = damping_shares(place, ln_longer)
    per_damping = 2.0 / (ringing * mean)
    time = per_damping * damping
    before, after = (1.0 - place) * shaft, place * shaft
    both = np.empty((omega.size, 14 if tangents else 1), dtype=np.complex128)
    for k in range(omega.size):
        s = 1j * omega[k]
        slowed, slowed_after = inverse(1.0 + time * s), inverse(1.0 + longer * time * s)
        late = inverse(1.0 + lag * s)
        driven = band * (s + reset) * late
        response, swing = 0.0 * s, 0.0 * s
        if k > 0:
            response = inverse(s * s + driven)
            swing = inverse(s * s + 2.0 * ratio * resonance * s + resonance * resonance)
        row = both[k]
        behind = admittance * response + soft * resonance * resonance * swing + before * slowed
        beyond = after * slowed_after
        inertia = half * s * s
        by_behind, by_beyond = 1.0 + inertia * beyond, 1.0 + inertia * behind
        row[0] = behind + beyond * by_beyond
        if not tangents:
            continue
        square = -admittance * response * response
        squared = swing * swing
        by_resonance = -2.0 * (ratio * s + resonance) * squared
        bent = by_behind * before * s * slowed * slowed
        bent_after = by_beyond * after * longer * s * slowed_after * slowed_after
        row[1] = by_behind * (1.0 - place) * slowed + by_beyond * place * slowed_after
        row[2] = -per_damping * (bent + bent_after)
        row[3] = -damping / ringing * row[2]
        row[4], row[5], row[6] = response, square * driven, square * band * reset * late
        row[7] = -square * driven * late * lag * s
        row[8] = resonance * resonance * swing
        row[9] = soft * (2.0 * resonance * swing + resonance * resonance * by_resonance)
        row[10] = -soft * resonance * resonance * 2.0 * resonance * s * squared
        for j in range(4, 11):
            row[j] *= by_behind
        row[11] = s * s * beyond * behind
        row[12] = shaft * (by_beyond * slowed_after - by_behind * slowed) - damping * (longer - 1.0) / mean * row[2]
        row[13] = time / mean * (place * longer * bent - (1.0 - place) * bent_after)
    return both


def angle_shifts(basis: TwistBasis, both: Any) -> tuple[Array, Array, Array]:
    """Return psi - psi(edge), with its first two angle derivatives.

    Parameters
    ----------
    both : (at least k, m) C(s) in column 0, then its derivatives; on the harmonics from 0

    Returns
    -------
    shift, rate, second : (n, m) each; column 0 the shift itself, then its derivatives by the parameters
    """
    n = basis.n_theta
    spectra, at_edge = shift_spectra(basis.spectrum, basis.phase, both, n // 2 + 1)
    shift, rate, second = np.fft.irfft(spectra, n, axis=1)
    shift -= at_edge / n
    return shift, rate, second


@njit(cache=True, error_model="numpy", nogil=True)
def shift_spectra(spectrum, phase, both, size):  # type: ignore[no-untyped-def]
    """Return the harmonics of the twist and of its two angle derivatives, (3, size, m), its sums at the edge, (m,)."""
    m = both.shape[1]
    out = np.zeros((3, size, m), dtype=np.complex128)
    at_edge = np.zeros(m)
    for k in range(spectrum.size):
        for j in range(m):
            value = -spectrum[k] * both[k, j]
            out[0, k, j] = value
            out[1, k, j] = 1j * k * value
            out[2, k, j] = -float(k) * k * value
            at_edge[j] += (value * phase[k]).real
    return out, at_edge


SHAFT_NAMES = ("shaft_compliance", "shaft_resonance", "shaft_damping_ratio")
FOLLOWING: dict[str, tuple[float, str, str, str, tuple[float, float, float]]] = {
    "cam_side_inertia": (
        1.0e-6, "kg mm^2", "I_c", "inertia between transducer and cam, camshaft included", (-1.0, -2.0, 0.0)),
    "shaft_damping": (1.0, "N m s/rad", "c_t", "damping of the shaft's torsion", (-1.0, -1.0, 1.0)),
}  # fmt: skip
"""What follows from `SHAFT_NAMES` -> SI per unit, unit, symbol, meaning, and its exponents of these."""


def cam_side_inertia(values: Mapping[str, float]) -> float:
    """Return the inertia on the cam's side, camshaft included [kg m^2]."""
    return 1.0 / (values["shaft_resonance"] ** 2 * max(values["shaft_compliance"], RIGID))


def shaft_transfer(omega: Array, values: Mapping[str, float], both: Any) -> tuple[Any, Any]:
    """Return load torque -> shaft torque (k,), and its derivatives by `COMPLIANCE_NAMES`.

    ``both`` (at least k, m) holds C(s) in column 0, then its derivatives.
    """
    own = np.array([values[name] for name in (*COMPLIANCE_NAMES[:3], *HALF_NAMES)])
    return loaded(omega, cam_side_inertia(values), own, both)  # type: ignore[no-any-return]


@njit(cache=True, error_model="numpy", nogil=True)
def loaded(omega, inertia, own, both):  # type: ignore[no-untyped-def]
    """Return transfer and derivatives of `shaft_transfer` from the cam's inertia and the shaft's own parameters."""
    soft, damping, ringing, half, place, ln_longer = own
    longer, mean = damping_shares(place, ln_longer)
    time = 2.0 / ringing * longer / mean * damping
    m = both.shape[1] - 1
    transfer = np.empty(omega.size, dtype=np.complex128)
    by = np.empty((omega.size, m), dtype=np.complex128)
    twisted = np.zeros(max(m, 3), dtype=np.complex128)
    for k in range(omega.size):
        square = -omega[k] * omega[k]
        slowed = inverse(1.0 + time * 1j * omega[k])
        beyond = place * soft * slowed
        over = inverse(1.0 + half * square * beyond)
        total = both[k, 0]
        passed = half * square * (total - beyond) * over
        transfer[k] = inverse(1.0 + passed + inertia * square * total)
        if m == 0:
            continue
        factor = -transfer[k] * transfer[k]
        bent = 2.0 / ringing * longer / mean * soft * place * 1j * omega[k] * slowed * slowed
        twisted[0], twisted[1], twisted[2] = place * slowed, -bent, damping / ringing * bent
        twisted[m - 2] = soft * slowed + damping * (longer - 1.0) / mean * bent
        twisted[m - 1] = damping * (place - 1.0) / mean * bent
        for j in range(m):
            more = both[k, j + 1] - twisted[j]
            by_half, by_over = half * more, half * twisted[j]
            if j == m - 3:
                by_half, by_over = by_half + total - beyond, by_over + beyond
            by[k, j] = factor * square * ((by_half - passed * by_over) * over + inertia * both[k, j + 1])
        through = factor * inertia * square * total
        if soft > RIGID:
            by[k, 0] -= through / soft
        by[k, 2] -= 2.0 * through / ringing
    return transfer, by
