"""Pump data and pressure over cam angle -> torque by cause, contact and joint forces, Hertz stress.

::

    CamTable, sections -> CamLaw -> kinematics, friction -> torque -> solve_rigid -> RigidTorque
                                    denoc, recursion   the same numbers, link by link, without friction
                                    shaft, elastic     several pumps on one shaft, rigid or with springs
                                    kernel             many cycles in one compiled pass
                                    predict            a pump without a recording
"""

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import ContactLoss
from camtorque.mechanism.friction import Friction, jamming_friction
from camtorque.mechanism.interpolants import cubic_law, quintic_law, smoothing_law
from camtorque.mechanism.kinematics import Kinematics, kinematics
from camtorque.mechanism.lift_laws import LIFT_METHODS, lift_law
from camtorque.mechanism.mounting import Mounting, PumpUnit, Roller, assumed_roller
from camtorque.mechanism.shaft import METHODS, ShaftForces, solve_shaft
from camtorque.mechanism.solve import forces_of, solve_rigid
from camtorque.mechanism.spectral import spectral_law
from camtorque.mechanism.torque import CAUSES, OUTPUTS, ClosedForm, closed_form_tables

__all__ = [
    "CAUSES",
    "LIFT_METHODS",
    "METHODS",
    "OUTPUTS",
    "CamLaw",
    "ClosedForm",
    "ContactLoss",
    "Friction",
    "Kinematics",
    "Mounting",
    "PumpUnit",
    "Roller",
    "ShaftForces",
    "assumed_roller",
    "closed_form_tables",
    "cubic_law",
    "forces_of",
    "jamming_friction",
    "kinematics",
    "lift_law",
    "quintic_law",
    "smoothing_law",
    "solve_rigid",
    "solve_shaft",
    "spectral_law",
]
