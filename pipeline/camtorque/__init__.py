"""camtorque: from rig recordings to a measured-vs-model torque report.

::

    files    --read-->        Recording --align--> CamCycles
    arrays   --from_arrays--> Recording --fit----> Result --report--> report.html, result.json, cycles.h5
    pump.toml --predict-----> Prediction            |--> to_pandas, to_xarray

The names below are the public face (`camtorque.api`); each is loaded when it is first used, so that importing the
package costs nothing. Everything else is private to its room: units, records, config -> signal -> ingest -> align ->
mechanism -> laws -> fit -> report -> design -> run -> campaign -> api, commands -> cli.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from camtorque.process.caches import find_caches
from camtorque.version import __version__

if TYPE_CHECKING:
    from camtorque.api import (
        AlignOptions,
        CamCycles,
        Limit,
        Prediction,
        PressureCurve,
        Recording,
        Refusal,
        Result,
        RunOptions,
        Sensor,
        align,
        fit,
        predict,
        read,
        report,
        to_pandas,
        to_xarray,
    )
    from camtorque.lmfit_fit import own_fit

# before numba is imported: it looks for the folder of its cache once
find_caches(Path(__file__).parent)

__all__ = [
    "AlignOptions",
    "CamCycles",
    "Limit",
    "Prediction",
    "PressureCurve",
    "Recording",
    "Refusal",
    "Result",
    "RunOptions",
    "Sensor",
    "__version__",
    "align",
    "fit",
    "own_fit",
    "predict",
    "read",
    "report",
    "to_pandas",
    "to_xarray",
]


ELSEWHERE = {"own_fit": "camtorque.lmfit_fit"}
"""Names that are not of `camtorque.api`: lmfit takes longer to import than all the rest."""
ROOMS_OF_THAT_NAME = ("align", "fit", "report")
"""Functions of the face that share their name with a room; ``camtorque.fit`` is the function, ``camtorque.fit.x`` in an
import statement the room."""


def __getattr__(name: str) -> Any:
    """Load a name of the public face."""
    if name not in __all__:
        raise AttributeError(f"module 'camtorque' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(ELSEWHERE.get(name, "camtorque.api")), name)


def __dir__() -> list[str]:
    """Return the names of the public face."""
    return __all__


class _Face(ModuleType):
    """The package, whose functions stay in place when a room of the same name is imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in ROOMS_OF_THAT_NAME:
            super().__setattr__(name, value)
        # importing the room binds it here; a statement `from camtorque.fit import ...` does not look here
        elif not isinstance(value, ModuleType):
            raise AttributeError(f"camtorque.{name} cannot be replaced")


sys.modules[__name__].__class__ = _Face
