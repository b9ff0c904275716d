"""cycles.h5 and aligned.h5 by the contract: units, names, dimension scales, checksums; written, then renamed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.records import DEVIATION, LEAD, ORDERS_TOLD, CamCycles, Forces, Recording
from camtorque.report.files import atomic_file
from camtorque.report.folder import reserve
from camtorque.stacks import pieces
from camtorque.version import __version__

if TYPE_CHECKING:  # the aligned cycles are written without a fit
    from camtorque.report.bundle import RunResult

ROOM_FOR_THE_REST = 1 << 20
"""Bytes for attributes and indices."""
LARGEST_CHUNK = 1 << 17
"""Values per chunk: one megabyte of doubles."""


@dataclass(frozen=True)
class Variable:
    """One data set: where, values, unit, name; its dimensions follow from its shape and group."""

    path: str
    values: Any
    units: str
    long_name: str


def result_variables(result: RunResult) -> list[Variable]:
    """Return every curve of a run: aligned cycles, means, model by cause, forces."""
    fitted, held = result.cycles.torque_halves
    return [
        *aligned_variables(result.cycles),
        *_orders_told(result),
        Variable("mean/torque_fitted", fitted, "N m", "mean, fitted cycles"),
        Variable("mean/torque_held_out", held, "N m", "mean, held out"),
        *_model(result),
        *_forces(result.fitted.forces),
    ]


def _orders_told(result: RunResult) -> list[Variable]:
    """Return how many orders of the swing the model has from a wheel, where there is one."""
    if DEVIATION not in result.cycles.details:
        return []
    orders = np.array([result.fitted.details.get(ORDERS_TOLD, 0)])
    return [Variable(f"mean/{ORDERS_TOLD}", orders, "1", "orders of the deviation that the model takes as they are")]


def write_cycles(path: Path, recording: Recording, cycles: CamCycles, variables: list[Variable]) -> None:
    """Write angles and cycle numbers with `result_variables` (cycles.h5) or `aligned_variables` (aligned.h5)."""
    with atomic_file(path) as partial:
        reserve(partial, sum(np.asarray(variable.values).nbytes for variable in variables) + ROOM_FOR_THE_REST)
        # from format 1.8 on an attribute (the configuration text) may be longer than 64 kB
        with h5py.File(partial, "w", libver=("v108", "v110")) as file:
            _root_attributes(file, recording)
            theta = _add(file, Variable("theta", cycles.theta, "rad", "cam angle from the zero of the lift table"))
            index = _add(file, Variable("cycles/index", cycles.index, "1", "cycle number in the recording"))
            theta.make_scale("theta")
            index.make_scale("index")
            for variable in variables:
                data = _add(file, variable)
                if data.shape[0] == cycles.index.size and variable.path.startswith("cycles/"):
                    data.dims[0].attach_scale(index)
                if data.shape[-1] == cycles.theta.size and not (data.ndim == 1 and variable.path.startswith("cycles/")):
                    data.dims[data.ndim - 1].attach_scale(theta)


def _add(file: h5py.File, variable: Variable) -> h5py.Dataset:
    values = np.asarray(variable.values)
    width = min(values.shape[-1], LARGEST_CHUNK)
    rows = max(1, min(values.shape[0], LARGEST_CHUNK // width))
    chunks = (width,) if values.ndim == 1 else (rows, width)
    data = file.create_dataset(variable.path, values.shape, values.dtype, chunks=chunks, fletcher32=True)
    for piece in pieces(values) if values.ndim == 2 else (slice(None),):
        data[piece] = values[piece]
    data.attrs["units"], data.attrs["long_name"] = variable.units, variable.long_name
    return data


def _root_attributes(file: h5py.File, recording: Recording) -> None:
    file.attrs["schema"] = "camtorque.cycles/1"
    file.attrs["version"] = __version__
    file.attrs["recording"] = recording.config.id
    file.attrs["configuration"] = recording.config.text
    file.attrs["inputs"] = json.dumps({str(item.path): item.sha256 for item in recording.inputs})
    file.attrs["versions"] = json.dumps({"numpy": np.__version__, "h5py": h5py.__version__})


def aligned_variables(cycles: CamCycles) -> list[Variable]:
    """Return the aligned cycles and their mean, without a model."""
    role = np.where(cycles.held_out, b"held_out", b"fitted")
    ahead, std, lead = (cycles.details.get(name) for name in (DEVIATION, f"{DEVIATION}_std", LEAD))
    rows = [
        Variable("cycles/role", role, "1", "fitted cycles make the model, held-out ones score it"),
        Variable("cycles/speed", cycles.speed, "rad/s", "mean cam speed of the cycle"),
        Variable(f"mean/{DEVIATION}", ahead, "rad", "measured angle ahead of even running within the revolution"),
        Variable(f"mean/{DEVIATION}_std", std, "rad", "standard uncertainty of the measured angle deviation"),
        Variable(f"mean/{LEAD}", lead, "rad", "the same between the pulses as theta was interpolated"),
        *_others(cycles),
    ]
    if cycles.pressure.size:
        rows += [
            Variable("cycles/pressure", cycles.pressure, "Pa", "measured pressure, gauge"),
            Variable("mean/pressure", cycles.mean_pressure, "Pa", "mean measured pressure of the used cycles"),
        ]
    if cycles.torque is not None:
        rows += [
            Variable("cycles/torque", cycles.torque, "N m", "measured drive torque"),
            Variable("mean/torque", cycles.mean_torque, "N m", "mean measured torque of the used cycles"),
            Variable("mean/torque_std", cycles.torque_std, "N m", "standard deviation of the torque over cycles"),
        ]
    return _known(rows)


def _known(rows: Iterable[Variable]) -> list[Variable]:
    """Return the variables that this recording and its model have."""
    return [row for row in rows if row.values is not None]


def _others(cycles: CamCycles) -> list[Variable]:
    rows = []
    for quantity, values in cycles.channels.items():
        known, name = CHANNEL_QUANTITIES[quantity], quantity.replace("_", " ")
        rows += [
            Variable(f"cycles/{quantity}", values, known.unit, known.meaning),
            Variable(f"cycles/{quantity}_mean", cycles.means(quantity), known.unit, f"{name}, mean of each cycle"),
        ]
    return rows


def _model(result: RunResult) -> list[Variable]:
    fitted, rigid = result.fitted, result.rigid
    std = fitted.chamber_pressure_std
    return _known(
        [
            Variable("model/rigid", rigid.torque, "N m", "rigid multibody torque from the measured pressure"),
            Variable("model/fitted", fitted.torque, "N m", "fitted model, pressure of the fitted cycles"),
            Variable(
                "model/fitted_held_out", fitted.torque_held_out, "N m", "fitted model, pressure of held-out cycles"
            ),
            Variable("model/true_angle", fitted.true_angle, "rad", "cam angle after trigger angle, twist and delay"),
            Variable("model/lift", rigid.lift, "m", "follower lift at the nominal cam angle"),
            Variable("model/lift_velocity", rigid.lift_velocity, "m/rad", "slope of the lift at the nominal cam angle"),
            *(
                Variable(f"model/{group}/{name}", values, "N m", f"torque by cause: {name.replace('_', ' ')}")
                for group, causes in (("by_cause", fitted.by_cause), ("rigid_by_cause", rigid.by_cause))
                for name, values in causes.items()
            ),
            Variable("model/chamber_pressure", fitted.chamber_pressure, "Pa", "rebuilt pressure on the plunger, gauge"),
            Variable("model/chamber_pressure_std", std, "Pa", "its total standard uncertainty at the true angle"),
        ]
    )


def _forces(forces: Forces) -> list[Variable]:
    return [
        Variable("forces/contact_normal", forces.contact_normal, "N", "normal force between cam and roller"),
        Variable("forces/contact_tangential", forces.contact_tangential, "N", "tangential force of cam and roller"),
        Variable("forces/guide", forces.guide, "N", "guide force on the follower"),
        Variable("forces/guide_moment", forces.guide_moment, "N m", "guide moment about the roller centre"),
        Variable("forces/bearing_x", forces.bearing_x, "N", "camshaft bearing reaction across the follower"),
        Variable("forces/bearing_y", forces.bearing_y, "N", "camshaft bearing reaction along the follower"),
        Variable("forces/hertz", forces.hertz, "Pa", "largest Hertz pressure of the contact"),
        Variable("forces/hertz_shear_max", forces.hertz_shear_max, "Pa", "largest shear stress below the surface"),
        Variable("forces/hertz_shear_depth", forces.hertz_shear_depth, "m", "depth of the largest shear stress"),
    ]
