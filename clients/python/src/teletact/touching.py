"""Touching a scene: the newest pose out, the newest answer in, and the stream opened again when it breaks.

A pose is sent when fewer are unanswered than the service gave credit for, at most one a period, and always the newest.
Each acknowledges what has come. While nothing new is there, the last pose goes out ten times a second. A stream is
dead when the service says nothing for ``dead_s``; another one is opened then, of the same session.
"""

from __future__ import annotations

import asyncio
import math
import secrets
import time
from typing import Any, AsyncIterator, Callable

import grpc
import numpy as np
import xarray as xr

from teletact import arrays
from teletact.answers import Answer, Opened
from teletact.channel import Peer, forked, require_not_forked
from teletact.errors import (Aborted, BadAnswer, Cancelled, DeadlineExceeded, InvalidArgument, NotFound, NotPermitted,
                             ResourceExhausted, TeletactError, Unavailable)
from teletact.law import Law
from teletact.stream import Board, HandOver, Pose, Stream
from teletact.v1 import palpation_pb2 as palpation

_CALL = "Touch"
_RETRY_S, _MOST_RETRY_S = 0.1, 2.0
_LAW_LOOK_S, _LAW_QUIET_S = 0.02, 0.5
_LAW_ENDS_M = 0.007  # a law may end so far within what is covered: where a column would stand on its border


