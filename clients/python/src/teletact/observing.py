"""Looking on at a scene while others touch it: its windows and maps as they change, what is felt, how the layer gives way.

The service writes a state once the one before is acknowledged. It is acknowledged when the next one is asked for, so
who asks rarely gets few states, and always the newest. A stream that ended meanwhile, as one does that nobody asked for
10 s, is opened again.
"""

from __future__ import annotations

import asyncio
import copy
import math
import time
from dataclasses import dataclass, field
from typing import Any, Mapping

import grpc
import grpc.aio
import numpy as np
import xarray as xr

from teletact import arrays, scenes
from teletact.answers import Answer, answer_from
from teletact.channel import PalpationStub, Peer, forked, require_not_forked
from teletact.errors import (BadAnswer, Cancelled, DeadlineExceeded, NotFound, ResourceExhausted, TeletactError,
                             Unavailable, from_rpc, from_status)
from teletact.scenes import Scene
from teletact.v1 import palpation_pb2 as palpation

_CALL = "Observe"
MAPS = ("youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode")
_SILENCE_S = 3.0           # of a service that writes a state each second; more where a slower rate was asked for
_OPEN_WAIT_S = 10.0
_RETRY_S, _MOST_RETRY_S = 0.1, 2.0
_MOST_CELLS = 1 << 25      # of a map
_MOST_PARTS = 4096         # of maps in one state
_MOST_B_MODE_BYTES = 1 << 28
_ALIGNED = 1e-3            # of a spacing, how far a part may lie beside its map's cells


@dataclass(frozen=True)
class Surface:
    """How the touched layer gives way. ``displacement_m``: over z, x of its nodes, > 0 into the tissue; without nodes
    the layer is at rest. ``depth_m``: of the layer. ``sequence``: of the pose, 0 once its stream has ended."""

    sequence: int
    depth_m: float
    displacement_m: xr.DataArray


@dataclass(frozen=True)
class Observation:
    """What is new since the state before; None or empty: nothing is, or it was not asked for.

    ``changed``: names of the maps that did (``Observing.maps``), and of windows whose B-mode did
    (``Observing.b_mode``). ``message``: all that was sent.
    """

    state: int
    scene_version: int
    steered_by: str  # session that steers the scene; "": nobody
    scene: Scene | None
    changed: tuple[str | int, ...]
    answer: Answer | None
    surface: Surface | None
    message: palpation.Observation = field(repr=False)


