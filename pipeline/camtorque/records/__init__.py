"""The frozen objects handed from room to room, each in the file of the room that makes it.

`Recording` (files, SI) -> `CamCycles` (cam angle) -> `RigidTorque` (mechanism) -> `FittedTorque` (fit).
Everything is SI and radians; a unit suffix marks a border value. Arrays are made read-only at birth.
"""

from camtorque.records.base import (
    CONTROL,
    SEVERITIES,
    Array,
    Estimate,
    Finding,
    Integers,
    Mask,
    ReadOnly,
    Refusal,
    printable,
    require,
)
from camtorque.records.cycles import (
    DEVIATION,
    DEVIATION_ERRORS,
    LEAD,
    ORDERS_TOLD,
    PASSED,
    TEETH,
    AngleError,
    CamCycles,
    ClockFit,
    CutFlowRow,
)
from camtorque.records.fitted import (
    APART,
    EITHER_LOSS,
    KNOWLEDGE,
    TOGETHER,
    UNTOLD,
    VERDICTS,
    Alternative,
    FittedTorque,
    LossEvidence,
    Metrics,
    ParameterEstimate,
    ResidualBump,
)
from camtorque.records.recording import (
    MOST_LOBES,
    CamTable,
    Channel,
    InputFile,
    Recording,
    SampleSource,
    SensorCalibration,
)
from camtorque.records.rigid import Flight, Forces, RigidTorque
