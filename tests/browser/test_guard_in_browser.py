"""A real browser at the guarded server: everything that a screen uses works, and the tricks do not."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import Browser
from tests.browser.guard_console import Console
from tests.browser.kit import Screen, Screens
from tests.ui.tls_files import CERTIFICATE, KEY

from armctl.ui.guard import encryption

pytestmark = pytest.mark.browser

TOKEN = "a-secret-of-some-length_0123456789"


@pytest.fixture
def console() -> Iterator[Console]:
    console = Console()
    yield console
    console.server.stop()


class _ForeignPage(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<p>a page of somebody else</p>")

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def elsewhere() -> Iterator[str]:
    """A web server of somebody else on this computer, which the browser itself lets call us."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _ForeignPage) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


def test_a_click_arrives_on_the_event_loop_which_can_answer_also_after_a_lost_connection(
    console: Console, screen: Screen
) -> None:
    screen.open(console.url, until="STOP")
    screen.click("STOP", within=screen.panel("Control"))
    label, client_id = console.next_event()
    assert (label, client_id) == ("STOP", next(iter(console.server.get_clients())))
    assert len(console.loop_threads) == 1
    assert not next(iter(console.loop_threads)).startswith("ThreadPoolExecutor")
    screen.wait_for_notification("The arm holds its position.")
    assert screen.notifications() == ["Stopped\nThe arm holds its position."]
    assert screen.text("#state") == "state: holding"
    screen.wait_for_text("Reached exactly.")
    assert not screen.is_enabled("Release")
    assert screen.number("X [mm]") == 1.5
    screen.open_tab("Manual")
    assert screen.number("X [mm]") == 2.5  # the field of the tab that is open
    screen.screenshot("guard")
    assert screen.errors == []
    assert console.server.refusals == {}

    before = set(console.server.get_clients())
    console.server._websock_server.disconnect_all_clients()
    screen.wait_until(
        lambda: bool(set(console.server.get_clients()) - before), "the page to connect again under a new id"
    )
    screen.click("STOP")
    assert console.next_event()[0] == "STOP"


def test_every_kind_of_field_can_be_used_and_what_is_beyond_its_limits_is_refused(
    console: Console, screen: Screen, tmp_path: Path
) -> None:
    screen.open(console.url, until="STOP")
    screen.type_into("X [mm]", "-75.5", by_key=True)
    assert console.last_event(screen) == ("X [mm]", -75.5)
    assert screen.number("X [mm]") == -75.5
    screen.slide("joint 1", 0.75)
    label, angle = console.last_event(screen)
    assert (label, angle) == ("joint 1", pytest.approx(45.0, abs=3.0))
    screen.type_into("joint 1", "12.3", by_key=True)
    assert console.last_event(screen) == ("joint 1", 12.3)
    screen.nudge("joint 1")
    assert console.last_event(screen) == ("joint 1", pytest.approx(12.4))
    assert screen.number("joint 1") == pytest.approx(12.4)
    screen.choose("robot", "mico")
    assert console.last_event(screen) == ("robot", "mico")
    assert screen.value("robot") == "mico"
    screen.type_into("name", "place", by_key=True)
    assert console.last_event(screen) == ("name", "place")
    screen.tick("loop")
    assert console.last_event(screen) == ("loop", True)
    assert screen.is_ticked("loop")
    screen.click("+")
    assert console.last_event(screen) == ("step", "+")
    screen.type_into("target", "7.5", 1, by_key=True)
    assert console.last_event(screen) == ("target", (1.0, 7.5, 3.0))
    file = tmp_path / "pick.toml"
    file.write_bytes(b"x = 1\n" * 150_000)
    screen.upload("Load", file)
    assert console.next_event() == ("Load", ("pick.toml", file.read_bytes()))
    assert console.server.refusals == {}
    assert screen.errors == []

    # the screen has to see "900" to say that it is outside; the page puts 400 when the field is left
    screen.type_into("X [mm]", "900", leave=False, by_key=True)
    assert console.last_event(screen) == ("X [mm]", 900.0)
    screen.leave("X [mm]")
    assert console.last_event(screen) == ("X [mm]", 400.0)
    screen.type_into("joint 1", "95", leave=False, by_key=True)
    assert console.last_event(screen) == ("joint 1", 9.0)
    assert console.server.refusals == {"a value that the control cannot take": 1}
    screen.wait_for_notification("joint 1: 95 is outside -90 … 90; it stays 9.")
    screen.wait_until(lambda: screen.number("joint 1") == 9, "the number in force is shown again")


