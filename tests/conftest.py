"""Found by pytest first: its folder goes onto the import path, so every test can ``from rigs.rig import simulate``."""
