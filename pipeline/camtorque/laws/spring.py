"""Spring: catalogue values are known to a few percent, and the data may say a little more."""

from __future__ import annotations

from camtorque.laws.rows import display

ROWS = (
    display("spring_stiffness_error", "d_k", "%", 0.01, (0.0, -15.0, 15.0, 1.0), (0.0, 2.0),
            "relative error of the spring rate", "catalogue, a few percent", "shared", True),
    display("spring_preload_error", "d_F", "%", 0.01, (0.0, -25.0, 25.0, 2.0), (0.0, 5.0),
            "relative error of the preload", "catalogue, a few percent", "shared", True),
)  # fmt: skip
