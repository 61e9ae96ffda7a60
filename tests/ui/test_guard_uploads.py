from __future__ import annotations

import pytest

from armctl.ui.guard.filter import UploadLedger
from armctl.ui.guard.messages import MAX_UPLOAD_BYTES, UPLOAD_PART_BYTES, UploadPart, UploadStart


def start(size: int, parts: int, *, transfer: str = "t") -> UploadStart:
    return UploadStart("button", transfer, "a.toml", "", parts, size)


def part(index: int, size: int, *, transfer: str = "t", button: str = "button") -> UploadPart:
    return UploadPart(button, transfer, index, b"." * size)


def test_parts_may_come_in_any_order() -> None:
    ledger = UploadLedger()
    assert ledger.starts(start(UPLOAD_PART_BYTES + 5, 2))
    assert ledger.continues(part(1, 5))
    assert ledger.continues(part(0, UPLOAD_PART_BYTES))
    assert not ledger.continues(part(0, UPLOAD_PART_BYTES))


def test_a_part_without_start_is_refused() -> None:
    assert not UploadLedger().continues(part(0, 5))


@pytest.mark.parametrize(
    "wrong",
    [part(0, 4), part(0, 6), part(1, 5), part(0, 5, button="another"), part(0, 5, transfer="u"), part(0, 0)],
)
def test_a_part_is_exactly_what_was_announced(wrong: UploadPart) -> None:
    ledger = UploadLedger()
    assert ledger.starts(start(5, 1))
    assert not ledger.continues(wrong)
    assert ledger.continues(part(0, 5))


@pytest.mark.parametrize(("size", "parts"), [(5, 0), (5, 2), (0, 1), (UPLOAD_PART_BYTES + 1, 1)])
def test_size_and_count_of_parts_agree(size: int, parts: int) -> None:
    assert not UploadLedger().starts(start(size, parts))


def test_two_transfers_at_once_are_enough() -> None:
    ledger = UploadLedger()
    assert ledger.starts(start(5, 1, transfer="a"))
    assert not ledger.starts(start(5, 1, transfer="a"))
    assert ledger.starts(start(5, 1, transfer="b"))
    assert not ledger.starts(start(5, 1, transfer="c"))
    assert ledger.continues(part(0, 5, transfer="a"))
    assert ledger.starts(start(5, 1, transfer="c"))


def test_an_empty_file_has_no_parts() -> None:
    ledger = UploadLedger()
    assert all(ledger.starts(start(0, 0, transfer=str(n))) for n in range(5))


def test_the_parts_of_a_file_that_is_too_large_are_known_and_each_counts_once() -> None:
    ledger = UploadLedger()
    assert not ledger.is_too_large(start(MAX_UPLOAD_BYTES, 16))
    assert ledger.is_too_large(start(MAX_UPLOAD_BYTES + 1, 17))
    assert [ledger.is_leftover(part(index, 5)) for index in range(19)] == [True] * 17 + [False] * 2
    assert not ledger.continues(part(0, 5))


def test_only_two_files_that_are_too_large_are_remembered() -> None:
    ledger = UploadLedger()
    for transfer in "abc":
        assert ledger.is_too_large(start(MAX_UPLOAD_BYTES + 1, 17, transfer=transfer))
    assert [ledger.is_leftover(part(0, 5, transfer=transfer)) for transfer in "abcd"] == [
        True,
        True,
        False,
        False,
    ]
