"""The public port sends what it writes at once."""

import asyncio
import socket

import pytest

from services.ui_api.front.port import listening_socket


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_connection_waits_for_no_acknowledgement_before_it_sends(host: str) -> None:
    """Or a body that follows its head would wait for the client's delayed acknowledgement, 40 ms."""

    async def option() -> int:
        found: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        async def note(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            accepted = writer.get_extra_info("socket")
            found.set_result(accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()

        with listening_socket(host, 0) as listening:
            async with await asyncio.start_server(note, sock=listening):
                _, writer = await asyncio.open_connection(host, listening.getsockname()[1])
                try:
                    return await found
                finally:
                    writer.close()

    assert asyncio.run(option()) == 1
