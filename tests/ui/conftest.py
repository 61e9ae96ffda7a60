"""What several tests of the page's parts need."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from armctl.ui.guard import GuardedServer, guarded_server


@pytest.fixture(scope="module")
def server() -> Iterator[GuardedServer]:
    """A server of its own for a module; nobody need be connected."""
    server = guarded_server(port=0, label="test")
    yield server
    server.stop()
