"""What a machine is: links, joints, closures and roles, as frozen data without mathematics."""

from paraopt.mechanism.closures import Closure, Coincidence
from paraopt.mechanism.joints import Cylindrical, Fixed, Joint, Motion, Prismatic, Revolute, Spherical, Universal
from paraopt.mechanism.links import Base, Link, Mobile, Series
from paraopt.mechanism.mechanism import Mechanism, Variable

__all__ = [
    "Base",
    "Closure",
    "Coincidence",
    "Cylindrical",
    "Fixed",
    "Joint",
    "Link",
    "Mechanism",
    "Mobile",
    "Motion",
    "Prismatic",
    "Revolute",
    "Series",
    "Spherical",
    "Universal",
    "Variable",
]
