"""The cheapest grid for a wanted error of the torque between its points, from the committed study."""

from __future__ import annotations

from camtorque.records import Finding, Refusal

GRID_ERRORS: dict[tuple[int, str], float] = {
    (180, "linear"): 9.98e-3,
    (360, "linear"): 2.81e-3,
    (720, "linear"): 7.18e-4,
    (360, "cubic periodic"): 2.10e-5,
    (720, "cubic periodic"): 1.22e-6,
    (1800, "cubic periodic"): 2.95e-8,
    (3600, "cubic periodic"): 1.84e-9,
    (7200, "cubic periodic"): 1.47e-10,
}
"""(points per revolution, curve between them) -> largest torque error over the peak: the front of the grid chart,
rounded up; a test holds it to ``reports/studies/speed_accuracy.json``."""


def choose_grid(tolerance: float) -> tuple[int, str, float]:
    """Return points per revolution, curve between them and the error that the choice implies.

    It is the coarsest grid whose largest error of the rigid torque over its peak, measured on the pump of the studies
    with pressure flanks of 2 degrees, stays below the tolerance.

    Raises
    ------
    Refusal : a tolerance that is not positive, or finer than the finest grid of the study
    """
    if not tolerance > 0.0:
        raise Refusal(f"tolerance: {tolerance:g}, expected a positive share of the peak torque such as 1e-4")
    for (n_theta, method), error in sorted(GRID_ERRORS.items()):
        if error <= tolerance:
            return n_theta, method, error
    least = min(GRID_ERRORS.values())
    raise Refusal(f"tolerance: {tolerance:g} is finer than the finest grid studied reaches, {least:g}; ask for more")


def grid_note(tolerance: float, least: int = 0) -> tuple[int, Finding]:
    """Return the points per revolution by `choose_grid`, at least ``least``, and what the choice implies."""
    n_theta, method, implied = choose_grid(tolerance)
    raised = f", raised to the {least} that the fit needs," if least > n_theta else ""
    text = (
        f"angle grid for a wanted error of {tolerance:.1e} of the peak torque: {n_theta} points per revolution{raised} "
        f"leave at most {implied:.1e} of the rigid torque between the points ({method} curve, by the speed-accuracy "
        f"study); the fitted model keeps a grid of its own"
    )
    return max(n_theta, least), Finding("grid_error", "info", text, "--tolerance")
