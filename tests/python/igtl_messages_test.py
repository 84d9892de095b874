"""OpenIGTLink's messages as bytes: what is published of them, and what cannot be one."""

import struct
import time

import numpy as np
import pytest
import xarray as xr
from igtl_peer import bitwise, plane

import teletact
from teletact import igtl_messages as messages


def test_crc():
    assert messages.crc64(b"123456789") == 0x6C40DF5F0B497347  # of ECMA-182, as it is published
    for size in (0, 1, 511, 512, 513, 1025, 3000):
        data = np.random.default_rng(size).integers(0, 256, size, np.uint8).tobytes()
        assert messages.crc64(data) == bitwise(data)
    megabyte = bytes(range(256)) * 4096
    begin = time.process_time()
    messages.crc64(megabyte)
    print(f"CRC64 of 1 MiB: {1e3 * (time.process_time() - begin):.1f} ms of a processor")


@pytest.mark.parametrize("version", [1, 2])
def test_what_is_packed_is_read(version):
    reader = messages.Reader(1 << 20)
    packed = messages.string("force", "0.5 N, µ", 12.5).packed(version)
    for k in range(0, len(packed), 7):  # in pieces
        reader.feed(packed[k:k + 7])
    read = reader.next()
    assert (read.version, read.type, read.name) == (version, "STRING", "force")
    assert read.content[4:].decode() == "0.5 N, µ" and reader.next() is None
    assert struct.unpack(">II", packed[34:42]) == (12, 2**31)


def test_what_cannot_be_sent_is_refused():
    for values in (plane().T, plane()[:, 0], plane()[:0], xr.DataArray(np.zeros((2, 2)), dims=("a", "b")),
                   plane().astype("f2"), plane(1, 1).astype(str)):
        with pytest.raises(teletact.InvalidArgument, match="values"):
            messages.image("modulus", values, 0)
    uneven = plane().assign_coords(x=[0, 0.001, 0.003])
    with pytest.raises(teletact.InvalidArgument, match="evenly"):
        messages.image("modulus", uneven, 0)
    for name in ("", "x" * 21, "µ", "a\n"):
        with pytest.raises(teletact.InvalidArgument, match="name"):
            messages.string(name, "", 0)
    for place in ([0, 0], [0, 0, np.nan]):
        with pytest.raises(teletact.InvalidArgument, match="position_m"):
            messages.transform("finger", place, 0)
