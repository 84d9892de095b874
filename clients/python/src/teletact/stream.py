"""One touch stream: poses out under credit, answers and laws in, checked."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import grpc
import grpc.aio
import numpy as np

from teletact.answers import Answer, Opened, answer_from, opened_from
from teletact.arrays import Floats
from teletact.channel import PalpationStub, Peer
from teletact.errors import BadAnswer, TeletactError, Unavailable, from_rpc, from_status
from teletact.law_book import LawBook
from teletact.v1 import palpation_pb2 as palpation

_CALL = "Touch"
_HEARTBEAT_S = 0.1
_OPEN_WAIT_S = 30.0  # the service may have to make the layer's model first
_END_WAIT_S = 1.0


@dataclass(eq=False)
class Pose:
    position_m: Floats
    velocity_m_s: Floats
    answer: asyncio.Future[Answer] | None = None  # where somebody waits for it


@dataclass(eq=False)
class HandOver:
    request: palpation.TouchRequest
    written: asyncio.Future[None]


@dataclass
class Board:
    """What a touch and its streams, one after the other, share: all on one event loop."""

    pose: Pose | None = None      # the newest
    newest: Answer | None = None
    opened: Opened | None = None
    book: LawBook = field(default_factory=LawBook)
    sequence: int = 0             # of the last pose sent; it never starts again
    streams: int = 0              # that were opened
    hand_over: HandOver | None = None  # while somebody waits for it
    wake: asyncio.Event = field(default_factory=asyncio.Event)  # there may be something to send
    changed: asyncio.Condition = field(default_factory=asyncio.Condition)
    instance: int = field(default_factory=lambda: secrets.randbits(63) | 1)

    async def notify(self) -> None:
        async with self.changed:
            self.changed.notify_all()


class Stream:
    """Runs until it ends; ``serve`` says why."""

    def __init__(self, peer: Peer, request: palpation.TouchOpen, board: Board, dead_s: float) -> None:
        self._peer, self._open, self._board, self._dead_s = peer, request, board, dead_s
        self._credit = 0             # 0: not opened yet
        self._period_s = 0.0
        self._acknowledged = 0       # the newest answer received
        self._told = 0               # the newest that we have acknowledged
        self._laws_told = 0
        self._answered = 0           # newest pose that was answered
        self._handed_over = self._ending = False
        self._heard_s = time.monotonic()
        self._sent: deque[tuple[int, float, Pose]] = deque()

    async def serve(self) -> TeletactError:
        """One stream, until it ends; why it did."""
        channel = self._peer.channel()
        call = PalpationStub(channel).Touch(metadata=self._peer.metadata(self._open.scene_id))
        tasks = [asyncio.create_task(work) for work in (self._read(call), self._write(call), self._guard())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            error = next(task.exception() for task in tasks if task in done)
            if isinstance(error, TeletactError):
                return error
            if isinstance(error, grpc.RpcError):
                return from_rpc(error, _CALL)
            if isinstance(error, (asyncio.InvalidStateError, grpc.aio.UsageError)):  # written to what has ended
                return await _end_of(call)
            assert error is not None
            raise error
        except asyncio.CancelledError:
            if self._handed_over:  # a service may drop what it has not read of a call that is cancelled
                self._ending = True
                self._board.wake.set()
                await asyncio.wait(tasks[:1], timeout=_END_WAIT_S)
            raise
        finally:
            for task in tasks:
                task.cancel()
            call.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await channel.close(grace=None)

    async def _guard(self) -> None:
        while True:
            dead_s = max(self._dead_s, 10 * self._period_s) if self._credit else _OPEN_WAIT_S
            now = since_s = time.monotonic()
            if self._sent:
                since_s = max(self._heard_s, self._sent[0][1])
            elif not self._credit:
                since_s = self._heard_s
            left = since_s + dead_s - now  # once it is open nothing is to be heard before the first pose
            if left <= 0:
                raise Unavailable(f"the service says nothing for {dead_s} s", call=_CALL)
            await asyncio.sleep(min(left, self._dead_s))

    async def _read(self, call: Any) -> None:
        while True:
            response = await call.read()
            if response is grpc.aio.EOF:
                raise await _end_of(call)
            now = self._heard_s = time.monotonic()
            kind = response.WhichOneof("kind")
            if kind == "opened":
                await self._take_opened(response.opened)
            elif kind is None:
                continue  # of a newer service
            elif not self._credit:
                raise BadAnswer("before the stream was opened", field=kind, call=_CALL)
            elif kind == "answer":
                await self._take_answer(response.answer, now)
            elif self._open.laws:
                self._board.book.take(response.law)
                self._board.wake.set()
            else:
                raise BadAnswer("not asked for", field="law", call=_CALL)

    async def _take_opened(self, message: palpation.TouchOpened) -> None:
        if self._credit:
            raise BadAnswer("twice", field="opened", call=_CALL)
        self._board.opened = opened_from(message)
        self._credit, self._period_s = self._board.opened.credit, self._board.opened.period_s
        self._answered = self._board.sequence
        self._board.book = LawBook(self._board.opened.layer_depth_m)
        self._board.streams += 1
        self._board.wake.set()
        await self._board.notify()

    async def _take_answer(self, message: palpation.TouchAnswer, now: float) -> None:
        if message.answer != self._acknowledged + 1:
            raise BadAnswer(f"{message.answer} after {self._acknowledged}", field="answer.answer", call=_CALL)
        if message.answer - self._told > self._credit:
            raise BadAnswer(f"more answers than the credit of {self._credit} allows", field="answer", call=_CALL)
        while self._sent and self._sent[0][0] < message.sequence:
            self._sent.popleft()  # a newer pose won
        if not self._sent or self._sent[0][0] != message.sequence:
            raise BadAnswer(f"{message.sequence} was not asked for", field="answer.sequence", call=_CALL)
        _, sent_s, pose = self._sent[0]  # kept: a service may answer a pose again
        answer = answer_from(message, now - sent_s)
        if not np.array_equal(answer.position_m, pose.position_m):
            raise BadAnswer("not that of the pose", field="answer.position_m", call=_CALL)
        self._acknowledged = message.answer
        self._answered = message.sequence
        self._board.newest = answer
        if pose.answer is not None and not pose.answer.done() and answer.status != "preparing":
            pose.answer.set_result(answer)
        self._board.wake.set()
        await self._board.notify()

    async def _write(self, call: Any) -> None:
        await call.write(palpation.TouchRequest(open=self._open))
        sent: Pose | None = None
        next_s = 0.0  # before it no pose is sent
        while not self._ending:
            now = time.monotonic()
            wish = self._board.hand_over
            if self._credit and wish is not None and not wish.written.done():
                await call.write(wish.request)
                self._handed_over = True
                if not wish.written.done():
                    wish.written.set_result(None)
                continue
            wait_s = self._wait_s(sent, next_s, now)
            if wait_s > 0:
                self._board.wake.clear()
                try:
                    async with asyncio.timeout(wait_s):
                        await self._board.wake.wait()
                except TimeoutError:
                    pass
                continue
            assert self._board.pose is not None
            sent = self._board.pose
            next_s = now + self._period_s
            self._board.sequence += 1
            self._sent.append((self._board.sequence, now, sent))
            await call.write(self._request(sent))
        await call.done_writing()

    def _wait_s(self, sent: Pose | None, next_s: float, now: float) -> float:
        """How long to wait, at most, before a pose may be sent; 0: it may be now."""
        if not self._credit or self._board.pose is None:
            return _HEARTBEAT_S
        if now < next_s:
            return next_s - now
        heartbeat_s = next_s - self._period_s + _HEARTBEAT_S - now
        if self._board.sequence - self._answered >= self._credit:
            return heartbeat_s
        board = self._board
        news = board.pose is not sent or board.book.pieces != self._laws_told
        return 0.0 if news else heartbeat_s

    def _request(self, pose: Pose) -> palpation.TouchRequest:
        request = palpation.TouchRequest()
        message = request.pose
        message.sequence = self._board.sequence
        message.stamp.monotonic_ns, message.stamp.instance = time.monotonic_ns(), self._board.instance
        message.position_m.extend(pose.position_m)
        message.velocity_m_s.extend(pose.velocity_m_s)
        message.acknowledged = self._told = self._acknowledged
        message.laws_acknowledged = self._laws_told = self._board.book.pieces
        return request


async def _end_of(call: Any) -> TeletactError:
    """How a call that is over has ended."""
    code = await call.code()
    if code == grpc.StatusCode.OK:
        return Unavailable("the service ended the stream", call=_CALL)
    return from_status(code, await call.details(), _CALL)
