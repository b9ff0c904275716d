"""Labels of parameters as names that lmfit accepts."""

from __future__ import annotations

import re

from camtorque.fit.problem import Problem


def lmfit_name(label: str) -> str:
    """Return a label with characters outside ``[A-Za-z0-9_]`` replaced by ``_``."""
    return re.sub(r"\W", "_", label, flags=re.ASCII)


def lmfit_names(problem: Problem) -> dict[str, str]:
    """Return label -> name of every free parameter of a problem.

    Raises
    ------
    ValueError
        When two recordings' own parameters would get the same name.
    """
    labels = [slot.name for slot in (*problem.nonlinear, *problem.linear)]
    names = {label: lmfit_name(label) for label in labels}
    if len(set(names.values())) != len(labels):
        raise ValueError("two recordings differ only in characters that lmfit does not allow; rename one of them")
    return names
