"""A peer of the OpenIGTLink server that reads messages with the published header."""

import socket
import struct
import time

import numpy as np
import xarray as xr

from teletact import igtl_messages as messages


def plane(rows=4, columns=3, first=0.0):
    values = (first + np.arange(rows * columns, dtype=np.float32)).reshape(rows, columns)
    return xr.DataArray(values, {"y": 0.001 + 0.002 * np.arange(rows), "x": 0.01 + 0.0005 * np.arange(columns)},
                        ("y", "x"))


class Client:
    """Reads messages with the published header."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.settimeout(30)

    def take(self, size):
        out = b""
        while len(out) < size:
            data = self.socket.recv(size - len(out))
            assert data, "closed"
            out += data
        return out

    def next(self):
        """(version, type, name, unix_s, body), its CRC checked bit by bit of the polynomial where it is small."""
        version, type_, name, seconds, fraction, size, crc = struct.unpack(">H12s20sIIQQ", self.take(58))
        body = self.take(size)
        self.got_s = time.time()
        assert crc == (bitwise(body) if size < 2000 else messages.crc64(body))
        return version, type_.rstrip(b"\0").decode(), name.rstrip(b"\0").decode(), seconds + fraction / 2**32, body

    def until(self, type_, met=lambda body: True, seconds=60):
        end, seen = time.monotonic() + seconds, []
        while time.monotonic() < end:
            message = self.next()
            if message[1] == type_ and met(message[4]):
                return message
            seen.append(message[1:3] + (message[4][:80],))
        raise AssertionError(f"not among {seen[-5:]}")


def until(met, what="", seconds=30):
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, what
        time.sleep(0.005)


def bitwise(data):
    crc = 0
    for byte in data:
        crc ^= byte << 56
        for _ in range(8):
            crc = (crc << 1) ^ (0x42F0E1EBA9EA3693 if crc >> 63 else 0)
            crc &= 2**64 - 1
    return crc
