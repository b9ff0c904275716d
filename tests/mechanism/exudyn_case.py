"""The closed mechanism in Exudyn: it gets position constraints only and integrates through time (index-2 trapezoid).

Cam and follower are point masses in their coordinates; the contact is ``y - s(theta) - (x - e) tan phi(theta) = 0``,
whose gradient at x = e is the contact normal over cos phi. Velocities, accelerations and all forces are Exudyn's own:
the torque, the guide force and the contact force along Y1 are the multipliers of drive, guide and contact. The roller
has no inertia here (its spin would need a fourth coordinate).
"""

from __future__ import annotations

import numpy as np

SPEED = 52.0


def pressure_over(angle):
    """A smooth load of 300 bar, so that the integrator's order shows."""
    return 3e7 * np.exp(-(((np.mod(angle, 2.0 * np.pi) - 0.5) / 0.15) ** 2))


class Drive:
    """Prescribed rotation: angle = speed t + ripple sin(2 speed t)."""

    def __init__(self, ripple):
        self.ripple = ripple

    def angle(self, t):
        return SPEED * t + self.ripple * np.sin(2.0 * SPEED * t)

    def rate(self, t):
        return SPEED * (1.0 + 2.0 * self.ripple * np.cos(2.0 * SPEED * t))

    def rate_change(self, t):
        return -4.0 * self.ripple * SPEED**2 * np.sin(2.0 * SPEED * t)


class Contact:
    """The contact constraint, its Jacobian and its velocity form."""

    def __init__(self, pump, law):
        self.law, self.offset = law, pump.follower_offset
        self.base = np.sqrt((pump.base_circle_radius + pump.roller_radius) ** 2 - self.offset**2)

    def gradient(self, q):
        lift, velocity, change = self.law.derivatives(np.array([q[0]]), 2)[:, 0]
        height = self.base + lift
        slope = (velocity - self.offset) / height
        slope_change = (change * height - (velocity - self.offset) * velocity) / height**2
        return height, np.array([-velocity - (q[1] - self.offset) * slope_change, -slope, 1.0])

    def constraint(self, mbs, t, item, q, q_t, velocity_level):
        height, gradient = self.gradient(q)
        if velocity_level:
            return [float(gradient @ np.array(q_t))]
        return [q[2] - height + (q[1] - self.offset) * gradient[1]]

    def jacobian(self, mbs, t, item, q, q_t, velocity_level):
        return self.gradient(q)[1][None, :]


def build(exudyn, items, pump, law, drive):
    """Return the system and the numbers of its drive, guide and contact constraints."""
    mbs = exudyn.SystemContainer().AddSystem()
    contact = Contact(pump, law)
    lift, velocity, _ = law.derivatives(np.zeros(1), 2)[:, 0]
    cam = mbs.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0],
            initialCoordinates=[0.0],
            initialCoordinates_t=[drive.rate(0.0)],
            numberOfODE2Coordinates=1,
        )
    )
    follower = mbs.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[contact.offset, contact.base],
            initialCoordinates=[0.0, lift],
            initialCoordinates_t=[0.0, velocity * drive.rate(0.0)],
            numberOfODE2Coordinates=2,
        )
    )

    def force(mbs, t, item, q, q_t):
        fluid = pump.plunger_area * pressure_over(drive.angle(t))
        return [0.0, -(pump.spring_preload + pump.spring_stiffness * q[1] + fluid)]

    mass = np.diag([pump.follower_mass] * 2)
    mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[cam], massMatrix=np.array([[pump.cam_inertia]])))
    mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=[follower], massMatrix=mass, forceUserFunction=force))
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    along = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)) for node in (cam, follower)]
    ends = [mbs.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node)) for node in (cam, follower)]
    turning = items.CoordinateConstraint(
        markerNumbers=[ground, along[0]],
        offset=0.0,
        offsetUserFunction=lambda mbs, t, item, offset: drive.angle(t),
        offsetUserFunction_t=lambda mbs, t, item, offset: drive.rate(t),
    )
    touching = items.ObjectConnectorCoordinateVector(
        markerNumbers=ends,
        scalingMarker0=np.zeros((1, 1)),
        scalingMarker1=np.zeros((1, 2)),
        velocityLevel=False,
        constraintUserFunction=contact.constraint,
        jacobianUserFunction=contact.jacobian,
    )
    guiding = items.CoordinateConstraint(markerNumbers=[ground, along[1]])
    return mbs, [mbs.AddObject(item) for item in (turning, guiding, touching)]


def integrate(pump, law, ripple, steps):
    """Return time and torque, guide force and contact force along Y1 over one revolution, each (steps + 1,)."""
    import exudyn
    import exudyn.itemInterface as items

    drive = Drive(ripple)
    mbs, constraints = build(exudyn, items, pump, law, drive)
    kind = exudyn.OutputVariableType.Force
    sensors = [
        mbs.AddSensor(items.SensorObject(objectNumber=number, storeInternal=True, outputVariableType=kind))
        for number in constraints
    ]
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = 2.0 * np.pi / SPEED
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = settings.timeIntegration.endTime / steps
    mbs.Assemble()
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    stored = [mbs.GetSensorStoredData(sensor) for sensor in sensors]
    torque, guide, contact = (data[:, 1] for data in stored)
    return drive, stored[0][:, 0], {"torque": -torque, "guide": -guide, "contact_y": -contact}
