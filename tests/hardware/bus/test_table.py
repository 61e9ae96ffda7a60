"""Control tables: many registers decoded in one pass are what each gives alone."""

from __future__ import annotations

import random

import pytest

from armctl.hardware.bus.table import ControlTable
from armctl.hardware.dynamixel.make import TABLE as DYNAMIXEL
from armctl.hardware.feetech.make import TABLE as STS
from armctl.hardware.feetech.scs import TABLE as SCS


@pytest.mark.parametrize("table", [STS, SCS, DYNAMIXEL], ids=["STS", "SCS", "Dynamixel"])
def test_registers_read_in_one_pass_are_what_each_gives_alone(table: ControlTable) -> None:
    chance = random.Random(0)
    names = [one.name for one in table.registers]
    for _ in range(50):
        chosen = sorted(chance.sample(range(len(names)), 9))
        some = [names[k] for k in chosen]
        first = chance.randint(0, table[some[0]].address)
        data = chance.randbytes(table.size - first)
        assert table.reader(some, first)(data) == [table.decode(one, data, first) for one in some]
