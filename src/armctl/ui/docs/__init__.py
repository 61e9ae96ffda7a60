"""The documentation as the console serves it: under ``/docs``, offline, with a search."""

from armctl.ui.docs.pages import ServedDocs
from armctl.ui.docs.where import DOCS_PATH, page_of, page_of_error

__all__ = ["DOCS_PATH", "ServedDocs", "page_of", "page_of_error"]
