"""Firefox and WebKit, driven through their own automation: what a person does there, by names and keys.

Playwright drives its own builds of both only; these are Debian's. Firefox speaks Marionette, WebKitGTK (what
Safari is made of) WebDriver over HTTP. WebKitGTK has no window without a display, so it gets a virtual one.
It takes its language from ``LANG``: with the language C, viser's page fails in JavaScript's own ``Intl``.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import subprocess
import tempfile
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from tests.browser.kit import FORGET_CLICKS, PATIENCE_MS, WAS_CLICKED, WATCH_CLICKS

SIZE = (1280, 900)
_GLANCE_S = 0.05
_ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
"""the key of an element's id (W3C WebDriver, 11)"""
_MINI_BROWSERS = ("/usr/lib/*/webkit2gtk-4.1/MiniBrowser", "/usr/lib/*/webkit2gtk-4.0/MiniBrowser")
_FIND = """// one script finds and looks: the page may draw an element anew in between
  const [what, label] = arguments;
  const found = () => {
    const seen = (one) => one.checkVisibility() && one.getBoundingClientRect().width > 0;
    const name = (one) => (one.getAttribute("aria-label") ?? one.innerText).trim();
    const all = (selector) => Array.from(document.querySelectorAll(selector)).filter(seen);
    switch (what) {
      case "button": return all("button").find((one) => name(one) === label) ?? null;
      case "tab": return all("[role=tab]").find((one) => one.title === label) ?? null;
      case "row": return all("[role=grid] [role=row]")[Number(label)] ?? null;
      case "field": {
        const head = all("label[for]").find((one) => one.innerText.trim() === label);
        for (let at = head; at; at = at.parentElement) {
          const box = at.querySelector("input:not([type=hidden]), textarea");
          if (box) return box;
        }
        return null;
      }
    }
  };
"""
_PLACE = """
  const box = found()?.getBoundingClientRect();
  return [found(), box ? [box.left, box.top, box.width, box.height] : null];
"""
_WATCH = f"""
  window.armctlPressed = arguments[0];
  if (!window.armctlClicked) {{ {WATCH_CLICKS} }}
  ({FORGET_CLICKS})();
"""
_WAS_CLICKED = f"return ({WAS_CLICKED})(window.armctlPressed)"


class Automation(Protocol):
    """What both browsers' drivers can do."""

    def open(self, url: str) -> None: ...
    def run(self, script: str, *arguments: object) -> Any: ...
    def click(self, element: Any) -> None: ...
    def type(self, element: Any, text: str) -> None: ...
    def picture(self) -> bytes: ...
    def close(self) -> None: ...


