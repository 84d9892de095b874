"""A teletact service from Python: scenes of tissue, estimates from RF, touch. Guide: docs/guide/python.md.

    import teletact

    with teletact.connect("127.0.0.1:50051") as service:
        maps = service.estimate(pre, post, ...)
        with service.touch("liver") as touch:
            answer = touch.at([0.05, 0.002])

``teletact.aio`` has the same names for asyncio.
"""

from __future__ import annotations

import asyncio
import functools
import os
import threading
from pathlib import Path
from typing import Any, Callable, Concatenate, Coroutine, Iterator, ParamSpec, TypeVar

import xarray as xr

# Before gRPC is loaded: newer ones would start their threads in a forked child, and abort it now and then.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")

from teletact import aio, errors
from teletact.answers import Answer, Opened, TactileImage
from teletact.channel import forked, require_not_forked
from teletact.errors import (Aborted, AlreadyExists, BadAnswer, Cancelled, DamagedFile, DeadlineExceeded,
                             FailedPrecondition, InvalidArgument, NotFound, NotPermitted, ResourceExhausted,
                             TeletactError, Unavailable)
from teletact.files import read_metaimage
from teletact.law import Law, LawColumn, LawValues
from teletact.observing import Observation, Surface
from teletact.recordings import Recording, read_recording
from teletact.scenes import Info, Region, Scene, Window

__all__ = [
    "connect", "Service", "Touch", "Observing", "Answer", "Opened", "TactileImage", "Observation", "Surface",
    "Info", "Region", "Scene", "Window", "Law", "LawColumn", "LawValues", "Recording", "read_recording",
    "read_metaimage", "aio", "errors", "TeletactError", "Aborted", "AlreadyExists", "BadAnswer", "Cancelled",
    "DamagedFile", "DeadlineExceeded", "FailedPrecondition", "InvalidArgument", "NotFound", "NotPermitted",
    "ResourceExhausted", "Unavailable"]

_P = ParamSpec("_P")
_T = TypeVar("_T")


class _Loop:
    """One event loop for all services of this process, on a thread of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, name="teletact", daemon=True).start()

    def run(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Waits for it; whoever interrupts the waiting ends the work, too."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise


@functools.cache
def _one_loop() -> _Loop:
    return _Loop()


def _loop() -> _Loop:
    require_not_forked()
    return _one_loop()


class _Facade:
    def __init__(self, core: Any) -> None:
        self._core = core

    def close(self) -> None:
        """Ends it; nothing of it is left. A forked child leaves it to its parent."""
        if not forked():
            _loop().run(self._core.close())


def _waits(method: Callable[Concatenate[Any, _P], Coroutine[Any, Any, _T]]) -> Callable[Concatenate[_Facade, _P], _T]:
    """A method of the asyncio core that is waited for."""
    @functools.wraps(method)
    def call(self: _Facade, /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        return _loop().run(method(self._core, *args, **kwargs))

    return call


class Touch(_Facade):
    """``teletact.aio.Touch`` for programs without asyncio. Iterating gives the newest answer whenever one comes."""

    _core: aio.Touch
    at = _waits(aio.Touch.at)
    along = _waits(aio.Touch.along)
    move = _waits(aio.Touch.move)
    next = _waits(aio.Touch.next)
    law = _waits(aio.Touch.law)
    hand_over = _waits(aio.Touch.hand_over)

    @property
    def session_id(self) -> str:
        return self._core.session_id

    @property
    def opened(self) -> Opened:
        return self._core.opened

    @property
    def streams(self) -> int:
        return self._core.streams

    def __enter__(self) -> Touch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Answer]:
        answers = self._core.__aiter__()

        async def following() -> Answer | None:
            return await anext(answers, None)

        while (answer := _loop().run(following())) is not None:
            yield answer


class Observing(_Facade):
    """``teletact.aio.Observing`` for programs without asyncio. Iterating gives the next state, without end."""

    _core: aio.Observing
    next = _waits(aio.Observing.next)

    @property
    def maps(self) -> dict[str, xr.DataArray]:
        return self._core.maps

    @property
    def b_mode(self) -> dict[int, xr.DataArray]:
        return self._core.b_mode

    @property
    def streams(self) -> int:
        return self._core.streams

    def __enter__(self) -> Observing:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Observation]:
        while True:
            yield self.next()


class Service(_Facade):
    """``teletact.aio.Service`` for programs without asyncio: every method waits."""

    _core: aio.Service
    info = _waits(aio.Service.info)
    scenes = _waits(aio.Service.scenes)
    scene = _waits(aio.Service.scene)
    modulus = _waits(aio.Service.modulus)
    create_scene = _waits(aio.Service.create_scene)
    publish_slice = _waits(aio.Service.publish_slice)
    delete_scene = _waits(aio.Service.delete_scene)
    estimate = _waits(aio.Service.estimate)

    def __enter__(self) -> Service:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def touch(self, scene_id: str, **options: Any) -> Touch:
        """As ``teletact.aio.Service.touch``, opened already. Close it, or use it with ``with``."""
        async def opened() -> aio.Touch:
            return await self._core.touch(scene_id, **options).start()

        return Touch(_loop().run(opened()))

    def observe(self, scene_id: str, **options: Any) -> Observing:
        """As ``teletact.aio.Service.observe``. Close it, or use it with ``with``."""
        return Observing(self._core.observe(scene_id, **options))


def connect(address: str, *, tls_ca: str | Path | None = None, tls_certificate: str | Path | None = None,
            tls_key: str | Path | None = None, token: str | None = None, token_file: str | Path | None = None,
            name: str | None = None, wait_s: float = 60.0, proxy: bool = False) -> Service:
    """A service that answers: as ``teletact.aio.connect``."""
    return Service(_loop().run(aio.connect(
        address, tls_ca=tls_ca, tls_certificate=tls_certificate, tls_key=tls_key, token=token, token_file=token_file,
        name=name, wait_s=wait_s, proxy=proxy)))
