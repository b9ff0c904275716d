"""The assumptions of a prediction from a fit, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.fit.endings import EITHER
from camtorque.fit.forecast import CLEARANCE, Forecast
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.uncertainty import COVERAGE
from camtorque.records import Estimate
from camtorque.units import BAR, DEGREE, RPM, TURN

SAME_LOAD = 1.1
"""Factor beyond the highest line pressures of the fitted recordings that is still a fitted load."""
SAME_PLACE, SPREAD = 2.0 * DEGREE, 4.0 * DEGREE
"""A line pressure that rises so far beyond those of fitted recordings has another zero of its angle, or is of another
pump; within a campaign they rise up to 4 degrees apart, which one or two recordings do not show [rad]."""
NOT_TOLD = "A line pressure does not tell whether a land or a spill ended delivery"
ENDED_BY = {"land": "a land", "spill": "spill"}
"""Structure -> what ends delivery."""


def load_text(source: FittedAt, name: str, given: Curve | None, speed: float) -> str:
    """Return what was taken as the load; ``name`` of the recording or file that was given."""
    if given is None:
        return (
            f"at {speed / RPM:.0f} rpm the line pressure of {source.id} ({source.speed / RPM:.0f} rpm), over cam angle "
            "as it was recorded"
        )
    if np.isfinite(given.speed):
        return f"the line pressure of {name}"
    text = f"the line pressure of {name}, at every speed, over the cam angle that the trigger's nominal angle counts"
    at_speed = replace(given, speed=speed)
    if at_speed.coarse:
        text += (
            f"; its points are {given.step / DEGREE:.2g} deg apart under load, which widens the band; "
            f"{_rounded(at_speed.fine_step / DEGREE):g} deg would do at {speed / RPM:.0f} rpm"
        )
    return text


def beyond_text(top: float, fitted: tuple[float, float]) -> tuple[str, ...]:
    """Return that a load lies beyond the fitted ones, where it does; both by the highest line pressure [Pa]."""
    low, high = fitted
    if low / SAME_LOAD < top < high * SAME_LOAD:
        return ()
    return (
        f"The load lies beyond the fitted ones: its line pressure reaches {top / BAR:.4g} bar, those of the fitted "
        f"recordings {low / BAR:.4g} to {high / BAR:.4g} bar. The bands hold what left-out recordings, each with its "
        "own load, were off, and no more.",
    )


def elsewhere_text(angle: float, fitted: tuple[float, float]) -> tuple[str, ...]:
    """Return that a load rises at another cam angle than the fitted ones, where it does [rad]."""
    low, high = fitted
    margin, middle = max(SAME_PLACE, SPREAD - (high - low)), 0.5 * (low + high)
    apart = abs(float(np.remainder(angle - middle + np.pi, TURN)) - np.pi)
    if not apart > 0.5 * (high - low) + margin:  # nan: steady pressures have no angle
        return ()
    return (
        f"Do not build on this load before its angle is checked: it begins to rise at {angle / DEGREE:.1f} deg of cam "
        f"angle, those of the fitted recordings at {low / DEGREE:.1f} to {high / DEGREE:.1f} deg; it has to count from "
        "the zero of the lift table. Each degree moves end of delivery and chamber, beyond these bands.",
    )


def _rounded(step_deg: float) -> float:
    """Return a round step that is not larger."""
    return next((step for step in (1.0, 0.5, 0.25, 0.2) if step <= step_deg), 0.1)


def assumptions(known: KnownFit, source: FittedAt, load: str, clearance: str, other: Path | None) -> tuple[str, ...]:
    """Return what load, error of the model, clearance and pump were taken to be; ``other`` pump file or lift table."""
    laws = "as large as predictions of left-out recordings were off" if source.left_out else (
        "what the fit left over on its own held-out cycles, and 2 % of the peak torque more for each factor of 2.7 in "
        "speed away from it; a campaign over several speeds would tell it better"
    )  # fmt: skip
    texts = [f"Load: {load}.", "The zero error of a torque transducer is not added.",
             f"Error of the model: {laws}. It follows the torque over the revolution."]  # fmt: skip
    if clearance:
        base = "" if "um" in clearance[:-2] else f", counted from {CLEARANCE * 1e6:g} µm"
        texts.append(f"Clearance {clearance}{base}: leakage in proportion to its third power.")
    if known.lift is not None:
        largest = float(np.max(np.abs(known.lift.values)))
        texts.append(f"The lift table is corrected by up to {1e6 * largest:.1g} µm, as all fitted recordings ask for.")
    if known.unexplained:
        texts.append(f"Nothing is taken from {', '.join(known.unexplained)}: the fit does not explain it.")
    if other is not None:
        texts.append(f"Pump or cam of {other.name}; losses and chamber are those of the fitted pump.")
    return tuple(texts)


def end_text(ends: Mapping[str, Estimate], source: FittedAt, known: KnownFit, speed_rpm: float) -> tuple[str, ...]:
    """Return where delivery was taken to end, and how well that is known."""
    units = {"end_of_delivery": (DEGREE, "deg of cam angle"), "spill_lift": (1e-3, "mm of lift")}
    found = [(ends[name], per, unit) for name, (per, unit) in units.items() if name in ends]
    if not found:  # of a structure whose delivery ends nowhere
        return ()
    alike = any(item.structure == source.structure for item in known.recordings)
    kind = ENDED_BY[source.structure]
    how = (
        f"by {kind} as in {source.id}: where the line pressure looks as it does there, for the mean sharpness of the "
        "fitted ends (another begins elsewhere, which is in the band)" if alike else
        f"by {kind}, as no fitted recording does: where the line pressure looks as it does at their ends; how sharply "
        "is as unsure as before any fit"
    )  # fmt: skip
    return tuple(
        f"Delivery at {speed_rpm:g} rpm ends at {end.value / per:.3g} ± {2.0 * end.stderr / per:.2g} {unit}, {how}."
        for end, per, unit in found
    )


def ending_text(item: Forecast) -> tuple[str, ...]:
    """Return the assumption on how delivery ends under a given load."""
    if item.ending == EITHER:
        return (
            f"{NOT_TOLD}: the bands hold both, the curves lie midway; --ending {' or --ending '.join(ENDED_BY)} "
            "predicts one of them.",
        )
    if item.other is None:
        return ()
    other, so = item.other, ENDED_BY[item.other.structure]
    more = "higher" if other.difference > 0.0 else "lower"
    apart = f"{abs(other.difference):.2g} N m {more} at {other.angle / DEGREE:.0f} deg of cam angle"
    return (
        f"{NOT_TOLD}: it is {ENDED_BY[item.ending]} as in the fitted recordings. If {so} ends it, the torque at "
        f"{item.speed / RPM:.4g} rpm is up to {apart}: --ending {other.structure} predicts it, --ending {EITHER} holds "
        "both.",
    )


def step_text(item: Forecast) -> tuple[str, ...]:
    """Return that the model steps within what the fit leaves open, where it does."""
    if not item.steps:
        return ()
    top = int(np.argmax(item.torque))
    return (
        f"Do not build on the torque at {item.speed / RPM:.4g} rpm: within what the fit leaves open it goes one way or "
        "another, as beside a delivery valve that is near chattering. The curve is the middle one of many, its peak "
        f"known to ± {100.0 * COVERAGE * item.torque_std[top] / item.torque[top]:.2g} %; a recording near that speed "
        "would tell.",
    )


def flight_text(item: Forecast) -> tuple[str, ...]:
    """Return that the follower leaves the cam, where it does: the model of a fit keeps it there."""
    if item.take_off is None:
        return ()
    return (
        f"Do not build on the run at {item.speed / RPM:.0f} rpm: the follower leaves the cam at "
        f"{item.take_off / DEGREE:.0f} deg of cam angle. From there, until it would land, torque and forces are those "
        f"of a cam that pulls (with up to {-item.least_contact:.3g} N); ask for lower speeds.",
    )


def constant_text(item: Forecast) -> tuple[str, ...]:
    """Return how much of the band is one constant, where that is most of it."""
    constant = COVERAGE * float(np.sqrt(np.median(item.torque_std**2 - item.shape_std**2).clip(0.0)))
    if constant < COVERAGE * float(np.median(item.shape_std)):
        return ()
    return (
        f"At {item.speed / RPM:.0f} rpm ± {constant:.2g} N m of the band is one constant over the revolution: steady "
        "drag that the fitted recordings do not tell from their zeros.",
    )
