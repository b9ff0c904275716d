"""What a fit finds odd: parameters pulled off what was known, lift tables, a model that does not explain the cycles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camtorque.config import PumpData
from camtorque.config.pump import HERTZ_POSSIBLE
from camtorque.fit.descent import free_at, promised
from camtorque.fit.minima import Candidate
from camtorque.fit.problem import SEPARATOR, STRUCTURES
from camtorque.fit.sheet_doubts import A_DELAY, DELAYS, OF_PUMP, SIZES, SheetDoubt
from camtorque.fit.single import Fit
from camtorque.laws.chain import ON_CAM
from camtorque.mechanism.smoothing import table_error
from camtorque.records import Array, CamTable, Finding, Mask, ParameterEstimate
from camtorque.units import LOGARITHM, UNITS, short

RARE = 3.0902
"""Standard deviations that a normal number stays below in 999 of 1000 cases."""
PULLED = 2.5
"""A nuisance pulled this many standard deviations off its prior is told."""
MAY_MOVE = 0.5
"""Standard uncertainties that values may still move by, where a search ended early, without a word."""
MOUNTING, EDGE, BEYOND = "trigger_offset", math.sqrt(3.0), 2.0
"""A mounting tolerance is a rectangle whose edge lies at so many standard deviations: what lies so many of its own
standard uncertainties beyond is told."""

LOAD_FRICTIONS, NO_FRICTION = ("bearing_arm", "pin_arm", "guide_friction"), 0.02
"""Frictions that grow with the load, and the share of what is expected of each below which it is none."""
STEADY_DRAGS = ("shaft_drag", "shaft_viscous")
LIKE_A_ZERO = ", or for a torque zero that is off: note the reading at standstill before and after"
"""What drags that are constant at one speed cannot be told from, and how it is."""
AT_THE_TOP = 0.02
"""Share of the lift below its top within which a port hardly opens."""


def prior_findings(parameters: Sequence[ParameterEstimate]) -> tuple[Finding, ...]:
    """Return the nuisances that the data pull far off what was known; for the trigger see `mounting_findings`."""
    result = []
    for row in parameters:
        if row.prior is None or row.name.split(SEPARATOR)[0] == MOUNTING:
            continue
        pull = (row.value - row.prior[0]) / row.prior[1]
        if abs(pull) > PULLED:
            name, _, recording = row.name.partition(SEPARATOR)
            value, expected = _value_and_prior(row, *row.prior)
            text = (
                f"{name.replace('_', ' ')}{f' of {recording}' if recording else ''} is {value}"
                f"{', at its bound,' if row.at_bound else ','} {abs(pull):.1f} standard deviations off what was "
                f"expected ({expected}; {row.source}): either this bench really differs, or the value makes up for "
                f"something that the model lacks{LIKE_A_ZERO if name in STEADY_DRAGS and pull > 0.0 else ''}"
            )
            result.append(Finding("prior_pulled", "warning", text, row.name))
    return tuple(result)


def wheel_findings(orders: int) -> tuple[Finding, ...]:
    """Return the finding on a cam that swings otherwise than its drive would, as many orders of which a wheel tells."""
    if not orders:
        return ()
    text = (
        "wheel, encoder or counter shows the cam swing within the turn otherwise than shaft and drive would under this "
        "torque, as behind a universal joint, an engine or a gear: the cam angle is taken from it up to order "
        f'{orders}; where it sits on the motor\'s side of the shaft, write side = "motor" in [trigger], else check '
        "joints and gears"
    )
    return (Finding("swing_by_wheel", "warning", text, "trigger"),)


def _value_and_prior(row: ParameterEstimate, mean: float, std: float) -> tuple[str, str]:
    """Return a value and its prior as texts; one that acts by its logarithm as it is, with a factor more or less."""
    logarithm = LOGARITHM.fullmatch(row.unit)
    if logarithm is None:
        return f"{short(row.value)} {row.unit}".removesuffix(" -"), f"{short(mean)} +- {short(std, 2)}"
    value = f"{short(math.exp(row.value))} {logarithm[1]}".removesuffix(" 1")
    return value, f"{short(math.exp(mean))} times or over {short(math.exp(std), 2)}"


def mounting_findings(parameters: Sequence[ParameterEstimate]) -> tuple[Finding, ...]:
    """Return the finding on a trigger beyond its mounting tolerance."""
    result = []
    for row in parameters:
        if row.name.split(SEPARATOR)[0] != MOUNTING or row.prior is None:
            continue
        edge = EDGE * row.prior[1]
        if EDGE + BEYOND * row.stderr / row.prior[1] < abs(row.value) / row.prior[1]:
            text = (
                f"the trigger lies {short(abs(row.value) - edge)} {row.unit} beyond its mounting tolerance of +-"
                f"{short(edge)} {row.unit}: measure where its mark is; nominal_angle_deg, the edge that counts or the "
                "angles of the lift table may be wrong"
            )
            result.append(Finding("trigger_beyond_tolerance", "warning", text, row.name))
    return tuple(result)


def implausible_findings(parameters: Sequence[ParameterEstimate], explained: bool) -> tuple[Finding, ...]:
    """Return the finding on values that are what no bench as expected has, all taken together.

    A value that the data tell lies off its expectation by that one's standard deviation, one that they do not tell not
    at all: squares of such distances add up to a chi-square number of as many degrees as the data tell values.
    """
    known = [(row, row.prior, (row.value - row.prior[0]) / row.prior[1]) for row in parameters if row.prior is not None]
    known = [(row, prior, pull) for row, prior, pull in known if not row.at_bound or abs(pull) > PULLED]
    pulls = {row.name: pull for row, _, pull in known}
    told = sum(1.0 if row.at_bound else max(1.0 - (row.stderr / std) ** 2, 0.0) for row, (_, std), _ in known)
    if sum(pull**2 for pull in pulls.values()) <= largest_chi_square(max(told, 1.0)):
        return ()
    worst = sorted(pulls, key=lambda name: -abs(pulls[name]))[:2]
    chief = " and ".join(f"{name.replace('_', ' ')}, {abs(pulls[name]):.1f}" for name in worst)
    met = "the model reproduces the recording, but some values" if explained else "some values"
    text = (
        "the values together lie farther from what was expected than on one bench in a thousand (chiefly "
        f"{chief} standard deviations off): {met} may make up for a property of pump or bench that the model lacks"
    )
    return (Finding("values_implausible", "warning", text, worst[0]),)


def light_cam_findings(parameters: Sequence[ParameterEstimate], cam_inertia: float) -> tuple[Finding, ...]:
    """Return the finding on a cam's side that turns more lightly than the cam of the sheet alone [kg m^2]."""
    row = next((row for row in parameters if row.name == "cam_side_inertia"), None)
    if row is None or row.ci95[1] >= cam_inertia * 1.0e6:
        return ()
    text = (
        f"the shaft rings as if {short(row.value)} {row.unit} sat on it ({short(row.ci95[1])} at most), less than the "
        f"cam alone has by the sheet ({short(cam_inertia * 1.0e6)}): compliance, damping and inertia of the shaft are "
        "not to be relied on: they make up for something between cam and logger; check cam_inertia_kg_m2, cutoff_hz "
        "and filters of the logger"
    )
    return (Finding("cam_side_too_light", "warning", text, row.name),)


