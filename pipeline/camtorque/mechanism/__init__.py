"""Pump data and pressure over cam angle -> torque by cause, contact and joint forces, Hertz stress.

::

    CamTable, sections -> CamLaw -> kinematics, friction -> torque -> solve_rigid -> RigidTorque
                                    denoc, recursion   the same numbers, link by link, without friction
                                    shaft, elastic     several pumps on one shaft, rigid or with springs
                                    predict            a pump without a recording
"""
