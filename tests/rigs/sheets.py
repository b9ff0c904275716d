"""The papers of a bench: recording.toml, sensor sheets with certificates, the measured lift table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigs.rig import RigRun, lift_of
from rigs.truth import BAR, DEGREE, RigTruth

TORQUE_SERIAL, PRESSURE_SERIAL, TRIGGER_SERIAL = "TT-1001", "PS-2002", "PROX-01"
SERIALS = {"torque": TORQUE_SERIAL, "pressure": PRESSURE_SERIAL, "trigger": TRIGGER_SERIAL}
TORQUE_RANGE, PRESSURE_RANGE = 200.0, 2000.0


@dataclass(frozen=True)
class ChannelLine:
    """One ``[[channels]]`` entry."""

    quantity: str
    file: str
    group: str
    channel: str
    logger: str
    rate: float


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def toml_table(header: str, values: dict) -> str:
    """Return one TOML table as text."""
    return "\n".join([header, *(f"{key} = {_toml(value)}" for key, value in values.items())]) + "\n"


def write_lift_table(truth: RigTruth, path: Path, rng: np.random.Generator, step_deg: float, noise: float) -> None:
    """Write the lift at ``step_deg`` rounded to 1 um, with measuring noise [m]."""
    angles = np.arange(0.0, 360.0, step_deg)
    lift = lift_of(truth, angles * DEGREE) + noise * rng.standard_normal(angles.size)
    lines = [
        "# measured cam lift (roller follower), resolution 1 um, zero of lift = base circle",
        "cam_angle_deg,lift_mm",
    ]
    lines += [f"{angle:g},{1e3 * value:.3f}" for angle, value in zip(angles, lift, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def write_sensor_sheets(truth: RigTruth, folder: Path, rng: np.random.Generator) -> None:
    """Write both sensor sheets and their certificates; certificate points carry a tenth of their stated uncertainty."""
    torque, pressure = truth.torque_sensor, truth.pressure_sensor
    steps = 40.0 * np.array([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0, -1, -2, -3, -4, -5, -4, -3, -2, -1, 0])
    volts = torque.volts_per_unit * (steps + 0.03 + 0.01 * rng.standard_normal(steps.size))
    _certificate(folder / "torque.csv", "k=2 uncertainty 0.05 % of nominal", "applied_torque_Nm", steps, volts)
    applied = np.array([0.0, 200, 500, 800, 1000, 1200, 1500, 1800, 2000])
    volts = BAR * pressure.volts_per_unit * (applied + 0.3 + 0.1 * rng.standard_normal(applied.size))
    _certificate(folder / "pressure.csv", "k=2 uncertainty 0.1 % of range", "applied_pressure_bar", applied, volts)
    (folder / "torque.toml").write_text(
        toml_table(
            "[sensor]",
            {
                "serial": TORQUE_SERIAL,
                "type": "rotating torque transducer",
                "quantity": "torque",
                "unit": "N m",
                "nominal_range": [-TORQUE_RANGE, TORQUE_RANGE],
                "output_range_V": [-5.0, 5.0],
                "nominal_sensitivity_V_per_unit": 0.025,
                "accuracy_class": 0.5,
                "cutoff_hz": torque.cutoff_hz,
                "filter": "low-pass, 2nd order",
                "group_delay_s": torque.delay,
                "group_delay_note": "total signal delay of transducer electronics, typical, +/-3 %",
                "zero_tolerance_V": 0.05,
                "residual_ripple_V": 0.005,
                "certificate": "torque.csv",
                "calibration_date": "2024-11-05",
            },
        )
    )
    (folder / "pressure.toml").write_text(
        toml_table(
            "[sensor]",
            {
                "serial": PRESSURE_SERIAL,
                "type": "piezoresistive high-pressure sensor",
                "quantity": "pressure",
                "unit": "bar",
                "reference": "gauge",
                "nominal_range": [0.0, PRESSURE_RANGE],
                "output_range_V": [0.0, 10.0],
                "nominal_sensitivity_V_per_unit": 0.005,
                "accuracy_percent_fs": 0.3,
                "zero_drift_note": "thermal zero shift up to 0.15 % of range",
                "natural_frequency_hz": 150000.0,
                "group_delay_s": pressure.delay,
                "certificate": "pressure.csv",
                "calibration_date": "2024-12-18",
            },
        )
    )


def _certificate(path: Path, note: str, column: str, applied: np.ndarray, volts: np.ndarray) -> None:
    lines = [f"# calibration certificate, traceable, {note}", f"{column},output_V"]
    lines += [f"{a:.1f},{v:.5f}" for a, v in zip(applied, volts, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def recording_toml(
    run: RigRun,
    name: str,
    file_format: str,
    dialect: str,
    clock: str,
    channels: list[ChannelLine],
    standstill: dict[str, tuple[float, float]] | None,
) -> str:
    """Return recording.toml (schema fip-bench-recording/1); sheets lie in ``calibration/`` beside it."""
    truth, pump, trigger = run.truth, run.truth.pump, run.truth.trigger
    parts = ['schema = "fip-bench-recording/1"\n']
    rotation = "positive" if truth.rotation > 0 else "negative"
    parts.append(
        toml_table(
            "[recording]",
            {
                "id": name,
                "pump_id": truth.name,
                "nominal_speed_rpm": float(run.speed_rpm),
                "file_format": file_format,
                "csv_dialect": dialect,
                "acquisition": clock,
                "rotation": rotation,
                "note": "",
            },
        )
    )
    parts.append(
        toml_table(
            "[pump]",
            {
                "base_circle_radius_m": pump.base_circle_radius,
                "roller_radius_m": pump.roller_radius,
                "roller_width_m": pump.roller_width,
                "follower_offset_m": float(pump.follower_offset),
                "cam_mass_kg": pump.cam_mass,
                "cam_inertia_kg_m2": pump.cam_inertia,
                "follower_mass_kg": pump.follower_mass,
                "follower_mass_note": "all sliding parts incl. 1/3 spring mass",
                "spring_stiffness_N_per_m": pump.spring_stiffness,
                "spring_preload_N": pump.spring_preload,
                "plunger_diameter_m": pump.plunger_diameter,
                "youngs_modulus_cam_Pa": 210e9,
                "youngs_modulus_roller_Pa": 210e9,
                "cam_table": "calibration/cam.csv",
                "cam_table_angle_column": "cam_angle_deg",
                "cam_table_lift_column": "lift_mm",
            },
        )
    )
    parts.append(
        toml_table(
            "[trigger]",
            {
                "nominal_angle_deg": round(trigger.nominal_angle / DEGREE, 9),
                "installation_tolerance_deg": round(trigger.tolerance / DEGREE, 9),
                "meaning": "end of pre-stroke / start of pressurisation",
                "edge": "rising",
                "pulses_per_rev": trigger.pulses_per_rev,
                "level_V": trigger.pulse_height,
                "switching_delay_typ_s": trigger.switching_delay,
                **({"missing_teeth": trigger.missing_teeth} if trigger.missing_teeth else {}),
            },
        )
    )
    for quantity in ("torque", "pressure"):
        values = {"serial": SERIALS[quantity], "calibration": f"calibration/{quantity}.toml"}
        if quantity == "pressure":
            values["location"] = "high-pressure line, pump end"
        if standstill is not None:
            before, after = standstill[quantity]
            values |= {"zero_before_V": round(before, 4), "zero_after_V": round(after, 4)}
        parts.append(toml_table(f"[sensors.{quantity}]", values))
    for logger in dict.fromkeys(line.logger for line in channels):
        parts.append(toml_table("[[loggers]]", {"id": logger, "clock": clock}))
    for line in channels:
        parts.append(
            toml_table(
                "[[channels]]",
                {
                    "quantity": line.quantity,
                    "file": line.file,
                    "group": line.group,
                    "channel": line.channel,
                    "unit": "V",
                    "logger": line.logger,
                    "sample_rate_hz": float(line.rate),
                    "sensor": SERIALS[line.quantity],
                },
            )
        )
    return "\n".join(parts)
