"""The web server's guard: who may connect, and what a connected page may say."""

from armctl.ui.guard.server import GuardedServer, guarded_server

__all__ = ["GuardedServer", "guarded_server"]
