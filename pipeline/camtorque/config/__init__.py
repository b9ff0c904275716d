"""TOML at the border -> checked, frozen configuration in SI and radians.

specs                what a recording's configuration holds, one record per table
keys, schemas        what a key may hold; every key of every file
quantities           what a channel can measure
tables               a TOML file -> values by their keys, every problem collected
recording, pump      readers of recording.toml and of a pump file
"""

from camtorque.config.specs import (
    ChannelSpec,
    DriveSpec,
    FluidSpec,
    LoggerSpec,
    PumpData,
    RecordingConfig,
    SensorRef,
    TriggerSpec,
)
