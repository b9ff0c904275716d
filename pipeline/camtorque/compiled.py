"""Functions that numba compiles where they are first needed: importing numba costs what reading and aligning 3 s costs.

`njit` is numba's, put off. A function of single numbers that compiled loops call is also called with arrays, by
commands that do without compiled code: `elementwise` says that it is the same function both ways.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from types import ModuleType
from typing import Any

from camtorque.process.caches import made_from

HERE = Path(__file__).parent


class Compiled:
    """A function that is compiled, or loaded from numba's cache, at its first call; to numba it is a dispatcher.

    ``py_func`` and ``targetoptions`` are the names by which numba inlines a function.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func, self.targetoptions = function, options
        update_wrapper(self, function)

    @cached_property
    def dispatcher(self) -> Any:
        """What numba makes of the function, or kept of these sources."""
        made = load_compiler().njit(**self.targetoptions)(self.py_func)
        if self.targetoptions.get("cache") and not made_from(HERE, Path(made.stats.cache_path)):
            made = load_compiler().njit(**{**self.targetoptions, "cache": False})(self.py_func)
        return made

    @property
    def is_kept(self) -> bool:
        """Whether an earlier process has left the function compiled, so that it has only to be loaded."""
        folder = self.dispatcher.stats.cache_path
        kept = f"{Path(self.py_func.__code__.co_filename).stem}.{self.py_func.__qualname__}-*.nbi"
        return folder is not None and any(Path(folder).glob(kept))

    def __call__(self, *arguments: Any) -> Any:
        """Run the compiled function."""
        return self.dispatcher(*arguments)


class Elementwise(Compiled):
    """A function that is plain in Python, for numbers and arrays, and compiled where a compiled function calls it."""

    def __call__(self, *arguments: Any) -> Any:
        """Run the function as it is written."""
        return self.py_func(*arguments)


LINEAR_ALGEBRA = "scipy.linalg.cython_blas"
"""What numba asks for as it begins, and again wherever a function has a product of matrices: no function here has."""


@contextmanager
def _not_imported(name: str) -> Iterator[None]:
    """Make a module that is not imported yet look missing for a while."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        del sys.modules[name]


@cache
def load_compiler() -> ModuleType:
    """Return numba, set up to type these functions; importing scipy for it would take 0.15 s.

    What `compiled_pays` asks for: called where compiled functions will be called in any case.
    """
    import numba
    from numba.core.registry import cpu_target
    from numba.extending import typeof_impl

    with _not_imported(LINEAR_ALGEBRA):
        cpu_target.target_context.refresh()
    typeof_impl.register(Compiled)(lambda value, _: numba.typeof(value.dispatcher))
    return numba


COMPILED_FROM, LOADED_FROM = 4_000_000, 15_000_000
"""Samples of a channel from which compiled passes are taken where compiled code is loaded anyhow (a run), and from
which loading it, half a second, pays by itself."""


def compiled_pays(n_samples: int) -> bool:
    """Tell whether compiled passes over a channel of that many samples cost less than plain ones."""
    return n_samples >= (COMPILED_FROM if "numba" in sys.modules else LOADED_FROM)


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Return a function that numba compiles when it is called first, with the options of numba's decorator."""
    return partial(njit, **options) if function is None else Compiled(function, options)


def elementwise(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Return a function of numbers that holds for arrays too, with the options of `njit`."""
    return partial(elementwise, **options) if function is None else Elementwise(function, options)
