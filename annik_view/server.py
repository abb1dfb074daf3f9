"""The web server of the page: viser's, without its banner, and closed to the pages of others."""

import ipaddress
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

import rich
import viser
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

#: The page is bound to this address unless another is chosen: it may move a robot.
LOCALHOST = "127.0.0.1"
#: The first port that is tried unless another is chosen.
PORT = 8080


def is_local(host: str) -> bool:
    """Whether an address of a page, or a name of it, is of this machine only."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def open_to_others(host: str) -> str:
    """The warning for a page at an address that others can reach."""
    return (
        f"whoever can reach {host} can use this page, and move a robot that it drives; "
        f"by default it is at {LOCALHOST}"
    )


def is_own_page(origin: str | None, address: str, *, local: bool) -> bool:
    """Whether a connection comes from a page that this server sent, not from that of another site.

    Args:
        origin: the header ``Origin``: a browser always sends it, other programs do not.
        address: the header ``Host``: the address by which the server was found.
        local: the server is bound to this machine. Then its address has to be a local one: another
            site could give its own name the address 127.0.0.1.
    """
    if origin is None:
        return True
    if local and not is_local(urlsplit(f"//{address}").hostname or ""):
        return False
    return urlsplit(origin).netloc == address


class PageServer(viser.ViserServer):
    """The server of viser.

    Args:
        host: address to bind it to.
        port: the first free port from this on is taken.
        own_page_only: refuse connections from the pages of other sites, which any browser on this
            machine may have open.
    """

    def __init__(self, host: str, port: int, *, own_page_only: bool) -> None:
        with _quiet():
            super().__init__(host=host, port=port, label="annik", verbose=False)
        if own_page_only:
            server = self._websock_server
            server.on_client_connect(self._refuse_others)
            # Those that came before the check come again.
            server.disconnect_all_clients()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse a client that asks to open the page to the internet."""
        return None

    def stop(self) -> None:
        """Close the page."""
        with _quiet():
            super().stop()

    async def _refuse_others(self, client: Any) -> None:
        connection = self._websock_server._live_connections[client.client_id]
        assert connection.request is not None
        headers = connection.request.headers
        local = is_local(self.get_host())
        if is_own_page(headers.get("Origin"), headers.get("Host", ""), local=local):
            return
        await connection.close(CloseCode.POLICY_VIOLATION, "the page of another site")
        # What it had sent by then, viser would still obey.
        with suppress(ConnectionClosed):
            while True:
                await connection.recv()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what viser prints at its start and its end."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