def frictionless_findings(parameters: Sequence[ParameterEstimate]) -> tuple[Finding, ...]:
    """Return the finding on a pump in which nothing rubs the more the more it is loaded."""
    rows = [(row, row.prior[0]) for row in parameters if row.name in LOAD_FRICTIONS and row.prior is not None]
    if len(rows) < len(LOAD_FRICTIONS) or any(
        row.value > NO_FRICTION * mean or row.ci95[1] > mean for row, mean in rows
    ):
        return ()
    most = ", ".join(f"{short(row.ci95[1], 2)} {row.unit}".removesuffix(" -") for row, _ in rows)
    text = (
        f"bearings, pin and guide show no friction under load (at most {most}), unlike any pump: the line pressure "
        "reads too high or the torque too low; check the sensitivities and dates of both certificates, and "
        "plunger_diameter_m"
    )
    return (Finding("no_load_friction", "warning", text, "friction"),)


def largest_chi_square(degrees: float) -> float:
    """Return what a chi-square number stays below in 999 of 1000 cases (Wilson & Hilferty, PNAS 17 (1931))."""
    variance = 2.0 / (9.0 * degrees)
    return degrees * (1.0 - variance + RARE * math.sqrt(variance)) ** 3


def table_findings(table: CamTable) -> tuple[Finding, ...]:
    """Return a note on a lift table that scatters beyond its stated resolution."""
    scatter = table_error(table)
    if scatter <= 1.001 * table.resolution / math.sqrt(12.0):
        return ()
    text = (
        f"the lift table scatters by {scatter * 1e6:.2f} um about a smooth curve, rounding to "
        f"{table.resolution * 1e6:g} um alone gives {table.resolution * 1e6 / np.sqrt(12.0):.2f} um; "
        "it is smoothed to match its scatter"
    )
    return (Finding("lift_scatter", "info", text),)


