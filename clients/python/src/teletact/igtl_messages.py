"""OpenIGTLink's messages, versions 1 and 2 of the header, written from the published protocol.

All numbers are big-endian. A header has 58 bytes: version, type (12), name (20), time (seconds, and 1/2^32 s), size of
the body, CRC64 of the body. With version 2 the body begins with an extended header and ends with metadata.
"""

from __future__ import annotations

import functools
import struct
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from teletact.errors import InvalidArgument

HEADER = struct.Struct(">H12s20sIIQQ")
_EXTENDED = struct.Struct(">HHII")
_IMAGE = struct.Struct(">HBBBB3H12f6H")
_TYPES = {"i1": 2, "u1": 3, "i2": 4, "u2": 5, "i4": 6, "u4": 7, "f4": 10, "f8": 11}
_LITTLE, _RAS, _UTF8 = 2, 1, 106
_MM = 1e3
_POLYNOMIAL = 0x42F0E1EBA9EA3693  # ECMA-182; begins at 0, nothing is reflected or inverted
_ROW = 512                        # bytes that a CRC is taken of at once, for all rows of a body

Words = npt.NDArray[np.uint64]


class BadMessage(Exception):
    """What a peer sent is no message; ``fatal``: where the next one begins is not known either."""

    def __init__(self, problem: str, fatal: bool = False) -> None:
        super().__init__(problem)
        self.fatal = fatal


# --- CRC64 ------------------------------------------------------------------------------------------------------


@functools.cache
def _table() -> Words:
    out = np.arange(256, dtype=np.uint64) << np.uint64(56)
    for _ in range(8):
        out = np.where(out >> np.uint64(63) == 1, (out << np.uint64(1)) ^ np.uint64(_POLYNOMIAL), out << np.uint64(1))
    return out


def _step(crc: Words, byte: Any) -> Words:
    index = (crc >> np.uint64(56)) ^ byte
    return np.asarray((crc << np.uint64(8)) ^ _table()[index.astype(np.intp)])


@functools.cache
def _row_later() -> Words:
    """What each bit of a CRC becomes behind a row of zeros: bytes before a row count so."""
    out = np.uint64(1) << np.arange(64, dtype=np.uint64)
    for _ in range(_ROW):
        out = _step(out, np.uint64(0))
    return out