class Firefox:
    """Debian's Firefox ESR without a window, through Marionette: length, colon, and a list in JSON."""

    def __init__(self) -> None:
        self._profile = tempfile.TemporaryDirectory()
        port = free_port()
        settings = {
            "marionette.port": port,
            "app.update.enabled": False,
            "browser.shell.checkDefaultBrowser": False,
        }
        Path(self._profile.name, "user.js").write_text(
            "".join(f"user_pref({json.dumps(key)}, {json.dumps(one)});\n" for key, one in settings.items())
        )
        self._process = subprocess.Popen(
            [
                found("firefox-esr"),
                "--headless",
                "--marionette",
                "--profile",
                self._profile.name,
                "--no-remote",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._line = self._connected(port)
        self._stream = self._line.makefile("rb")
        self._read()  # it introduces itself
        self._ask("WebDriver:NewSession")
        self._ask("WebDriver:SetWindowRect", width=SIZE[0], height=SIZE[1])

    def open(self, url: str) -> None:
        self._ask("WebDriver:Navigate", url=url)

    def run(self, script: str, *arguments: object) -> Any:
        return self._ask("WebDriver:ExecuteScript", script=script, args=list(arguments))["value"]

    def click(self, element: Any) -> None:
        self._ask("WebDriver:ElementClick", id=element[_ELEMENT])

    def type(self, element: Any, text: str) -> None:
        self._ask("WebDriver:ElementSendKeys", id=element[_ELEMENT], text=text)

    def picture(self) -> bytes:
        return base64.b64decode(self._ask("WebDriver:TakeScreenshot", full=False)["value"])

    def close(self) -> None:
        self._stream.close()
        self._line.close()
        self._process.terminate()
        self._process.wait(20)
        self._profile.cleanup()

    def _connected(self, port: int) -> socket.socket:
        for _ in range(600):
            with suppress(OSError):
                return socket.create_connection(("127.0.0.1", port), timeout=60)
            threading.Event().wait(_GLANCE_S)
        raise AssertionError("Firefox does not open its port for Marionette")

    def _ask(self, command: str, **parameters: object) -> Any:
        data = json.dumps([0, 1, command, parameters]).encode()
        self._line.sendall(b"%d:%b" % (len(data), data))
        _, _, error, result = self._read()
        if error is not None:
            raise AssertionError(f"{command}: {error['message']}")
        return result

    def _read(self) -> Any:
        size = b""
        while (one := self._stream.read(1)) != b":":
            size += one
        return json.loads(self._stream.read(int(size)))


class WebKit:
    """Debian's WebKitGTK on a virtual display."""

    def __init__(self) -> None:
        reads, writes = os.pipe()
        self._display = subprocess.Popen(
            [found("Xvfb"), "-displayfd", str(writes), "-screen", "0", "1400x1000x24", "-nolisten", "tcp"],
            pass_fds=(writes,),
            stderr=subprocess.DEVNULL,
        )
        os.close(writes)
        with os.fdopen(reads) as told:
            display = f":{told.readline().strip()}"
        environment = {key: value for key, value in os.environ.items() if not key.startswith("LC_")}
        environment |= {"DISPLAY": display, "LANG": "en_US.UTF-8", "LANGUAGE": "en_US:en"}
        port = free_port()
        self._driver = subprocess.Popen(
            [found("WebKitWebDriver"), f"--port={port}"],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._address = f"http://127.0.0.1:{port}/session"
        window = {"binary": mini_browser(), "args": ["--automation", "--enable-webgl=false"]}
        begun = self._begun(window)
        self._address += f"/{begun['sessionId']}"
        self._ask("window/rect", width=SIZE[0], height=SIZE[1])

    def open(self, url: str) -> None:
        self._ask("url", url=url)

    def run(self, script: str, *arguments: object) -> Any:
        return self._ask("execute/sync", script=script, args=list(arguments))

    def click(self, element: Any) -> None:
        self._ask(f"element/{element[_ELEMENT]}/click")

    def type(self, element: Any, text: str) -> None:
        self._ask(f"element/{element[_ELEMENT]}/value", text=text)

    def picture(self) -> bytes:
        return base64.b64decode(self._ask("screenshot", method="GET"))

    def close(self) -> None:
        try:
            self._ask("", method="DELETE")
        finally:
            for process in (self._driver, self._display):
                process.terminate()
                process.wait(20)

    def _begun(self, window: Mapping[str, object]) -> Any:
        wanted = {"alwaysMatch": {"webkitgtk:browserOptions": window}}
        for _ in range(600):
            with suppress(urllib.error.URLError):
                return self._ask("", capabilities=wanted)
            threading.Event().wait(_GLANCE_S)
        raise AssertionError("WebKitWebDriver does not open its port")

    def _ask(self, path: str, method: str = "POST", **parameters: object) -> Any:
        request = urllib.request.Request(
            f"{self._address}/{path}".rstrip("/"),
            json.dumps(parameters).encode() if method == "POST" else None,
            {"Content-Type": "application/json"},
            method=method,
        )
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            with error:
                raise AssertionError(f"{path}: {error.read().decode()}") from error


class OtherScreen:
    """One page, looked at as the operator does; the names are those of ``kit.Screen``."""

    def __init__(self, browser: Automation) -> None:
        self._browser = browser

    def open(self, url: str, *, until: str) -> None:
        """Open a page and wait until it shows the button ``until``."""
        self._browser.open(url)
        self._find("button", until)

    def leave(self) -> None:
        """Nothing is kept for the next test."""
        self._browser.run("sessionStorage.clear(); localStorage.clear()")
        self._browser.open("about:blank")

    def click(self, label: str) -> None:
        """Press the button with this label once it may be pressed, and again where it moved away meanwhile.

        See ``kit.Screen.press``.
        """
        self.wait_until(lambda: self.is_enabled(label), f"the button {label!r} can be pressed")
        for _ in range(5):
            button = self._find("button", label)
            self._browser.run(_WATCH, button)
            self._browser.click(button)
            if self._browser.run(_WAS_CLICKED):
                return
        raise AssertionError(f"the button {label!r} moves away from each click")

    def is_enabled(self, label: str) -> bool:
        may = "const it = found(); return it?.disabled === false && it.ariaDisabled !== 'true'"
        return self._browser.run(f"{_FIND} {may}", "button", label)

    def open_tab(self, *labels: str) -> None:
        for label in labels:
            self._browser.click(self._find("tab", label))
            self.wait_until(lambda label=label: self._is_selected("tab", label), f"{label} is open")

    def type_into(self, label: str, text: str) -> None:
        """Replace what a field holds, and leave it."""
        box = self._find("field", label)
        self._browser.click(box)
        self._browser.run("arguments[0].select()", box)
        self._browser.type(box, text)
        self._browser.run("arguments[0].blur()", box)
        self.pause()

    def pick_row(self, row: int) -> None:
        """Click a row of the list of steps."""
        self._browser.click(self._find("row", str(row)))
        self.wait_until(lambda: self._is_selected("row", str(row)), f"row {row} is selected")

    def shows(self, text: str) -> bool:
        return text in self._browser.run("return document.body.innerText")

    def wait_for_text(self, text: str) -> None:
        self.wait_until(lambda: self.shows(text), f"the page shows {text!r}")

    def run(self, script: str) -> Any:
        return self._browser.run(script)

    def pause(self) -> None:
        """Let the page send what it has to send: its throttle is 50 ms."""
        self._browser.run("window.armctlPaused = performance.now()")
        self.wait_until(
            lambda: self._browser.run("return performance.now() - window.armctlPaused > 60"), "time passes"
        )

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something, while the page goes on; fails with ``what``."""
        for _ in range(round(PATIENCE_MS / 1000 / _GLANCE_S)):
            if condition():
                return
            threading.Event().wait(_GLANCE_S)
        shown = self._browser.run("return document.body.innerText")
        raise AssertionError(f"waited {PATIENCE_MS / 1000:.0f} s in vain: {what}; the page shows:\n{shown}")

    def screenshot(self, path: Path) -> None:
        path.write_bytes(self._browser.picture())

    def _find(self, what: str, label: str) -> Any:
        """The element, once it stays where it is: what was done before may still make lists longer."""
        element, place = None, None

        def there() -> bool:
            nonlocal element, place
            before = place
            element, place = self._browser.run(f"{_FIND} {_PLACE}", what, label)
            return element is not None and place == before

        self.wait_until(there, f"there is a {what} {label!r} that stays where it is")
        return element

    def _is_selected(self, what: str, label: str) -> bool:
        script = f'{_FIND} return found()?.getAttribute("aria-selected")'
        return self._browser.run(script, what, label) == "true"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def found(program: str) -> str:
    """Where a program is; the tests fail without it, they are never skipped."""
    if path := shutil.which(program):
        return path
    raise FileNotFoundError(f"the browser tests need {program}; `make packages` installs it")


def mini_browser() -> str:
    """The window around WebKitGTK that comes with it."""
    for pattern in _MINI_BROWSERS:
        for path in Path("/").glob(pattern.lstrip("/")):
            return str(path)
    raise FileNotFoundError("the browser tests need WebKitGTK's MiniBrowser; `make packages` installs it")
