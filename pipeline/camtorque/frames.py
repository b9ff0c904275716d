"""Results as tables and arrays with names: pandas, xarray."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from camtorque.mechanism.predict import Prediction, sweep_rows
from camtorque.records import CamCycles, require
from camtorque.report.bundle import RunResult
from camtorque.report.cycles_file import aligned_variables, result_variables

VALUES = ("value", "stderr", "stderr_statistical", "low95", "high95")
PARAMETER_COLUMNS = (*VALUES, "unit", "knowledge", "role", "at_bound", "meaning")


def to_pandas(item: RunResult | CamCycles | Prediction) -> pd.DataFrame:
    """Return a table.

    Parameters
    ----------
    item : a result gives its parameters (one row each, index ``name``); cycles give one row per cycle (index
        ``cycle``: speed [rad/s], held_out, and the largest and least torque [N m]); a prediction one row per speed

    Returns
    -------
    table : parameters in the units of the report (column ``unit``) with ``stderr`` and ends of the 95 % interval;
        cycles in SI; predictions in the units that the columns name

    Raises
    ------
    TypeError : anything else
    """
    if isinstance(item, RunResult):
        return _parameters(item)
    if isinstance(item, CamCycles):
        return _cycles(item)
    if isinstance(item, Prediction):
        return pd.DataFrame(sweep_rows(item)).set_index("speed_rpm")
    raise TypeError(f"found {type(item).__name__}, expected a result, cycles or a prediction")


def _parameters(result: RunResult) -> pd.DataFrame:
    rows = [{**vars(row), "low95": row.ci95[0], "high95": row.ci95[1]} for row in result.fitted.parameters]
    return pd.DataFrame(rows).set_index("name")[list(PARAMETER_COLUMNS)]


def _cycles(cycles: CamCycles) -> pd.DataFrame:
    columns: dict[str, Any] = {"speed": cycles.speed, "held_out": cycles.held_out}
    columns |= {quantity: cycles.means(quantity) for quantity in cycles.channels}
    if cycles.pressure.size:
        columns |= {"pressure_max": np.max(cycles.pressure, axis=1)}
    if cycles.torque is not None:
        columns |= {"torque_max": np.max(cycles.torque, axis=1), "torque_min": np.min(cycles.torque, axis=1)}
    return pd.DataFrame(columns, index=pd.Index(cycles.index, name="cycle"))


def to_xarray(item: RunResult | CamCycles | Prediction) -> Any:
    """Return an xarray.Dataset with ``units`` and ``long_name`` on every variable.

    Parameters
    ----------
    item : a result (all of cycles.h5), cycles (those alone), or a prediction (torque over speed and angle)

    Returns
    -------
    dataset : over ``theta`` (n_theta,) [rad] and ``cycle``, or ``speed`` [rad/s] of a prediction; names as in cycles.h5
        with ``_`` for ``/``

    Raises
    ------
    TypeError : anything else
    Refusal : xarray is not installed
    """
    require(("xarray",), "to_xarray", "notebook")
    import xarray as xr

    if isinstance(item, Prediction):
        torque = (("speed", "theta"), item.shaft_torque, {"units": "N m", "long_name": "torque at the drive end"})
        pressure = ("theta", item.pressure, {"units": "Pa", "long_name": "pressure on the plunger"})
        coords = {"theta": ("theta", item.theta, {"units": "rad"}), "speed": ("speed", item.speeds, {"units": "rad/s"})}
        return xr.Dataset({"shaft_torque": torque, "pressure": pressure}, coords)
    if not isinstance(item, RunResult | CamCycles):
        raise TypeError(f"found {type(item).__name__}, expected a result, cycles or a prediction")
    cycles = item if isinstance(item, CamCycles) else item.cycles
    variables = aligned_variables(cycles) if isinstance(item, CamCycles) else result_variables(item)
    data = {}
    for row in variables:
        values = np.asarray(row.values)
        values = values.astype(str) if values.dtype.kind == "S" else values
        over_cycles = row.path.startswith("cycles/")
        dims = ("cycle", "theta") if values.ndim == 2 else ("cycle",) if over_cycles else ("theta",)
        data[row.path.replace("/", "_")] = (dims, values, {"units": row.units, "long_name": row.long_name})
    axes: dict[str, Any] = {"theta": ("theta", cycles.theta, {"units": "rad"}), "cycle": ("cycle", cycles.index)}
    return xr.Dataset(data, axes)
