"""Pump data and pressure over cam angle -> torque by cause, contact and joint forces, Hertz stress.

::

    CamTable, sections -> CamLaw -> kinematics, friction -> torque -> solve_rigid -> RigidTorque
                                    denoc              the same numbers by the matrices of the paper
                                    shaft, elastic     several pumps on one shaft, rigid by each method, or with springs
                                    predict            a pump without a recording
"""
