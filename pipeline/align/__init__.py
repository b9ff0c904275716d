"""Recording -> CamCycles: trigger edges, clocks, cam angle, aligned cycles, cut-flow, angle error budget."""

from pipeline.align.cycles import align
from pipeline.align.options import AlignOptions

__all__ = ["AlignOptions", "align"]
