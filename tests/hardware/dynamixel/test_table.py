"""Our control table against the tables that ROBOTIS ships with its SDK, model by model."""

from __future__ import annotations

from importlib.resources import files

import pytest

from armctl.hardware.dynamixel.make import MODELS, TABLE

TABLES = files("dynamixel_easy_sdk") / "control_table"
NAMES = {"model": "model_number", "torque": "torque_enable", "secondary_id": "secondary(shadow)_id"}
"""those that ROBOTIS calls otherwise"""


def rows(file: str) -> list[list[str]]:
    return [line.split("\t") for line in (TABLES / file).read_text().splitlines()]


def published() -> dict[int, str]:
    """File names by model number."""
    return {int(number): file for number, file in rows("dynamixel.model")[1:]}


@pytest.mark.parametrize("model", MODELS)
def test_each_register_is_where_robotis_has_it(model: int):
    file = published()[model]
    lines = rows(file)
    begin = next(i for i, line in enumerate(lines) if line[0] == "Address")
    theirs = {
        row[2].lower().replace(" ", "_"): (int(row[0]), int(row[1])) for row in lines[begin + 1 :] if row[0]
    }
    ours = {NAMES.get(one.name, one.name): (one.address, one.size) for one in TABLE.registers}
    missing = {"feedforward_1st_gain", "feedforward_2nd_gain", "moving_status"} - theirs.keys()
    assert {name: place for name, place in ours.items() if name not in missing} == {
        name: place for name, place in theirs.items() if name in ours
    }


@pytest.mark.parametrize("model", MODELS)
def test_each_model_has_its_name(model: int):
    assert published()[model].removesuffix(".model") == MODELS[model].lower().replace("-", "_")
