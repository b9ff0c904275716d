"""A cycle of a pump with a smooth lift, for problems that take milliseconds."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "laws"))

from laws_cases import chain_input, start_values

__all__ = ["chain_input", "start_values"]
