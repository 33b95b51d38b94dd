"""`[drives.NODE]`: what a scenario says of bought drives on its bus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from config.table import Table
from drivers.cia402.bench import BenchDrive

Unsigned32 = Annotated[int, Field(ge=0, lt=1 << 32)]
Index = Annotated[int, Field(ge=0x1000, lt=1 << 16)]
DriveNode = Literal["11", "12", "21", "22", "23", "24", "25", "26", "27", "28"]


class DriveTable(Table):
    """One drive that is not ours. Without `identity`, `vendor_id`, `product_code` it has to be the one of the table."""

    identity: Literal["table", "any"] = "table"
    vendor_id: Unsigned32 | None = None
    product_code: Unsigned32 | None = None
    position_unit: Unsigned32 | None = None
    velocity_unit: Unsigned32 | None = None
    acceleration_unit: Unsigned32 | None = None
    rated_torque_mNm: Annotated[int, Field(gt=0, lt=1 << 32)] | None = None
    accept_missing: tuple[Index, ...] = ()

    @model_validator(mode="after")
    def _one_identity(self) -> DriveTable:
        if self.identity == "any" and (self.vendor_id is not None or self.product_code is not None):
            raise ValueError('identity = "any" does not go together with vendor_id or product_code')
        if self.product_code is not None and self.vendor_id is None:
            raise ValueError("product_code needs vendor_id: every vendor counts from 1")
        return self


def bench_drives(tables: Mapping[DriveNode, DriveTable]) -> dict[int, BenchDrive]:
    """By node id, as the drive master takes them."""
    return {
        int(node): BenchDrive(
            any_identity=table.identity == "any",
            vendor_id=table.vendor_id,
            product_code=table.product_code,
            position_unit=table.position_unit,
            velocity_unit=table.velocity_unit,
            acceleration_unit=table.acceleration_unit,
            rated_torque_mNm=table.rated_torque_mNm,
            accept_missing=frozenset(table.accept_missing),
        )
        for node, table in tables.items()
    }
