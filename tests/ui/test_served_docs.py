"""The documentation below ``/docs``: all of it is there, nothing else is, and strangers do not get it."""

from __future__ import annotations

import http.client
import json
import re
from collections.abc import Iterator
from functools import partial
from html import unescape

import pytest
from tests.ui.guard_kit import PATIENCE_S
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from armctl import errors
from armctl.cli.main import COMMANDS, cli
from armctl.cli.reference import commands
from armctl.errors import DOCS, ArmctlError, InputError
from armctl.program.steps import KINDS
from armctl.ui.docs import DOCS_PATH, ServedDocs, page_of, page_of_error
from armctl.ui.docs.render import Rendered, rendered
from armctl.ui.docs.where import address_of, led
from armctl.ui.guard import GuardedServer, guarded_server
from armctl.ui.tabs import TABS

HTML = "text/html; charset=utf-8"
SCRIPT = '<script src="/docs/docs.js" defer>'
TOKEN = "a-secret-of-some-length_0123456789"
SECTIONS = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, ArmctlError)]


@pytest.fixture(scope="module")
def docs() -> ServedDocs:
    return ServedDocs({"commands": partial(commands, cli)})


@pytest.fixture(scope="module")
def server(docs: ServedDocs) -> Iterator[GuardedServer]:
    server = guarded_server(port=0, docs=docs)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def locked(docs: ServedDocs) -> Iterator[GuardedServer]:
    server = guarded_server(port=0, docs=docs, token=TOKEN)
    yield server
    server.stop()


def ask(
    server: GuardedServer, path: str, method: str = "GET", **headers: str
) -> tuple[http.client.HTTPResponse, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=PATIENCE_S)
    try:
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        return response, response.read()
    finally:
        connection.close()


def links(html: str) -> set[str]:
    return {unescape(one) for one in re.findall(r'(?:href|src)="([^"]*)"', html)}


def anchors(html: str) -> set[str]:
    return {unescape(one) for one in re.findall(r' id="([^"]*)"', html)}


@pytest.fixture(scope="module")
def texts(server: GuardedServer, docs: ServedDocs) -> dict[str, str]:
    """Every page as it comes over the line, by its address."""
    found: dict[str, str] = {}
    for place in docs.pages:
        address = f"{DOCS_PATH}/{address_of(place)}"
        response, body = ask(server, address)
        assert (response.status, response.getheader("Content-Type")) == (200, "text/html; charset=utf-8"), (
            address
        )
        found[address] = body.decode()
    return found


def test_every_page_picture_and_anchor_that_a_page_points_to_is_there(
    server: GuardedServer, texts: dict[str, str]
) -> None:
    assert len(texts) > 35
    inner: set[str] = set()
    for address, html in texts.items():
        for link in links(html):
            if link.startswith("#"):
                assert link[1:] in anchors(html), (address, link)
            elif link.startswith("/"):
                inner.add(link)
            else:
                assert re.match(r"https?://|mailto:|data:,", link), (address, link)
    assert any(link.startswith("/docs/pictures/") for link in inner)
    statuses = {path: ask(server, path)[0].status for path in {link.partition("#")[0] for link in inner}}
    assert {path for path, status in statuses.items() if status != 200} == set()
    for link in inner:
        path, _, anchor = link.partition("#")
        assert not anchor or anchor in anchors(texts[path]), link


def test_a_page_may_load_files_of_this_server_alone_and_says_its_type(server: GuardedServer) -> None:
    kinds = {
        "/docs/": HTML,
        "/docs/docs.css": "text/css; charset=utf-8",
        "/docs/docs.js": "text/javascript; charset=utf-8",
        "/docs/search.json": "application/json",
        "/docs/pictures/main.png": "image/png",
        "/docs/boards/maestro.svg": "image/svg+xml",
    }
    for path, kind in kinds.items():
        response, body = ask(server, path)
        assert (response.status, response.getheader("Content-Type")) == (200, kind), path
        assert body
        assert response.getheader("X-Content-Type-Options") == "nosniff"
        (policy,) = response.headers.get_all("Content-Security-Policy") or ()
        assert "default-src 'none'; script-src 'self'; style-src 'self'" in policy
        assert "unsafe" not in policy
    response, _ = ask(server, "/")
    (policy,) = response.headers.get_all("Content-Security-Policy") or ()
    assert "unsafe-eval" in policy  # viser's page has its own


