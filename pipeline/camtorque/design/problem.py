"""A design task as an optimisation problem: scaled variables, the values of every response asked for, their slopes.

The variables are the free quantities between their bounds, 0 to 1, then the free coefficients of rise and return of a
B-spline, which do not decrease (so that the flank does not turn back).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from camtorque.design.profile import Family
from camtorque.design.responses import RESPONSES, Design, Evaluated
from camtorque.design.task import Limit, Task
from camtorque.records import Array

STEP = 1.0e-6
"""Step of the forward differences, of the width of the bounds: truncation and rounding both below 1e-5."""
LEAST_RADIUS, LARGEST_LOBE, LARGEST_JAM = 0.05, 359.0, 0.9
"""Always asked for: no undercut [mm], a rest on the base circle [deg], mu tan(phi) of the guide short of jamming."""


Values = Mapping[str, tuple[Array, ...]]
"""Response name -> its values at one design."""


class Problem:
    """One family of flanks under a task."""

    def __init__(self, task: Task, family: Family) -> None:
        self.task, self.family = task, family
        self.low = np.array([v.low for v in task.variables])
        self.width = np.array([v.high - v.low for v in task.variables])
        self.size = self.low.size + 2 * family.size
        self.limits = self._all_limits()
        self.names = tuple(dict.fromkeys((*task.aims, *(limit.response for limit in self.limits))))
        self._seen: dict[bytes, Values] = {}
        self._slopes: dict[bytes, Values] = {}

    def _all_limits(self) -> tuple[Limit, ...]:
        """Return the limits of the task, and those that every cam has to keep, where the task has none as tight."""
        always: tuple[Limit, ...] = (
            Limit("convex_radius_mm", "least", LEAST_RADIUS),
            Limit("contact_force_n", "least", 0.0),
            Limit("lobe_angle_deg", "most", LARGEST_LOBE),
        )
        guide = self.task.config.friction[0]
        if guide > 0.0:
            steepest = round(float(np.rad2deg(np.arctan(LARGEST_JAM / guide))), 1)
            always = (*always, Limit("pressure_angle_rise_deg", "most", steepest))
        own = self.task.limits
        return (*own, *(limit for limit in always if not any(one.as_tight_as(limit) for one in own)))

    def start(self) -> Array:
        """Return the variables of the pump as it is, moved into the bounds; a lift table starts as a modified sine."""
        first = np.array([v.start for v in self.task.variables])
        sections = self.task.config.sections
        kinds = (sections[0].kind, sections[2].kind) if len(sections) == 4 else ("", "")
        return np.concatenate([(first - self.low) / self.width, *(self.family.start(kind) for kind in kinds)])

    @cached_property
    def first_guess(self) -> Evaluated:
        """The design that the search begins with."""
        return self.evaluated(self.start())

    def starts(self, first: Array, more: int) -> list[Array]:
        """Return a design and some more anywhere within the bounds, their flanks near the first guess."""
        generator, free, flanks = np.random.default_rng(self.task.seed), self.low.size, self.start()[self.low.size :]
        return [first, *(np.concatenate([generator.random(free), flanks]) for _ in range(more))]

    def design(self, variables: Array) -> Design:
        """Return the design of some variables."""
        free, size = self.low.size, self.family.size
        own = zip(self.task.variables, self.low + self.width * variables[:free], strict=True)
        values = {**self.task.fixed, **{variable.name: float(value) for variable, value in own}}
        shape = np.clip(variables[free:], 0.0, 1.0)
        return Design(self.family, values, shape[:size].copy(), shape[size:].copy())

    def evaluated(self, variables: Array) -> Evaluated:
        """Return the design of some variables under the loads of the task."""
        return Evaluated(self.design(variables), self.task.config, self.task.loads)

    def values(self, variables: Array) -> Values:
        """Return the values of every response asked for; the last designs are remembered."""
        key = variables.tobytes()
        if key not in self._seen:
            if len(self._seen) > 8:
                self._seen.clear()
            self._seen[key] = self._responses(variables)
        return self._seen[key]

    def _responses(self, variables: Array) -> Values:
        design = self.evaluated(variables)
        return {name: RESPONSES[name].values(design) for name in self.names}

    def slopes(self, variables: Array) -> Values:
        """Return the derivatives of all values, (k, n) each, by forward differences."""
        key = variables.tobytes()
        if key not in self._slopes:
            self._slopes.clear()
            base = self.values(variables)
            slopes = {name: tuple(np.empty((part.size, self.size)) for part in base[name]) for name in self.names}
            for k in range(self.size):
                moved = variables.copy()
                step = STEP if moved[k] + STEP <= 1.0 else -STEP
                moved[k] += step
                after = self._responses(moved)
                for name in self.names:
                    for slope, there, here in zip(slopes[name], after[name], base[name], strict=True):
                        slope[:, k] = (there - here) / step
            self._slopes[key] = slopes
        return self._slopes[key]

    def shape_rules(self) -> Array:
        """Return the matrix of what has to be 0 or more: steps between the coefficients of either flank, (k, n)."""
        size, free = self.family.size, self.low.size
        rows = np.zeros((2 * max(size - 1, 0), self.size))
        for flank in range(2):
            for k in range(size - 1):
                at = free + flank * size + k
                rows[flank * (size - 1) + k, [at, at + 1]] = -1.0, 1.0
        return rows