def crc64(data: bytes) -> int:
    """Of any number of bytes: all rows of 512 at once, then one after the other, as the CRC is linear."""
    rows = -(-len(data) // _ROW)
    padded = bytes(rows * _ROW - len(data)) + data  # zeros before the first byte change nothing
    columns = np.frombuffer(padded, np.uint8).reshape(rows, _ROW).T.astype(np.uint64)
    of_rows = np.zeros(rows, np.uint64)
    for column in columns:
        of_rows = _step(of_rows, column)
    crc, bits = 0, np.arange(64, dtype=np.uint64)
    for of_row in of_rows:
        set_ = (np.uint64(crc) >> bits) & np.uint64(1) == 1
        crc = int(np.bitwise_xor.reduce(_row_later()[set_], initial=np.uint64(0)) ^ of_row)
    return crc


# --- out --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Message:
    """What is sent. ``unix_s``: when it was true."""

    type: str
    name: str
    content: bytes
    unix_s: float = field(default_factory=time.time)

    def __post_init__(self) -> None:
        if not (self.name.isascii() and self.name.isprintable() and 0 < len(self.name) <= 20):
            raise InvalidArgument(f"{self.name!r}", field="name", remedy="give 1 to 20 printable ASCII characters")

    @functools.cached_property
    def _checked(self) -> tuple[bytes, int]:
        return self.content, crc64(self.content)

    @functools.cached_property
    def _checked_extended(self) -> tuple[bytes, int]:
        body = _EXTENDED.pack(_EXTENDED.size, 2, 0, 0) + self.content + struct.pack(">H", 0)  # no metadata
        return body, crc64(body)

    def packed(self, version: int) -> bytes:
        """The whole message, with a header of version 1 or 2."""
        body, crc = self._checked_extended if version == 2 else self._checked
        seconds = int(self.unix_s)
        fraction = int((self.unix_s - seconds) * 2**32)
        return HEADER.pack(version, self.type.encode(), self.name.encode(), seconds, fraction, len(body), crc) + body


def image(name: str, values: xr.DataArray, unix_s: float) -> Message:
    """IMAGE of a map over y, x or z, y, x, whose places are metres and evenly spaced. The scene's x, y, z stand for R, A
    and S, in mm. Booleans become uint8; NaN stays: nobody measured there."""
    if values.dims not in (("y", "x"), ("z", "y", "x")) or 0 in values.shape or max(values.shape) > 0xFFFF:
        raise InvalidArgument(f"dims {values.dims}, shape {values.shape}", field="values",
                              remedy="give (y, x) or (z, y, x), each 1 to 65535 long")
    data = np.ascontiguousarray(values.values)
    data = data.astype("u1") if data.dtype == bool else np.ascontiguousarray(data, data.dtype.newbyteorder("<"))
    scalar = _TYPES.get(data.dtype.str[1:])
    if scalar is None:
        raise InvalidArgument(f"values of type {data.dtype}", field="values", remedy="give integers or floats")
    sizes, steps, centre = [1, 1, 1], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
    for k, axis in enumerate("xyz"):
        if axis in values.dims:
            places = _MM * values.coords[axis].values.astype(np.float64)
            sizes[k], centre[k] = len(places), float(places[0] + places[-1]) / 2
            if len(places) > 1:
                steps[k] = float(places[-1] - places[0]) / (len(places) - 1)
                if not np.allclose(np.diff(places), steps[k], rtol=1e-4, atol=0):
                    raise InvalidArgument("not evenly spaced", field=f"values.{axis}", remedy="interpolate first")
    columns = [steps[0], 0, 0, 0, steps[1], 0, 0, 0, steps[2], *centre]
    head = _IMAGE.pack(1, 1, scalar, _LITTLE, _RAS, *sizes, *columns, 0, 0, 0, *sizes)
    return Message("IMAGE", name, head + data.tobytes(), unix_s)


def transform(name: str, position_m: Any, unix_s: float) -> Message:
    """TRANSFORM: a place without a turn, x, y, z of the scene as R, A, S in mm."""
    place = _MM * np.asarray(position_m, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InvalidArgument(f"{position_m}", field="position_m", remedy="give three finite numbers, in metres")
    return Message("TRANSFORM", name, struct.pack(">12f", 1, 0, 0, 0, 1, 0, 0, 0, 1, *place), unix_s)


def string(name: str, text: str, unix_s: float) -> Message:
    """STRING, in UTF-8."""
    encoded = text.encode()
    if len(encoded) > 0xFFFF:
        raise InvalidArgument(f"{len(encoded)} bytes", field="text", remedy="give 65535 at most")
    return Message("STRING", name, struct.pack(">HH", _UTF8, len(encoded)) + encoded, unix_s)


# --- in ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Received:
    """What a peer sent: its header, and the content without extended header and metadata."""

    version: int
    type: str
    name: str
    content: bytes


class Reader:
    """Bytes in, messages out. ``max_bytes``: the largest body that is taken."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._bytes = bytearray()

    def feed(self, data: bytes) -> None:
        self._bytes += data

    def next(self) -> Received | None:
        """The next whole message; None: more bytes are needed. Raises BadMessage, the message taken away."""
        if len(self._bytes) < HEADER.size:
            return None
        version, type_, name, _, _, size, crc = HEADER.unpack_from(self._bytes)
        if version not in (1, 2):
            raise BadMessage(f"a header of version {version}; 1 and 2 are read", fatal=True)
        if size > self._max_bytes:
            raise BadMessage(f"a body of {size} bytes; at most {self._max_bytes} are read", fatal=True)
        if len(self._bytes) < HEADER.size + size:
            return None
        body = bytes(self._bytes[HEADER.size:HEADER.size + size])
        del self._bytes[:HEADER.size + size]
        words = [word.rstrip(b"\0 ") for word in (type_, name)]
        if not words[0] or not all(0x20 <= byte < 0x7F for word in words for byte in word):
            raise BadMessage("a type or name that is not printable ASCII")
        if crc64(body) != crc:
            raise BadMessage(f"{words[0].decode()} with a wrong CRC")
        if version == 2:
            body = _without_extension(body, words[0].decode())
        return Received(version, words[0].decode(), words[1].decode(), body)


def _without_extension(body: bytes, type_: str) -> bytes:
    if len(body) < _EXTENDED.size:
        raise BadMessage(f"{type_} without its extended header")
    head, metadata_head, metadata, _ = _EXTENDED.unpack_from(body)
    end = len(body) - metadata_head - metadata
    if head < _EXTENDED.size or end < head:
        raise BadMessage(f"{type_} whose extended header does not fit its body")
    return body[head:end]
