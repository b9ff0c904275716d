"""Found by pytest first: its folder goes onto the import path, so every test can ``from rigs.rig import simulate``."""

import os

# as in every command: two threads over matrices of a hundred rows wait for each other longer than they work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
