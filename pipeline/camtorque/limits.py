"""Limits on the numbers of result.json: a band per quantity, pass or fail.

A limits file is the product's own, so an unknown key is refused. The quantity is the path of a number in result.json
(docs/result_schema.md), such as ``parameters.leakage.value``; it is judged in the unit of that file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config.keys import Band, Key, TableSchema
from camtorque.config.tables import Problems, Table, read_closed, read_schema
from camtorque.records import UNTOLD, Refusal
from camtorque.units import COVERAGE, did_you_mean, expected_one_of, plain_unit

LIMITS_SCHEMA = "camtorque-limits/1"
PASS, FAIL, CANNOT_TELL = "pass", "fail", "cannot tell"
FITTED = (
    "parameters.",
    "uncertainty.",
    "evidence.",
    "chamber.",
    "losses",
    "gap_by_cause.",
    "forces.",
    "alignment.trigger_angle_deg",
    "alignment.torque_delay_s",
    "alignment.angle_error_budget_after_fit_deg",
    "measured.chamber_pressure",
    "measured.delivered_volume.modelled",
    "measured.delivered_volume.difference",
)
"""Numbers of the fitted model, of which nothing is known where it does not explain the recording."""
NO_NUMBER = "the result holds no number of that name"
NOT_REBUILT = f"{NO_NUMBER}: the pressure on the plunger is the measured one, recording.line_pressure_peak_bar"
NUMBER = Band(-1e15, 1e15, "any number that a report holds")
UNIT_OF_ENDING = {
    "_nm": "N m", "_bar": "bar", "_deg": "deg", "_s": "s", "_percent": "%", "_rpm": "rpm", "_n": "N", "_gpa": "GPa",
    "_percent_of_peak": "%", "_c": "degC", "_mb": "MB", "_j": "J", "_hz": "Hz", "_ppm": "ppm",
    "_mm3": "mm3",
}  # fmt: skip
"""How the name of a number ends -> its unit (docs/result_schema.md)."""
LIMIT = TableSchema("[[limit]]", "one band", (
    Key("quantity", "text", "path of a number in result.json, such as parameters.leakage.value"),
    Key("min", "number", "least value that passes", default=None, band=NUMBER),
    Key("max", "number", "largest value that passes", default=None, band=NUMBER),
    Key("unit", "text", "unit of the band; refused where the result states another", default=""),
    Key("guard", "number", "so many standard uncertainties have to lie inside the band too", default=0.0,
        band=Band(0.0, 10.0, "standard uncertainties")),
    Key("text", "text", "why this limit", default=""),
), many=True)  # fmt: skip


@dataclass(frozen=True)
class Limit:
    """One band.

    Attributes
    ----------
    quantity : path of a number in result.json
    min, max : band in the unit of that number; None where it is open
    unit : of the band, "" where it is not stated
    guard : standard uncertainties that have to lie inside the band too (decision rule of ISO 14253-1 with a guard band)
    text : why
    """

    quantity: str
    min: float | None
    max: float | None
    unit: str = ""
    guard: float = 0.0
    text: str = ""

    def __post_init__(self) -> None:
        ends = [end for end in (self.min, self.max) if end is not None]
        if not all(isinstance(number, int | float) for number in (*ends, self.guard)):
            raise Refusal(f"limit {self.quantity}: found {ends} with guard {self.guard!r}, expected numbers")
        if not ends:
            raise Refusal(f"limit {self.quantity}: found neither min nor max, expected at least one of them")
        if not all(np.isfinite((*ends, self.guard))) or self.guard < 0.0:
            raise Refusal(
                f"limit {self.quantity}: found {ends} with guard {self.guard:g}, expected finite ends and a guard of 0 "
                "or more"
            )
        if ends[0] > ends[-1]:
            raise Refusal(f"limit {self.quantity}: min {ends[0]:g} is above max {ends[-1]:g}; exchange them")


@dataclass(frozen=True)
class Verdict:
    """What one limit says of one result; ``value`` and ``stderr`` are None where the result does not tell.

    unit : of the band, else the one in which the result states its number
    """

    limit: Limit
    unit: str
    value: float | None
    stderr: float | None
    verdict: str
    reason: str


def read_limits(path: Path | str) -> tuple[Limit, ...]:
    """Return the limits of a file.

    Raises
    ------
    Refusal : missing file or key, unknown key, no band or an empty one; all problems at once
    """
    _, root = read_schema(Path(path), LIMITS_SCHEMA, f"expected a limits file (schema {LIMITS_SCHEMA})")
    root.only(("schema", "limit"))
    problems, limits = Problems(), []
    for table in root.tables("limit"):
        with problems.collecting():
            limits.append(_limit(table))
    problems.raise_any(listed=False)
    return tuple(limits)


def _limit(table: Table) -> Limit:
    values = read_closed(table, LIMIT)
    try:
        return Limit(**values)
    except Refusal as refusal:
        raise Refusal(f"{table.where('')}: {refusal}") from None


def judge(document: Mapping[str, Any], limits: Sequence[Limit]) -> tuple[Verdict, ...]:
    """Return what each limit says of one result.json."""
    return tuple(_judged(document, limit) for limit in limits)


def _judged(document: Mapping[str, Any], limit: Limit) -> Verdict:
    *above, last = limit.quantity.split(".")
    group: Any = document
    for name in above:
        group = group.get(name) if isinstance(group, Mapping) else None
    value = group.get(last) if isinstance(group, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        measured = above[:1] == ["chamber"] and "chamber" in document and document["chamber"] is None
        return Verdict(limit, limit.unit, None, None, CANNOT_TELL, NOT_REBUILT if measured else NO_NUMBER)
    unit = _unit_of_name([last]) or group.get("unit") or _unit_of_name(list(reversed(above)))
    beside = document.get(f"{above[-1]}_stderr") if above else None
    error = group.get("stderr") if last == "value" else (beside or {}).get(last)
    if limit.unit and plain_unit(limit.unit) != plain_unit(unit):
        told = f"in {unit}" if unit else "without a unit"
        error, said = None, (CANNOT_TELL, f"the band is in {limit.unit}, the result {told}")
    elif limit.quantity.startswith(FITTED) and not document.get("explained", True):
        said = CANNOT_TELL, "the model leaves the recording unexplained"
    elif last == "value" and group.get("knowledge") in UNTOLD:
        said = CANNOT_TELL, f"the recording does not tell it ({group['knowledge']})"
    else:
        ends = group.get("ci95") if last == "value" else None
        said = _compared(limit, float(value), _sides(float(value), error, ends))
    return Verdict(limit, limit.unit or unit, float(value), error, *said)


def _unit_of_name(names: Sequence[str]) -> str:
    """Return the unit that the first name with a known ending tells, "" where none does."""
    return next((unit for name in names for end, unit in UNIT_OF_ENDING.items() if name.endswith(end)), "")


def _sides(value: float, stderr: float | None, ci95: Sequence[float] | None) -> tuple[float, float] | None:
    """Return one standard uncertainty below and above a value: of its 95 % interval where one is stated.

    An interval is lopsided beside a bound, and of a number that is known by its logarithm.
    """
    if ci95 is not None:
        return max(value - ci95[0], 0.0) / COVERAGE, max(ci95[1] - value, 0.0) / COVERAGE
    return None if stderr is None else (stderr, stderr)


def _compared(limit: Limit, value: float, sides: tuple[float, float] | None) -> tuple[str, str]:
    """Return verdict and reason; with a guard, a band that the uncertainty reaches across is not decided."""
    low, high = -np.inf if limit.min is None else limit.min, np.inf if limit.max is None else limit.max
    if limit.guard and sides is None:
        return CANNOT_TELL, "a guard is wanted and the result states no uncertainty"
    below, above = (limit.guard * side for side in sides or (0.0, 0.0))
    if low <= value - below and value + above <= high:
        return PASS, ""
    if value + above < low or value - below > high:
        return FAIL, f"{value - high:.4g} above the band" if value > high else f"{low - value:.4g} below the band"
    return CANNOT_TELL, f"within {limit.guard:g} standard uncertainties of a limit"


def overall(verdicts: Sequence[Verdict]) -> str:
    """Return ``fail`` where one failed, else ``cannot tell`` where one could not be judged, else ``pass``."""
    words = {row.verdict for row in verdicts}
    return next((word for word in (FAIL, CANNOT_TELL) if word in words), PASS)


def refuse_unknown(documents: Sequence[Mapping[str, Any]], limits: Sequence[Limit], parameters: Iterable[str]) -> None:
    """Refuse a quantity that none of the results has, naming those that are alike: most likely it is misspelt.

    A number of one of ``parameters``, which no fit may have needed, is no slip; nor is what a section that is null
    could hold.
    """
    known = sorted({path for document in documents for path in quantities(document)})
    absent = [f"{name}." for document in documents for name, value in document.items() if value is None]
    numbers = {path.split(".")[2] for path in known if path.startswith("parameters.")} or {"value"}
    unneeded = {f"parameters.{name}.{number}" for name in parameters for number in numbers}
    for limit in limits:
        if limit.quantity not in (*known, *unneeded) and not limit.quantity.startswith(tuple(absent)):
            hint = did_you_mean(limit.quantity, tuple(known)) or f", expected one such as {', '.join(known[:3])}"
            raise Refusal(f"limit {limit.quantity!r}: found in no result{hint}")


def refuse_unknown_parameters(limits: Sequence[Limit], parameters: Sequence[str]) -> None:
    """Refuse a limit of a parameter that no fit has, before there is a result."""
    for limit in limits:
        section, _, rest = limit.quantity.partition(".")
        name = rest.partition(".")[0]
        if section == "parameters" and name not in parameters:
            raise Refusal(
                f"limit {limit.quantity!r}: found parameter {name!r}{expected_one_of(name, tuple(parameters))}"
            )


def quantities(document: Mapping[str, Any], above: str = "") -> list[str]:
    """Return the path of every number of a document, of those that are null too."""
    found = []
    for name, value in document.items():
        path = f"{above}{name}"
        if isinstance(value, Mapping):
            found += quantities(value, f"{path}.")
        elif value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
            found.append(path)
    return found


def limits_document(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Return verdicts as a part of result.json: ``verdict`` and one row per limit."""
    rows = [{**row.pop("limit"), **row} for row in map(asdict, verdicts)]
    return {"verdict": overall(verdicts), "rows": rows}
