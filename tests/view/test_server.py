"""The server of the page: who may connect, and what it prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("viser", reason="the page needs viser: pip install '.[view]'")

import msgspec
import viser
from support.processes import PATIENCE, wait_until
from websockets.exceptions import ConnectionClosedError
from websockets.frames import CloseCode
from websockets.sync.client import connect

from annik_view.server import PageServer, is_local, is_own_page


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "127.1.2.3", "::1", "[::1]"])
def test_addresses_of_this_machine_are_local(host: str) -> None:
    assert is_local(host)


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "::", "192.168.0.7", "robot", "localhost.evil.org", ""]
)
def test_others_are_not(host: str) -> None:
    assert not is_local(host)


@pytest.mark.parametrize(
    ("origin", "address", "local", "own"),
    [
        (None, "127.0.0.1:8080", True, True),  # no browser
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True, True),
        ("http://localhost:9000", "localhost:9000", True, True),  # through a tunnel of ssh
        ("http://[::1]:8080", "[::1]:8080", True, True),
        ("http://robot:8080", "robot:8080", False, True),
        ("https://evil.org", "127.0.0.1:8080", True, False),
        ("http://127.0.0.1:8081", "127.0.0.1:8080", True, False),
        ("null", "127.0.0.1:8080", True, False),  # a file, or a frame in a sandbox
        ("", "127.0.0.1:8080", True, False),
        ("http://evil.org", "robot:8080", False, False),
        # A name of another site with the address of this machine.
        ("http://evil.org:8080", "evil.org:8080", True, False),
        ("http://evil.org", "", True, False),
    ],
)
def test_only_its_own_page_may_connect(
    origin: str | None, address: str, local: bool, own: bool
) -> None:
    assert is_own_page(origin, address, local=local) is own


@pytest.fixture
def server() -> Iterator[PageServer]:
    started = PageServer("127.0.0.1", 8341, own_page_only=True)
    yield started
    started.stop()


def connection(server: PageServer, **options: Any) -> Any:
    protocol: Any = f"viser-v{viser.__version__}"
    url = f"ws://127.0.0.1:{server.get_port()}"
    return connect(url, subprotocols=[protocol], max_size=None, compression=None, **options)


#: Of a browser that has drawn the page; before it viser calls nothing back.
CAMERA = {
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [2.0, 0.0, 0.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 480,
    "image_width": 640,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def switch_on(page: Any, uuid: str) -> None:
    page.send(msgspec.msgpack.encode({"type": "ViewerCameraMessage", **CAMERA}))
    update = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}}
    page.send(msgspec.msgpack.encode(update))


@pytest.mark.process
def test_the_page_of_another_site_is_refused_unheard(server: PageServer) -> None:
    switch = server.gui.add_checkbox("drive", False)
    with connection(server, origin="http://evil.org") as other:
        # It may be refused before it has said all.
        with pytest.raises(ConnectionClosedError) as refused:
            switch_on(other, switch._impl.uuid)
            other.recv(timeout=PATIENCE)
        assert refused.value.rcvd is not None
        assert refused.value.rcvd.code == CloseCode.POLICY_VIOLATION
    own = f"http://127.0.0.1:{server.get_port()}"
    with connection(server, origin=own) as page:
        assert page.recv(timeout=PATIENCE)
        assert not switch.value
        switch_on(page, switch._impl.uuid)
        wait_until(lambda: switch.value, "its own page is heard")


@pytest.mark.process
def test_a_program_that_is_no_browser_may_connect(server: PageServer) -> None:
    with connection(server) as program:
        assert program.recv(timeout=PATIENCE)


@pytest.mark.process
def test_the_page_is_not_opened_to_the_internet_and_nothing_is_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    server = PageServer("127.0.0.1", 8342, own_page_only=False)
    assert server.request_share_url() is None
    server.stop()
    assert capsys.readouterr() == ("", "")
