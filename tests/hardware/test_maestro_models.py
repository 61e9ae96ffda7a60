from __future__ import annotations

import pytest

from armctl.hardware.maestro.codec import MaestroModel
from armctl.hardware.ports import listing_of


@pytest.mark.parametrize(
    ("product", "channels", "multiple"),
    [(0x0089, 6, False), (0x008A, 12, True), (0x008B, 18, True), (0x008C, 24, True)],
)
def test_the_family_by_its_usb_numbers(product, channels, multiple):
    model = MaestroModel.from_label(listing_of(0x1FFB, product))
    assert model is not None
    assert (model.channels, model.has_multiple_targets) == (channels, multiple)
    assert MaestroModel.from_label(model.label) is model


def test_other_boards_are_not_maestros():
    for vendor, product in ((0x1FFB, 0x0083), (0x2341, 0x0089), (None, None)):
        assert MaestroModel.from_label(listing_of(vendor, product)) is None
    assert MaestroModel.from_label("Arduino Mega") is None


@pytest.mark.parametrize(("count", "channels"), [(0, 6), (6, 6), (7, 12), (13, 18), (24, 24), (25, 24)])
def test_the_smallest_board_with_enough_channels(count, channels):
    assert MaestroModel.with_channels(count).channels == channels
