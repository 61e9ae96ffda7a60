from __future__ import annotations

import re
from html import unescape

from armctl.ui.widgets.html_bits import limited


def test_a_long_text_keeps_its_height_and_can_be_read_to_its_end() -> None:
    text = "homing ended: <Shoulder> found no 'zero'; " * 20
    html = limited(text, 4, "color:red")
    assert "max-height:6.0em;overflow-y:auto;color:red" in html
    told = re.fullmatch(r"<div style='[^']*' title='([^']*)'>(.*)</div>", html)
    assert told is not None
    assert [unescape(part) for part in told.groups()] == [text, text]
    assert "<Shoulder>" not in html
