"""The web server's guard: who may connect, and what a connected page may say."""

from armctl.ui.guard.door import SocketDoor
from armctl.ui.guard.listening import encryption
from armctl.ui.guard.server import TOKEN, GuardedServer, guarded_server

__all__ = ["TOKEN", "GuardedServer", "SocketDoor", "encryption", "guarded_server"]