class Touch:
    """One touch of a scene; made by ``Service.touch``. Use it with ``async with``, or call ``close``."""

    def __init__(self, peer: Peer, request: palpation.TouchOpen, resume_s: float, dead_s: float) -> None:
        self._peer, self._open, self._resume_s, self._dead_s = peer, request, resume_s, dead_s
        if not request.session_id:
            request.session_id = f"python-{secrets.randbelow(10**9)}"
        self._board = Board()
        self._error: TeletactError | None = None
        self._closed = False
        self._task: asyncio.Task[None] | None = None
        self._handing_over = asyncio.Lock()  # one after the other

    # --- what a caller does -----------------------------------------------------------------------------------

    @property
    def session_id(self) -> str:
        return self._open.session_id

    @property
    def streams(self) -> int:
        """How many were opened: more than one after an interruption."""
        return self._board.streams

    @property
    def opened(self) -> Opened:
        """How the service opened the newest stream."""
        assert self._board.opened is not None
        return self._board.opened

    async def start(self) -> Touch:
        """Opens the stream. Raises what it is refused for."""
        self._task = asyncio.create_task(self._run())
        try:
            await self._until(lambda: self._board.opened is not None)
        except BaseException:
            await self.close()
            raise
        return self

    async def __aenter__(self) -> Touch:
        return self if self._task is not None else await self.start()

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Ends the stream; nothing of it is left. A forked child leaves it to its parent."""
        if forked():
            return
        self._closed = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        self._give_up(Cancelled("the touch was closed", call=_CALL))
        await self._board.notify()

    async def move(self, position_m: Any, velocity_m_s: Any = (0.0, 0.0, 0.0)) -> None:
        """The finger is at [x, y(, z)] now, in the scene. Returns at once: the newest pose is sent when it may be."""
        self._put(position_m, velocity_m_s, None)

    async def at(self, position_m: Any, timeout_s: float = 30.0) -> Answer:
        """The force at a place: sends it and waits for its answer, while the model is prepared, too.

        Raises DeadlineExceeded, Cancelled (a newer pose took its place), or why the touch ended."""
        pose = self._put(position_m, (0.0, 0.0, 0.0), asyncio.get_running_loop().create_future())
        assert pose.answer is not None
        try:
            async with asyncio.timeout(timeout_s):  # wait_for may lose a cancellation (Python 3.11)
                return await pose.answer
        except DeadlineExceeded:  # the touch's own end
            raise
        except TimeoutError:
            status = self._board.newest.status if self._board.newest is not None else "none"
            raise DeadlineExceeded(f"no answer in {timeout_s} s (the last one's status: {status})", call=_CALL,
                                   remedy="give a longer timeout_s, or see the service's log") from None

    async def along(self, positions_m: Any, timeout_s: float = 30.0) -> xr.Dataset:
        """The forces at many places, one after the other, over the dimension ``pose``: NaN where there is none."""
        places = arrays.vectors(positions_m, "positions_m")
        return path_dataset([await self.at(place, timeout_s) for place in places])

    def __aiter__(self) -> AsyncIterator[Answer]:
        return self._answers()

    async def _answers(self) -> AsyncIterator[Answer]:
        """The newest answer whenever there is a newer one, until the touch is closed."""
        last: Answer | None = self._board.newest
        while not self._closed:
            try:
                await self._until(lambda: self._board.newest is not last)
            except Cancelled:
                return
            last = self._board.newest
            assert last is not None
            yield last

    async def next(self, timeout_s: float = 30.0) -> Answer:
        """The next answer that comes."""
        last = self._board.newest
        try:
            async with asyncio.timeout(timeout_s):
                await self._until(lambda: self._board.newest is not last)
        except DeadlineExceeded:
            raise
        except TimeoutError:
            raise DeadlineExceeded(f"no answer in {timeout_s} s", call=_CALL,
                                   remedy="give a pose with move first, or a longer timeout_s") from None
        assert self._board.newest is not None
        return self._board.newest

    async def law(self, wait_s: float = 10.0) -> Law:
        """The contact law: once it is whole and nothing more has come for half a second, else what is known after
        ``wait_s``. It says NaN elsewhere. It comes around the newest pose first; without one it does not come."""
        if not self._open.laws:
            raise InvalidArgument("this touch asked for none", field="laws", remedy="touch with laws=True")
        end = heard = time.monotonic()
        end += wait_s
        pieces = self._board.book.pieces
        while (now := time.monotonic()) < end:
            self._raise()
            if self._board.book.pieces != pieces:
                pieces, heard = self._board.book.pieces, now
            elif now - heard > _LAW_QUIET_S and self._whole(self._board.book.law()):
                break
            await asyncio.sleep(_LAW_LOOK_S)
        return self._board.book.law()

    async def hand_over(self, session_id: str) -> None:
        """Lets the session of this name steer the scene's probe, if this one does. Returns once that is written,
        after an interruption to the next stream; raises why the touch ended."""
        request = palpation.TouchRequest(hand_over=palpation.HandOver(session_id=session_id))
        async with self._handing_over:
            self._raise()
            written = asyncio.get_running_loop().create_future()
            self._board.hand_over = HandOver(request, written)
            self._board.wake.set()
            try:
                await written
            finally:
                self._board.hand_over = None

    # --- the link ---------------------------------------------------------------------------------------------

    def _whole(self, law: Law) -> bool:
        covered = self._board.newest.covered if self._board.newest is not None else self.opened.covered
        begin, end = law.extent_x_m
        if not (law.columns and begin <= covered.begin_x_m + _LAW_ENDS_M and end >= covered.end_x_m - _LAW_ENDS_M):
            return False
        if not all(column.corrected for column in law.columns):
            return False
        if math.isfinite(covered.begin_z_m):
            lanes = [column.z_m for column in law.columns]
            return min(lanes) <= covered.begin_z_m + _LAW_ENDS_M and max(lanes) >= covered.end_z_m - _LAW_ENDS_M
        return all(column.joined for column in law.columns[1:])

    def _put(self, position_m: Any, velocity_m_s: Any, answer: asyncio.Future[Answer] | None) -> Pose:
        self._raise()
        pose = Pose(arrays.vector(position_m, "position_m"), arrays.vector(velocity_m_s, "velocity_m_s"), answer)
        replaced, self._board.pose = self._board.pose, pose
        if replaced is not None and replaced.answer is not None and not replaced.answer.done():
            replaced.answer.set_exception(Cancelled("a newer pose took its place", call=_CALL))
        self._board.wake.set()
        return pose

    def _raise(self) -> None:
        require_not_forked()
        if self._error is not None:
            raise self._error

    async def _until(self, true: Callable[[], bool]) -> None:
        async with self._board.changed:
            while not true():
                self._raise()
                await self._board.changed.wait()

    def _give_up(self, error: TeletactError) -> None:
        self._error = self._error or error
        pose = self._board.pose
        if pose is not None and pose.answer is not None and not pose.answer.done():
            pose.answer.set_exception(self._error)
        if self._board.hand_over is not None and not self._board.hand_over.written.done():
            self._board.hand_over.written.set_exception(self._error)

    async def _run(self) -> None:
        """Streams, one after the other, until one may not be followed by another."""
        try:
            error = await self._keep_open()
        except Exception as fault:
            error = TeletactError(repr(fault), call=_CALL, remedy="a fault of this client: report it")
            error.__cause__ = fault
        if isinstance(error, Unavailable):
            error.remedy = self._peer.remedy()
        self._give_up(error)
        await self._board.notify()

    async def _keep_open(self) -> TeletactError:
        broken_s: float | None = None  # since when there is no stream
        retry_s = _RETRY_S
        while True:
            before = self.streams
            error = await Stream(self._peer, self._open, self._board, self._dead_s).serve()
            now = time.monotonic()
            if self.streams > before:  # it was open for a while
                broken_s, retry_s = now, _RETRY_S
            broken_s = now if broken_s is None else broken_s
            if not self._may_pass(error) or now - broken_s > self._resume_s:
                return error
            await asyncio.sleep(retry_s)
            retry_s = min(2 * retry_s, _MOST_RETRY_S)

    def _may_pass(self, error: TeletactError) -> bool:
        if isinstance(error, (BadAnswer, InvalidArgument, NotPermitted, Aborted)):
            return False
        if error.code == grpc.StatusCode.UNIMPLEMENTED:
            return False
        if isinstance(error, (NotFound, ResourceExhausted)):  # a restarted service reads its scenes first
            return self.streams > 0
        return True


def path_dataset(answers: list[Answer]) -> xr.Dataset:
    """Answers over the dimension ``pose``."""
    positions = np.array([answer.position_m for answer in answers]).reshape(-1, 3)
    axis = ("axis", ["x", "y", "z"])
    return xr.Dataset(
        {"force": (("pose", "axis"), np.array([answer.force_n for answer in answers]).reshape(-1, 3), {"units": "N"}),
         "energy": ("pose", np.array([answer.energy_j for answer in answers]), {"units": "J"}),
         "half_width": ("pose", np.array([answer.half_width for answer in answers]), {"units": "1"}),
         "above": ("pose", np.array([answer.above for answer in answers]), {"units": "1"}),
         "status": ("pose", np.array([answer.status for answer in answers], dtype=object)),
         "model_version": ("pose", np.array([answer.model_version for answer in answers], np.int64))},
        coords={"axis": axis, **{name: ("pose", positions[:, k], {"units": "m"}) for k, name in enumerate("xyz")}},
        attrs={"warnings": sorted({answer.warning for answer in answers if answer.warning})})

