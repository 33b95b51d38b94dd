"""Kinematics and dynamics of the arms and of the platform under one of them."""

from stack.kinematics.arm import ArmModel, ArmState
from stack.kinematics.platform import extended_jacobian

__all__ = ["ArmModel", "ArmState", "extended_jacobian"]
