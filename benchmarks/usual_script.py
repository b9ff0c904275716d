"""What a bench engineer writes for one log: npTDMS, edges of the trigger, pandas groupby over angle bins; the peer.

python benchmarks/usual_script.py LOG.tdms TRIGGER
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from nptdms import TdmsFile

BINS = 3600


def mean_cycles(path: Path, trigger_name: str) -> list[pd.DataFrame]:
    """Return the mean cycle of every other channel: no checks, clocks, delays or cuts."""
    channels = {channel.name: channel for group in TdmsFile.read(path).groups() for channel in group.channels()}
    trigger = channels.pop(trigger_name)
    volts = trigger[:]
    above = volts > 0.5 * (volts.min() + volts.max())
    edges = np.flatnonzero(above[1:] & ~above[:-1]) * trigger.properties["wf_increment"]
    found = []
    for name, channel in channels.items():
        frame = pd.DataFrame({name: channel[:]})
        turn = np.interp(frame.index * channel.properties["wf_increment"], edges, np.arange(edges.size), -1.0, -1.0)
        frame["bin"] = np.floor((turn % 1.0) * BINS).astype(int)
        found.append(frame[turn >= 0.0].groupby("bin").mean())
    return found


if __name__ == "__main__":
    print([len(frame) for frame in mean_cycles(Path(sys.argv[1]), sys.argv[2])])