class Observing:
    """One look at a scene; made by ``Service.observe``. Use it with ``async with``, or call ``close``.

    ``maps``: what is known by now, over y, x in the scene: youngs_modulus (Pa) and youngs_modulus_log_std, NaN where
    not known, and valid. ``b_mode``: by window, grey values (uint8) of 60 dB. Each state adds to them.
    """

    def __init__(self, peer: Peer, request: palpation.ObserveOpen, resume_s: float) -> None:
        self._peer, self._open, self._resume_s = peer, request, resume_s
        self._channel: grpc.aio.Channel | None = None
        self._stream: Any = None
        self._state = 0     # the newest that was received of this stream
        self._closed = False
        self._asking = asyncio.Lock()
        self.streams = 0    # that were opened: more than one after an interruption
        self._canvases: dict[str, _Part] = {}
        self.maps: dict[str, xr.DataArray] = {}
        self.b_mode: dict[int, xr.DataArray] = {}

    async def __aenter__(self) -> Observing:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        self._closed = True
        if not forked():
            await self._end()

    def __aiter__(self) -> Observing:
        return self

    async def __anext__(self) -> Observation:
        return await self.next()

    async def next(self) -> Observation:
        """The next state, at once where one is due. Raises a TeletactError, which ends the stream: the next call opens
        another."""
        require_not_forked()
        async with self._asking:
            begun_s, retry_s = time.monotonic(), _RETRY_S
            while True:
                if self._closed:
                    raise Cancelled("it was closed", call=_CALL)
                try:
                    return self._taken(await self._read())
                except TeletactError as error:
                    await self._end()
                    if not self._may_pass(error) or time.monotonic() - begun_s > self._resume_s:
                        raise
                except BaseException as error:
                    await self._end()
                    task = asyncio.current_task()
                    if isinstance(error, asyncio.CancelledError) and self._closed and not (task and task.cancelling()):
                        raise Cancelled("it was closed", call=_CALL) from None
                    raise
                await asyncio.sleep(retry_s)
                retry_s = min(2 * retry_s, _MOST_RETRY_S)

    # --- the stream -------------------------------------------------------------------------------------------

    def _may_pass(self, error: TeletactError) -> bool:
        if isinstance(error, (NotFound, ResourceExhausted)):  # a restarted service reads its scenes first
            return self.streams > 0
        return isinstance(error, (Unavailable, DeadlineExceeded))

    async def _end(self) -> None:
        stream, channel, self._stream, self._channel = self._stream, self._channel, None, None
        if stream is not None:
            stream.cancel()
        if channel is not None:
            await channel.close(grace=None)

    async def _read(self) -> palpation.Observation:
        opens = self._stream is None
        silence_s = _OPEN_WAIT_S if opens else _SILENCE_S + 3 / (self._open.max_rate_hz or 60)
        try:
            async with asyncio.timeout(silence_s):
                if opens:
                    self._channel, self._state = self._peer.channel(), 0
                    self._stream = PalpationStub(self._channel).Observe(
                        metadata=self._peer.metadata(self._open.scene_id))
                    request = palpation.ObserveRequest(open=self._open)
                else:
                    request = palpation.ObserveRequest(acknowledged=self._state)
                stream = self._stream
                # At once: a write waits for what has come to be read where the service has ended the stream.
                message, _ = await asyncio.gather(stream.read(), stream.write(request))
                if message is grpc.aio.EOF:
                    raise await self._ended(stream)
        except TimeoutError:
            raise Unavailable(f"the service says nothing for {silence_s:.3g} s", call=_CALL,
                              remedy=self._peer.remedy()) from None
        except grpc.RpcError as error:
            raise self._with_remedy(from_rpc(error, _CALL)) from None
        except (asyncio.InvalidStateError, grpc.aio.UsageError):  # written to what has ended
            raise await self._ended(stream) from None
        if opens:
            self.streams += 1
            self._canvases, self.maps, self.b_mode = {}, {}, {}  # all of it comes again
        observed: palpation.Observation = message
        return observed

    async def _ended(self, stream: Any) -> TeletactError:
        code = await stream.code()
        if code == grpc.StatusCode.OK:
            return Unavailable("the service ended the stream", call=_CALL)
        return self._with_remedy(from_status(code, await stream.details(), _CALL))

    def _with_remedy(self, error: TeletactError) -> TeletactError:
        if isinstance(error, Unavailable) and error.problem.startswith("failed to connect"):
            error.remedy = self._peer.remedy()
        return error

    # --- what it says -----------------------------------------------------------------------------------------

    def _taken(self, message: palpation.Observation) -> Observation:
        if message.state != self._state + 1:
            raise BadAnswer(f"{message.state} after {self._state}", field="state", call=_CALL)
        if len(message.maps) > _MOST_PARTS:
            raise BadAnswer(f"{len(message.maps)} parts", field="maps", call=_CALL)
        scene = scenes.scene_from(message.scene, _CALL) if message.HasField("scene") else None
        answer = answer_from(message.answer, math.nan) if message.HasField("answer") else None
        surface = _surface_from(message.surface) if message.HasField("surface") else None
        parts: dict[str, list[_Part]] = {}
        b_mode = dict(self.b_mode)
        changed: dict[str | int, None] = {}
        for part in message.maps:
            name = part.map.name
            if name not in self._open.maps:
                raise BadAnswer("not asked for", field=f"map '{name[:100]}'", call=_CALL)
            values = _values_of(part.map)
            if name == "b_mode":
                b_mode[part.window_id] = values
                changed[int(part.window_id)] = None
            else:
                parts.setdefault(name, []).append(_Part(values, part.map.grid))
                changed[name] = None
        if sum(values.nbytes for values in b_mode.values()) > _MOST_B_MODE_BYTES:
            raise BadAnswer(f"more than {_MOST_B_MODE_BYTES >> 20} MB in all", field="map 'b_mode'", call=_CALL)
        canvases = self._canvases | {name: _drawn(name, self._canvases.get(name), of) for name, of in parts.items()}
        self._state, self._canvases, self.b_mode = message.state, canvases, b_mode
        self.maps = self.maps | {name: canvases[name].shown(name) for name in parts}
        return Observation(message.state, message.scene_version, message.steered_by if message.steered else "", scene,
                           tuple(changed), answer, surface, message)


