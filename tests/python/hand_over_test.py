"""Handing the probe over: it is written whatever else is sent, waits for a stream, and is not lost by who leaves."""

import asyncio
import concurrent.futures
import threading
from types import SimpleNamespace

import pytest
from lying_service import opened

import teletact


def handed_over(to):
    """A touch that answers nothing, and keeps to whom it was handed over."""
    def touch(requests, context):
        next(requests)
        yield opened()
        to.extend(request.hand_over.session_id for request in requests)

    return touch


def test_a_hand_over_arrives_without_a_pose_and_who_leaves_at_once_does_not_lose_it(liar, lied_to):
    names = [f"hand {k}" for k in range(100)]
    to = []
    liar.touch = handed_over(to)
    for name in names:
        liar.over.clear()
        with lied_to.touch("s") as touch:
            touch.hand_over(name)
        assert liar.over.wait(20)
    assert to == names


def test_hand_overs_by_asyncio_are_written_one_after_the_other(liar, lied_to):
    to = []
    liar.touch = handed_over(to)

    async def work():
        async with await teletact.aio.connect(liar.address) as service, service.touch("s") as touch:
            await asyncio.gather(*(touch.hand_over(name) for name in "abc"))
            cancelled = asyncio.create_task(touch.hand_over("d"))
            await asyncio.sleep(0)
            cancelled.cancel()
            await asyncio.gather(cancelled, return_exceptions=True)
            with pytest.raises(TypeError):
                await touch.hand_over(5)
            await touch.hand_over("e")

    asyncio.run(work())
    assert liar.over.wait(20) and [name for name in to if name != "d"] == ["a", "b", "c", "e"]


@pytest.fixture
def interrupted(liar, lied_to):
    """A touch whose stream has ended, whose next one opens when it may, and a hand-over that waits for that."""
    waits = SimpleNamespace(to=[], may_open=threading.Event(), read=threading.Event())
    called = threading.Event()

    def again(requests, context):
        next(requests)
        called.set()
        waits.may_open.wait(20)
        yield opened()
        for request in requests:
            waits.to.append(request.hand_over.session_id)
            waits.read.set()

    def once(requests, context):
        liar.touch = again
        next(requests)
        yield opened()

    liar.touch = once
    with concurrent.futures.ThreadPoolExecutor(1) as beside, lied_to.touch("s") as waits.touch:
        assert called.wait(20)
        waits.written = beside.submit(waits.touch.hand_over, "b")
        with pytest.raises(concurrent.futures.TimeoutError):
            waits.written.result(0.3)
        yield waits


def test_a_hand_over_waits_for_the_next_stream(interrupted):
    interrupted.may_open.set()
    assert interrupted.written.result(20) is None and interrupted.touch.streams == 2
    interrupted.touch.close()
    assert interrupted.read.wait(20) and interrupted.to == ["b"]
    with pytest.raises(teletact.Cancelled, match="closed"):
        interrupted.touch.hand_over("b")


def test_a_hand_over_that_waits_is_told_of_the_end(interrupted):
    interrupted.touch.close()
    interrupted.may_open.set()
    with pytest.raises(teletact.Cancelled, match="closed"):
        interrupted.written.result(20)
    assert interrupted.to == []