def test_no_page_has_a_style_or_a_script_of_its_own(texts: dict[str, str]) -> None:
    for address, html in texts.items():
        assert not re.search(r"<[^>]*\b(style|on\w+)=", html), address
        assert re.findall(r"<(?:script|style)\b[^>]*>", html) == ['<script src="/docs/docs.js" defer>'], (
            address
        )


def test_what_is_generated_stands_in_the_pages(texts: dict[str, str]) -> None:
    for address, html in texts.items():
        assert "generated:" not in html and ":::" not in html and "--8&lt;--" not in html, address
    for name in COMMANDS:
        assert f">armctl {name}</h2>" in texts["/docs/reference/cli/"]
    for kind in KINDS:
        assert f"<code>{kind.__struct_config__.tag}</code></h3>" in texts["/docs/reference/program-file/"]
    assert "Robot.inverse(position_m" in texts["/docs/reference/python/"]
    assert "Arm.enable(" in texts["/docs/reference/python/"]
    assert "<code>joints</code>" in texts["/docs/reference/robot-file/"]


@pytest.mark.parametrize(
    "path",
    [
        "/docs/nowhere/",
        "/docs//",
        "/docs/index.html",
        "/docs/../pyproject.toml",
        "/docs/../docs/",
        "/docs/%2e%2e/mkdocs.yml",
        "/docs/..%2fmkdocs.yml",
        "/docs/pictures/../../mkdocs.yml",
        "/docs//etc/passwd",
        "/docs/pictures/",
        "/docs/pictures",
        "/docs/screens/",
        "/docs/screens/log.md",
        "/docs/build.py",
        "/docs/pages.py",
        "/docs/extending/board/",
        "/docs/decisions/001-arm-process/",
        "/docs/pictures/armctl.webp",
        "/docs/pictures/main.png/",
        "/docsx",
        "/docs\\",
    ],
)
def test_nothing_else_is_there(server: GuardedServer, path: str) -> None:
    assert ask(server, path)[0].status == 404


def test_an_address_without_its_last_slash_leads_to_the_page(server: GuardedServer) -> None:
    for path in ("/docs", "/docs/screens/log"):
        response, _ = ask(server, path)
        assert (response.status, response.getheader("Location")) == (302, f"{path}/")


def test_it_is_read_only(server: GuardedServer) -> None:
    response, body = ask(server, "/docs/", "HEAD")
    assert (response.status, body) == (200, b"")
    assert int(response.getheader("Content-Length") or 0) > 1000
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(server, "/docs/", method)[0].status == 405
    with pytest.raises(InvalidStatus) as refusal:
        here = f"127.0.0.1:{server.get_port()}"
        connect(f"ws://{here}/docs/", origin=Origin(f"http://{here}")).close()
    assert refusal.value.response.status_code == 404


@pytest.mark.parametrize("path", ["/docs/", "/docs/search.json", "/docs/pictures/main.png", "/docs/nowhere/"])
def test_strangers_are_refused_as_for_the_page(
    server: GuardedServer, locked: GuardedServer, path: str
) -> None:
    port = locked.get_port()
    cookie = {"Cookie": f"armctl-{port}={TOKEN}"}
    assert ask(locked, path, **cookie)[0].status == (404 if "nowhere" in path else 200)
    strangers: list[dict[str, str]] = [
        {},
        {"Cookie": f"armctl-{port}=another-secret-of-some-length"},
        cookie | {"Host": f"evil.example:{port}"},
        cookie | {"Origin": "http://evil.example"},
    ]
    for headers in strangers:
        wanted = ask(locked, "/", **headers)[0].status
        assert wanted in (401, 403, 421)
        assert ask(locked, path, **headers)[0].status == wanted, headers
        assert ask(locked, f"{path}?token={TOKEN}", **headers)[0].status == wanted  # links lead to the page
    assert ask(server, path, Host=f"evil.example:{server.get_port()}")[0].status == 421


