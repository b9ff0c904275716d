"""The 27 non-linear sets of NIST StRD: reader and models, written from the formula in each file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "nist"
exp, cos, sin, arctan = np.exp, np.cos, np.sin, np.arctan


@dataclass(frozen=True)
class Reference:
    starts: np.ndarray
    certified: np.ndarray
    deviations: np.ndarray
    residual_sum: float
    y: np.ndarray
    x: np.ndarray


def read_reference(name: str) -> Reference:
    lines = (FOLDER / f"{name}.dat").read_text().splitlines()
    rows = [re.split(r"[=\s]+", line.strip()) for line in lines[40:58] if re.match(r"\s*b\d+\s*=", line)]
    table = np.array([[float(v) for v in row[1:5]] for row in rows])
    residual_sum = float(next(line for line in lines if "Residual Sum of Squares" in line).split(":")[1])
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()])
    return Reference(table[:, :2].T, table[:, 2], table[:, 3], residual_sum, data[:, 0], data[:, 1:].T)


def gauss(b, x):
    peaks = b[2] * exp(-((x - b[3]) ** 2) / b[4] ** 2) + b[5] * exp(-((x - b[6]) ** 2) / b[7] ** 2)
    return b[0] * exp(-b[1] * x) + peaks


def lanczos(b, x):
    return b[0] * exp(-b[1] * x) + b[2] * exp(-b[3] * x) + b[4] * exp(-b[5] * x)


def cubic_ratio(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def enso(b, x):
    angle = 2 * np.pi * x
    year = b[1] * cos(angle / 12) + b[2] * sin(angle / 12)
    return (
        b[0] + year + b[4] * cos(angle / b[3]) + b[5] * sin(angle / b[3])
        + b[7] * cos(angle / b[6]) + b[8] * sin(angle / b[6])
    )  # fmt: skip


def chwirut(b, x):
    return exp(-b[0] * x) / (b[1] + b[2] * x)


MODELS = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
    "Chwirut1": chwirut,
    "Chwirut2": chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": enso,
    "Eckerle4": lambda b, x: b[0] / b[1] * exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": gauss,
    "Gauss2": gauss,
    "Gauss3": gauss,
    "Hahn1": cubic_ratio,
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": lanczos,
    "Lanczos2": lanczos,
    "Lanczos3": lanczos,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * exp(-x * b[3]) + b[2] * exp(-x * b[4]),
    "Misra1a": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** (-2)),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** (-0.5)),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": cubic_ratio,
}


def residual_of(name: str, reference: Reference):
    """Return model - data as a function of named parameters; Nelson fits the logarithm of the response."""
    x = reference.x if name == "Nelson" else reference.x[0]
    y = np.log(reference.y) if name == "Nelson" else reference.y
    names = [f"b{k + 1}" for k in range(reference.certified.size)]
    return lambda values: MODELS[name]([values[n] for n in names], x) - y
