"""Summary of the alignment as numbers and texts for a file or a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from camtorque.align.channels import AlignedChannel
from camtorque.align.options import RULES
from camtorque.align.timebase import TimeBase
from camtorque.jsonable import jsonable
from camtorque.records import CamCycles
from camtorque.units import RPM

ANTI_ALIAS = {
    "average": "mean of the linear interpolant over each grid step: the spectrum times sinc(order / n_theta)",
    "cubic": "cubic through the four nearest samples: samples lie coarser than the grid, nothing can alias",
    "linear": "straight line between the two nearest samples",
}


def alignment_summary(cycles: CamCycles) -> dict[str, Any]:
    """Return what `camtorque align` writes beside the cycles: JSON numbers, None where a figure is not determined."""
    return {
        "cycles_found": cycles.cycles_found,
        "cycles_used": int(cycles.index.size),
        "duration_s": cycles.duration,
        "speed_rpm": cycles.mean_speed / RPM,
        "speed_ripple_percent": cycles.speed_ripple_percent,
        "trigger_jitter_s": cycles.trigger_jitter_s,
        "torque_delay_s": jsonable(asdict(cycles.torque_delay)),
        "clock": [jsonable(asdict(clock)) for clock in cycles.clocks],
        "angle_error_budget_deg": [jsonable(asdict(row)) for row in cycles.angle_errors],
        "cut_flow": [asdict(row) for row in cycles.cut_flow],
        "findings": [asdict(finding) for finding in cycles.findings],
        **{key: jsonable(value) for key, value in cycles.details.items() if not isinstance(value, np.ndarray)},
    }


def alignment_details(base: TimeBase, aligned: Mapping[str, AlignedChannel]) -> dict[str, dict[str, Any]]:
    """Return what the record's own fields do not hold: triggers, clocks, resampling."""
    names = {rule: name for name, rule in RULES.items()}
    return {
        "triggers": {
            logger: {
                "channel": trigger.channel.name,
                "edge": trigger.edges.edge,
                "pulses": int(trigger.train.time.size - trigger.train.repaired.sum()),
                "height_v": trigger.edges.height,
                "width_s": trigger.edges.width,
                "edge_noise_s": trigger.edges.noise,
                **{key: int(count) for key, count in trigger.train.counts.items()},
            }
            for logger, trigger in base.triggers.items()
        },
        "clock_fits": {
            logger: {
                "stderr_skew_ppm": 1e6 * clock.stderr_skew,
                "residual_std_s": clock.residual_std,
                "lag_pulses": clock.lag,
                "lag_log_likelihood_ratio": clock.evidence,
                "jumps_at_s": list(clock.breaks),
            }
            for logger, clock in base.clocks.items()
        },
        "resampling": {
            quantity: {
                "rule": names[item.rule],
                "text": ANTI_ALIAS[names[item.rule]],
                "samples_per_step": item.samples_per_step,
            }
            for quantity, item in aligned.items()
        },
    }