class _Part:
    """A rectangle of a map: values over y, x, of which the first is at ``origin_m`` and they are ``step_m`` apart."""

    def __init__(self, values: xr.DataArray, grid: Any) -> None:
        self.values, self.attrs = values.values, values.attrs
        self.origin_m = (grid.origin_m[1], grid.origin_m[0])
        self.step_m = (grid.spacing_m[1], grid.spacing_m[0])

    def shown(self, name: str) -> xr.DataArray:
        coords = {axis: (axis, origin_m + step_m * np.arange(count), {"units": "m"})
                  for axis, origin_m, step_m, count in zip(("y", "x"), self.origin_m, self.step_m, self.values.shape)}
        return xr.DataArray(self.values, coords, ("y", "x"), name=name, attrs=self.attrs)


def _values_of(map_: Any) -> xr.DataArray:
    field = f"map '{map_.name}'"
    values = arrays.map_from(map_, _CALL)
    if values.ndim != 2 or 0 in values.shape:
        raise BadAnswer(f"a part of shape {values.shape}", field=field, call=_CALL)
    if map_.name == "valid":
        return arrays.is_valid(values, _CALL)
    if values.dtype != (np.uint8 if map_.name == "b_mode" else np.float32):
        raise BadAnswer(f"values of type {values.dtype}", field=field, call=_CALL)
    return values.where(values != 0) if map_.name == "youngs_modulus" else values  # 0: where nothing was published


def _drawn(name: str, known: _Part | None, parts: list[_Part]) -> _Part:
    """The map with the parts over it, as large as all of them; what was known is left as it was."""
    field = f"map '{name}'"
    first = known or parts[0]
    offsets = []
    for part in parts:
        offset = []
        for axis, from_m, at_m, step_m, its_m in zip("yx", first.origin_m, part.origin_m, first.step_m, part.step_m):
            cells = (at_m - from_m) / step_m
            if not abs(cells) < _MOST_CELLS:
                raise BadAnswer(f"a part {cells:.3g} cells away along {axis}", field=field, call=_CALL)
            if abs(cells - round(cells)) > _ALIGNED or abs(its_m - step_m) > _ALIGNED * step_m:
                raise BadAnswer(f"a part that is not on its grid along {axis}", field=field, call=_CALL)
            offset.append(round(cells))
        offsets.append(offset)
    pieces = [*([(known, [0, 0])] if known else []), *zip(parts, offsets)]
    begin = np.min([offset for _, offset in pieces], axis=0)
    end = np.max([np.add(offset, piece.values.shape) for piece, offset in pieces], axis=0)
    rows, columns = (int(count) for count in end - begin)
    if rows * columns > _MOST_CELLS:
        raise BadAnswer(f"{rows} x {columns} cells", field=field, call=_CALL)
    out = copy.copy(first)
    out.values = np.full((rows, columns), False if name == "valid" else np.float32(np.nan))
    out.origin_m = tuple(origin_m + step_m * int(cells)
                         for origin_m, step_m, cells in zip(first.origin_m, first.step_m, begin))
    for piece, offset in pieces:
        y, x = np.subtract(offset, begin)
        out.values[y:y + piece.values.shape[0], x:x + piece.values.shape[1]] = piece.values
    return out


def _surface_from(message: palpation.DeformedSurface) -> Surface:
    places: Mapping[str, arrays.Floats] = {"z": np.array(message.z_m, np.float64), "x": np.array(message.x_m, np.float64)}
    if not math.isfinite(message.depth_m) or not all(
            np.isfinite(at_m).all() and (np.diff(at_m) > 0).all() for at_m in places.values()):
        raise BadAnswer("places that are not finite or do not increase", field="surface", call=_CALL)
    shape = tuple(len(at_m) for at_m in places.values())
    moved = np.zeros(shape, np.float32)
    if 0 not in shape:
        moved = arrays.array_from(message.displacement_m, "surface.displacement_m", _CALL)
    if moved.shape != shape or not np.isfinite(moved).all():
        raise BadAnswer(f"not finite, or of shape {moved.shape} on {shape} nodes", field="surface.displacement_m",
                        call=_CALL)
    coords = {axis: (axis, at_m, {"units": "m"}) for axis, at_m in places.items()}
    return Surface(message.sequence, message.depth_m,
                   xr.DataArray(moved, coords, ("z", "x"), name="displacement", attrs={"units": "m"}))
