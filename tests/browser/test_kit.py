"""The browser tests' own hands: a press counts only where it arrived."""

from __future__ import annotations

import pytest
from tests.browser.kit import Screen

# A page whose layout gives way under the mouse: at the first ``misses`` presses the button slides out
# between down and up, of which a browser makes no click on it.
GIVES_WAY = """
<div id="above" style="height: 0"></div><button>Go</button><p>0</p>
<script>
  let misses = %d, clicks = 0;
  const above = document.getElementById("above");
  document.querySelector("button").addEventListener("mousedown", () => {
    if (misses-- > 0) above.style.height = above.offsetHeight ? "0" : "200px";
  });
  document.querySelector("button").addEventListener("click", () => {
    document.querySelector("p").textContent = ++clicks;
  });
</script>
"""


def shown(screen: Screen, misses: int) -> None:
    screen.page.route(
        "**/gives-way", lambda route: route.fulfill(body=GIVES_WAY % misses, content_type="text/html")
    )
    screen.page.goto("http://localhost/gives-way")


@pytest.mark.parametrize("misses", [0, 1, 2])
def test_a_press_that_the_layout_swallowed_is_made_again(screen: Screen, misses: int) -> None:
    shown(screen, misses)
    screen.click("Go")
    assert screen.text("p") == "1"


def test_a_button_that_always_gives_way_fails_the_test(screen: Screen) -> None:
    shown(screen, 1000)
    with pytest.raises(AssertionError, match="moves away from each click"):
        screen.click("Go")
    assert screen.text("p") == "0"
