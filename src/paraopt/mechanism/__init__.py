"""What a machine is: links, joints, closures and roles, as frozen data without mathematics."""

from paraopt.mechanism.closing_joints import (
    ClosingCylindrical,
    ClosingJoint,
    ClosingPrismatic,
    ClosingRevolute,
    ClosingSpherical,
    ClosingUniversal,
    LineContact,
    PlanarContact,
)
from paraopt.mechanism.closures import (
    Closure,
    Coincidence,
    ParallelAxes,
    ParallelPlanes,
    PerpendicularAxes,
    PointOnLine,
    PointOnPlane,
    Weld,
)
from paraopt.mechanism.joints import Cylindrical, Fixed, Joint, Motion, Prismatic, Revolute, Spherical, Universal
from paraopt.mechanism.links import Base, Link, Mobile, Series
from paraopt.mechanism.mechanism import Mechanism, Variable

__all__ = [
    "Base",
    "ClosingCylindrical",
    "ClosingJoint",
    "ClosingPrismatic",
    "ClosingRevolute",
    "ClosingSpherical",
    "ClosingUniversal",
    "Closure",
    "Coincidence",
    "Cylindrical",
    "Fixed",
    "Joint",
    "LineContact",
    "Link",
    "Mechanism",
    "Mobile",
    "Motion",
    "ParallelAxes",
    "ParallelPlanes",
    "PerpendicularAxes",
    "PlanarContact",
    "PointOnLine",
    "PointOnPlane",
    "Prismatic",
    "Revolute",
    "Series",
    "Spherical",
    "Universal",
    "Variable",
    "Weld",
]
