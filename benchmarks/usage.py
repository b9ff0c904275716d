"""Run a command and print what it took as JSON: a small parent, since a child begins with its parent's peak memory.

python benchmarks/usage.py COMMAND...
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

if __name__ == "__main__":
    began = time.perf_counter()
    child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    found = {"wall": time.perf_counter() - began, "processor": usage.ru_utime + usage.ru_stime}
    print(json.dumps({**found, "megabytes": usage.ru_maxrss / 1024.0}))
    sys.exit(os.waitstatus_to_exitcode(status))