def test_a_server_without_docs_has_nothing_there() -> None:
    server = guarded_server(port=0)
    try:
        assert ask(server, "/docs/")[0].status == 404
    finally:
        server.stop()


def test_the_search_finds_every_section_where_it_is(server: GuardedServer, texts: dict[str, str]) -> None:
    found = json.loads(ask(server, "/docs/search.json")[1])
    assert {address.partition("#")[0] for address, *_ in found} == set(texts)
    for address, page, heading, text in found:
        path, _, anchor = address.partition("#")
        assert page and (text or heading)
        assert not anchor or anchor in anchors(texts[path]), address
    (one,) = [row for row in found if row[0] == "/docs/troubleshooting/#the-target-is-out-of-reach"]
    assert one[1:3] == ["Troubleshooting", "The target is out of reach"]


def test_each_tab_has_a_page_and_each_error_that_names_a_section_has_it(texts: dict[str, str]) -> None:
    for label in ("Control", *(tab.label for tab in TABS)):
        assert page_of(label) in texts
    assert page_of_error(InputError("not finite")) == ""
    sections = {kind.section for kind in SECTIONS} - {""}
    assert sections <= anchors(texts["/docs/troubleshooting/"])
    for kind in SECTIONS:
        assert page_of_error(kind("it cannot")) == (
            f"/docs/troubleshooting/#{kind.section}" * bool(kind.section)
        )


@pytest.mark.parametrize(
    ("link", "leads"),
    [
        ("screens/log.md#top", "/docs/screens/log/#top"),
        ("../README.md", "/docs/"),
        ("classroom/index.md", "/docs/classroom/"),
        ("pictures/main.png", "/docs/pictures/main.png"),
        ("../CHANGELOG.md", f"{DOCS}changelog/"),
        ("decisions/index.md", f"{DOCS}decisions/"),
        ("../tests/conftest.py", f"{DOCS}source/tests/conftest.py"),
        ("#below", "#below"),
        ("https://a.b/c.md", "https://a.b/c.md"),
    ],
)
def test_links_lead_into_the_served_pages_or_to_the_published_ones(link: str, leads: str) -> None:
    served = frozenset({"index.md", "screens/log.md", "classroom/index.md", "pictures/main.png"})
    assert led(link, "docs/urdf.md", served) == leads


def drawn(text: str) -> Rendered:
    return rendered(text, lambda link: link, lambda at: at.endswith(".png"))


def test_raw_html_is_shown_as_text_and_comments_are_not() -> None:
    html = drawn("a <script>alert(1)</script> b<br>c <!-- d -->\n\n<img src=x onerror=y>\n").html
    assert "<script" not in html and "<img" not in html and "&lt;script&gt;" in html
    assert "b<br>c" in html and "d --" not in html


def test_headings_tables_code_and_films_are_drawn() -> None:
    page = drawn(
        "# One – two\n\ntext\n\n## Again\n## Again\n\n| | n |\n|---|--:|\n| a | 1 |\n\n"
        '```bash title="needs <a> board"\nls\n```\n\n![a film](x.webp) ![a picture](x.png)\n'
    )
    assert [(one.anchor, one.heading) for one in page.sections] == [
        ("one-two", "One – two"),
        ("again", "Again"),
        ("again_1", "Again"),
    ]
    assert page.title == "One – two" and page.sections[0].text == "text"
    assert 'id="one--two"' in page.html  # as GitHub names it: some links use that
    assert '<td class="right">1</td>' in page.html and "<th></th>" not in page.html
    assert "<figcaption>needs &lt;a&gt; board</figcaption><pre><code>ls\n" in page.html
    assert ">Film: a film</a>" in page.html and 'src="x.png"' in page.html and 'src="x.webp"' not in page.html
