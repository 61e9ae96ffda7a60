"""Text of files from other programs."""

from __future__ import annotations

from armctl.errors import ProgramError

_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def plain_text(text: bytes | str) -> str:
    """The text of a file: UTF-8, without a byte order mark, lines ended as they are.

    Raises:
        ProgramError: another encoding; says what to do.
    """
    if isinstance(text, bytes):
        if text.startswith(_UTF16):
            raise ProgramError("is not a text file in UTF-8 but in UTF-16; save it as UTF-8")
        try:
            text = text.decode()
        except UnicodeDecodeError as cause:
            raise ProgramError(
                f"is not a text file in UTF-8: byte {cause.start + 1} cannot be read; save it as UTF-8"
            ) from cause
    return text.removeprefix("\ufeff")