def spill_findings(parameters: Sequence[ParameterEstimate], top: float) -> tuple[Finding, ...]:
    """Return a note on a spill port that the plunger hardly reaches, or does not; ``top`` is the largest lift [m]."""
    for row in parameters:
        if row.name != "spill_lift" or row.value + min(2.0 * row.stderr, AT_THE_TOP * 1e3 * top) < 1e3 * top:
            continue
        text = (
            f"a spill port that opens at {short(row.value)} ± {short(row.stderr, 1)} {row.unit} is hardly reached by a "
            f"lift of {short(1e3 * top, 4)} mm: perhaps no spill ends the delivery and something else gives "
            "way at the top, such as a delivery valve that closes late"
        )
        return (Finding("spill_at_the_top", "warning", text, row.name),)
    return ()


def stress_findings(hertz: Array) -> tuple[Finding, ...]:
    """Return a warning on a Hertz pressure over cam angle, (n,) [Pa], that no steel bears."""
    if not np.nanmax(hertz) > HERTZ_POSSIBLE:
        return ()
    at = f"{360.0 * int(np.nanargmax(hertz)) / hertz.size:.0f} deg"
    text = (
        f"the Hertz pressure reaches {1e-9 * np.nanmax(hertz):.3g} GPa at {at}, no steel bears more than "
        f"{1e-9 * HERTZ_POSSIBLE:g}: check the lift table there (its second differences set it) and the radii of "
        "cam and roller"
    )
    return (Finding("contact_stress_impossible", "warning", text, at),)


def sheet_findings(doubts: Sequence[SheetDoubt], pump: PumpData) -> tuple[Finding, ...]:
    """Return the finding on what torque and pressure would have otherwise than stated, the likeliest first."""
    if not doubts:
        return ()
    asked_for = ", or nearly as well to ".join(_otherwise(doubt, pump) for doubt in doubts)
    alike = {**dict.fromkeys(SIZES, "plunger, lift and both gains"), **dict.fromkeys(DELAYS, "the two delays")}
    named = alike.get(doubts[0].quantity)
    like = f" ({named} can stand in for one another)" if named else ""
    text = (
        f"torque and pressure contradict the sheet: they point to {asked_for}{like}. In the fit, friction and "
        "delivery valve make up for it: check it before relying on chamber pressure and losses"
    )
    return (Finding("sheet_contradicted", "warning", text, doubts[0].quantity),)


def _otherwise(doubt: SheetDoubt, pump: PumpData) -> str:
    field = OF_PUMP.get(doubt.quantity)
    if doubt.quantity in DELAYS:
        shorter, known = (1e3 * A_DELAY * part for part in (math.log(doubt.factor), doubt.std / doubt.factor))
        way = "shorter" if shorter > 0.0 else "longer"
        return f"a {doubt.quantity} that is {abs(shorter):.2f} ± {known:.2f} ms {way}"
    if field is None:
        return f"a {doubt.quantity} that is {doubt.factor:.2f} ± {doubt.std:.2f} times as large{_unit_slip(doubt)}"
    stated = getattr(pump, field)
    asked, std = short(doubt.factor * stated), short(doubt.std * stated, 1)
    return f"{doubt.quantity} = {asked} ± {std} in place of {short(stated)}"


