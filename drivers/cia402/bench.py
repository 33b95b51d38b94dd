"""What is known of a drive that is not the one of the table: whose it is, and what it does not say of itself."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BenchDrive:
    """A bought drive. None: as the table has it, or as the drive says.

    `any_identity`: 1018h may say what it likes; else `vendor_id` and `product_code` where they are given, the table's where neither is.
    `position_unit`, `velocity_unit`, `acceleration_unit`: what 60A8h, 60A9h, 60AAh would say (unit words) in a drive without them.
    `rated_torque_mNm`: rated torque at the joint in mN·m (mN for the lift), in the place of 6076h and of the gear 6091h.
    `accept_missing`: indices of protecting objects that may be missing, or be read-only with a looser value.
    """

    any_identity: bool = False
    vendor_id: int | None = None
    product_code: int | None = None
    position_unit: int | None = None
    velocity_unit: int | None = None
    acceleration_unit: int | None = None
    rated_torque_mNm: int | None = None
    accept_missing: frozenset[int] = frozenset()
