"""Who operates the arm: one page at a time; the others watch, and may press STOP."""

from __future__ import annotations


class OperatorDesk:
    """Hands the controls to one page. Used on the web server's event loop only."""

    def __init__(self) -> None:
        self._present: list[int] = []
        self._operator: int | None = None

    @property
    def operator(self) -> int | None:
        """Client id of the operator's page; None: nobody operates."""
        return self._operator

    def arrive(self, client_id: int) -> None:
        """A page has opened; it operates when nobody else does."""
        self._present.append(client_id)
        if self._operator is None:
            self._operator = client_id

    def leave(self, client_id: int) -> bool:
        """A page has gone. True when it was the operator's: then nobody operates until somebody does."""
        if client_id in self._present:
            self._present.remove(client_id)
        if self._operator != client_id:
            return False
        self._operator = None
        return True

    def take(self, client_id: int) -> None:
        """A page takes the controls."""
        if client_id in self._present:
            self._operator = client_id

    def describe(self, client_id: int) -> str:
        """Who operates, as seen from a page."""
        if self._operator == client_id:
            return "you"
        return "nobody" if self._operator is None else page_name(self._operator)

    @property
    def watching(self) -> int:
        """How many pages are open beside the operator's."""
        return len(self._present) - (self._operator is not None)


def page_name(client_id: int) -> str:
    """What people call a page; the server counts from 0."""
    return f"browser page {client_id + 1}"