def _unit_slip(doubt: SheetDoubt) -> str:
    """Return which unit a torque may have that was taken for another, empty where none fits."""
    foot_pound = UNITS["torque"]["lbf ft"]
    slips = {foot_pound: "lbf ft taken for N m", 1.0 / foot_pound: "N m taken for lbf ft"}
    found = (text for factor, text in slips.items() if abs(doubt.factor - factor) < min(2.0 * doubt.std, 0.1))
    return next((f", as of {text}" for text in found if doubt.quantity == "gain of the torque"), "")


def fit_findings(fit: Fit, least_guide: float, lost: Mask, unexplained: float | None) -> tuple[Finding, ...]:
    """Return what is odd about a fit.

    Parameters
    ----------
    least_guide : least 1 - mu tan(phi) sign(y')
    lost : (n,) where the cam would have to pull the follower
    unexplained : rms that the fit leaves [% of the peak], None where that is as it should be
    """
    result = _met_findings(fit, unexplained)
    order = fit.problem.data[0].chain.ripple_order
    if order:
        _, coefficients = fit.problem.values(fit.solution.z, 0)
        text = (
            f"on the base circle the torque repeats itself {order} times a revolution (amplitude "
            f"{short(float(np.hypot(*coefficients[ON_CAM + 1 :])))} N m): teeth of a gear or a belt, or poles of the "
            "motor; the fit treats it as drive ripple, the same all round"
        )
        result.append(Finding("drive_ripple", "info", text, "torque"))
    if np.any(lost):
        angle = 360.0 / lost.size * int(np.argmax(lost))
        result.append(Finding("contact_lost", "warning", f"the follower leaves the cam near {angle:.0f} deg"))
    if least_guide < 0.5:
        text = f"mu tan(phi) reaches {1.0 - least_guide:.2f}; the guide jams at 1: check lift table and offset"
        result.append(Finding("guide_near_jamming", "warning", text))
    second = _second(fit.candidates, fit.probabilities)
    if second is not None:
        text = f"another structure fits about as well: {STRUCTURES[second.data.structure]}; both are reported"
        result.append(Finding("two_minima", "warning", text))
    return tuple(result)


def _met_findings(fit: Fit, unexplained: float | None) -> list[Finding]:
    """Return how well a fit meets its recording: what it leaves, whether it ended, what widens its uncertainties."""
    result = []
    if unexplained is not None:
        text = (
            f"the model leaves {unexplained:.2f} % of the peak unexplained, far above the cycle repeatability: do not "
            "rely on values and intervals of this recording"
        )
        result.append(Finding("unexplained", "error", text))
    moves = 0.0 if fit.solution.converged else _moves(fit)
    if moves > MAY_MOVE:
        text = (
            "the search stopped short of its minimum, where the data hardly determine it: values that are mixed "
            f"up may still move by up to {moves:.1f} of their standard uncertainty"
        )
        result.append(Finding("not_converged", "warning", text))
    if fit.covariance.inflation > 1.0:
        text = (
            "the residual exceeds the scatter of the cycles and the allowed model error (0.1 % of the torque at each "
            f"angle); the uncertainties are widened by a factor of {np.sqrt(fit.covariance.inflation):.2f}"
        )
        result.append(Finding("model_discrepancy", "info", text))
    return result


def _moves(fit: Fit) -> float:
    """Return by how many standard uncertainties, at most, a further undamped step would move a value."""
    solution, steps = fit.solution, fit.problem.steps
    free = free_at(solution.z, solution.gradient, *fit.problem.bounds)
    promise = promised(solution.hessian * np.outer(steps, steps), solution.gradient * steps, free)
    return math.sqrt(promise / fit.covariance.inflation)


def _second(candidates: tuple[Candidate, ...], probabilities: tuple[float, ...]) -> Candidate | None:
    for item, probability in zip(candidates[1:], probabilities[1:], strict=True):
        if probability > 0.05 and item.data.structure != candidates[0].data.structure:
            return item
    return None