def test_the_page_cannot_be_led_to_another_server_nor_reach_one_by_any_means(
    console: Console, screen: Screen
) -> None:
    # viser's page would load the screens, and send the clicks, of ``?websocket=``
    with socket.create_server(("127.0.0.1", 0)) as elsewhere:
        elsewhere.setblocking(False)
        screen.open(f"{console.url}?websocket=ws://127.0.0.1:{elsewhere.getsockname()[1]}", until="STOP")
        screen.click("STOP")
        assert console.next_event()[0] == "STOP"
        assert screen.page.url == console.url
        with pytest.raises(BlockingIOError):
            elsewhere.accept()

    with socket.create_server(("127.0.0.1", 0)) as elsewhere:
        elsewhere.setblocking(False)
        there = f"127.0.0.1:{elsewhere.getsockname()[1]}"
        blocked = screen.page.evaluate(
            """async there => {
                const blocked = [];
                addEventListener("securitypolicyviolation", event => blocked.push(event.effectiveDirective));
                try { new WebSocket(`ws://${there}/`); } catch {}
                try { await fetch(`http://${there}/`, {mode: "no-cors"}); } catch {}
                const code = `try { new WebSocket("ws://${there}/"); } catch {} postMessage(0);`;
                const worker = new Worker(URL.createObjectURL(new Blob([code])));
                await new Promise(done => worker.onmessage = done);
                const image = new Image();
                await new Promise(done => { image.onerror = done; image.src = `http://${there}/a.png`; });
                await new Promise(done => setTimeout(done, 200));
                return blocked;
            }""",
            there,
        )
        assert {"connect-src", "img-src"} <= set(blocked)
        with pytest.raises(BlockingIOError):
            elsewhere.accept()


def test_a_foreign_page_cannot_open_a_websocket_or_frame_the_console(
    console: Console, screens: Screens, elsewhere: str
) -> None:
    foreign = screens()
    foreign.page.goto(elsewhere)
    ended = foreign.page.evaluate(
        """url => new Promise(done => {
            const socket = new WebSocket(url.replace("http", "ws"), ["viser-v1.1.1"]);
            socket.onopen = () => done("open");
            socket.onclose = event => done(event.code);
        })""",
        console.url,
    )
    assert ended == 1006
    assert console.server.refusals == {"a foreign origin": 1}
    foreign.page.evaluate(
        """url => new Promise(done => {
            const frame = document.createElement("iframe");
            frame.onload = done;
            frame.src = url;
            document.body.append(frame);
        })""",
        console.url,
    )
    assert foreign.page.locator("iframe").content_frame.get_by_role("button").count() == 0
    assert any("frame-ancestors" in error for error in foreign.errors)


def test_the_link_lets_in_from_mail_and_chat_and_its_token_is_seen_nowhere(
    screen: Screen, elsewhere: str
) -> None:
    """A page at another site (localhost, not 127.0.0.1) plays the mail: it links to the console."""
    console = Console(token=TOKEN)
    referrers: list[str] = []
    try:
        screen.page.on("request", lambda request: referrers.append(request.headers.get("referer", "")))
        response = screen.page.goto(console.url)
        assert response is not None
        assert response.status == 401
        assert "Open the whole link that armctl printed" in screen.text("body")
        for link in (f"{console.url}?token={TOKEN}", console.url):  # then the bare address will do, too
            screen.page.goto(elsewhere.replace("127.0.0.1", "localhost"))
            screen.page.evaluate("link => document.body.innerHTML = `<a href='${link}'>the arm</a>`", link)
            screen.page.get_by_text("the arm").click()
            screen.button("STOP").wait_for()
            assert screen.page.url == console.url
        assert TOKEN not in screen.page.evaluate("document.cookie + document.referrer")
        assert not any(TOKEN in referrer for referrer in referrers)
        screen.click("STOP")
        assert console.next_event()[0] == "STOP"
        screen.page.reload()
        screen.button("STOP").wait_for()
    finally:
        console.server.stop()


def test_the_page_works_on_an_encrypted_line(browser: Browser, tmp_path: Path) -> None:
    files = tmp_path / "cert.pem", tmp_path / "key.pem"
    for path, text in zip(files, (CERTIFICATE, KEY), strict=True):
        path.write_text(text)
    console = Console(token=TOKEN, tls=encryption(*files))
    page = browser.new_page(ignore_https_errors=True)  # nobody whom the browser trusts signed it
    try:
        screen = Screen(page)
        screen.open(console.server.links[0], until="STOP")
        assert page.url == f"https://localhost:{console.server.get_port()}/"
        screen.click("STOP")
        assert console.next_event()[0] == "STOP"
        assert screen.errors == []
    finally:
        page.close()
        console.server.stop()
