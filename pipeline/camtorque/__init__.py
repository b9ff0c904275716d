"""camtorque: from rig recordings to a measured-vs-model torque report."""

__version__ = "0.1.0"
