"""Recording -> CamCycles: trigger edges, clocks, cam angle, aligned cycles, cut-flow, angle error budget.

options                what a user may choose
sources                channels that tell the angle: trigger, encoder, counter -> pulses of each logger
pulses, teeth          edge times -> pulses, repaired and counted, anew at every mark, by mark or index
counter                a recorded angle -> pulses
places, pattern        where the teeth really are, how the speed varies within the turn
clocks, physics_clock  loggers -> one clock, from pulses or from torque and pressure; clocks that jump
lags                   cycles that come late
timebase               all of the above for a recording; which turn of a crank wheel is which; turns that no pulse shows
angle, resample        pulses -> cam angle -> uniform grid; resample_compiled: the same over long channels
channels               which channels are aligned; one pass over each
polarity, flanks       inverted, swapped; does the cam stand where torque and pressure say
quality                which cycles are used, and why not; edges that jitter
budget, summary        angle error budget, angle inside the revolution from torque and inertia; plain numbers for a file
hum, drift             mains frequency on the torque; levels that move during the recording
cycles                 `align`: all of it, in order
"""

from camtorque.align.budget import angle_correction
from camtorque.align.cycles import align
from camtorque.align.options import AlignOptions
from camtorque.align.quality import CUTS
from camtorque.align.summary import alignment_summary
