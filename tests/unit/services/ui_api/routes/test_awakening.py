"""A stream that is woken often before it looks costs its loop one callback."""

import asyncio

import pytest

from services.ui_api.routes.awakening import Awakening


def test_many_calls_before_the_stream_looks_are_one_thing_to_do_for_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[object] = []

    async def work() -> None:
        awakening = Awakening()
        with monkeypatch.context() as patched:
            patched.setattr(asyncio.get_running_loop(), "call_soon_threadsafe", handed.append)
            for _ in range(1000):
                awakening.call()

    asyncio.run(work())
    assert len(handed) == 1


def test_no_call_is_lost_between_two_looks() -> None:
    async def work() -> list[int]:
        awakening, log, seen = Awakening(), [], 0
        seen_at: list[int] = []

        def write() -> None:
            for number in range(200):
                log.append(number)
                awakening.call()

        writer = asyncio.create_task(asyncio.to_thread(write))
        while seen < 200:
            awakening.clear()
            seen = len(log)
            seen_at.append(seen)
            if seen < 200:
                await asyncio.wait_for(awakening.wait(), 10.0)
        await writer
        return seen_at

    assert asyncio.run(work())[-1] == 200
