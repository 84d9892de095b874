"""Images that teletact-client writes: MetaImage (.mha), uncompressed, in one file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import xarray as xr

from teletact.errors import DamagedFile

_TYPES = {"MET_UCHAR": "u1", "MET_SHORT": "<i2", "MET_FLOAT": "<f4", "MET_DOUBLE": "<f8"}
_LONGEST_HEADER = 1 << 16


def read_metaimage(path: str | Path) -> xr.DataArray:
    """An image of two dimensions with its places in metres, over y (depth) and x (A-lines); with ``channel`` where an
    element has several. The first axis of these files is depth, the fastest. Raises DamagedFile."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise DamagedFile(f"{path} cannot be read ({error.strerror})", remedy="give another file") from None
    header: dict[str, str] = {}
    begin = 0
    while "ElementDataFile" not in header:
        end = data.find(b"\n", begin, _LONGEST_HEADER)
        name, mark, value = data[begin:end].decode("latin-1").partition("=")
        if end < 0 or not mark:
            raise DamagedFile(f"{path} is no MetaImage", remedy="give an .mha file")
        header[name.strip()] = value.strip()
        begin = end + 1

    def refuse(field: str, remedy: str) -> DamagedFile:
        return DamagedFile(f"{path}: {header.get(field, 'missing')}", field=field, remedy=remedy)

    def two(field: str, usual: str) -> list[float]:
        try:
            numbers = [float(word) for word in header.get(field, usual).split()]
        except ValueError:
            numbers = []
        if len(numbers) != 2 or not all(math.isfinite(number) for number in numbers):
            raise refuse(field, "two finite numbers are read")
        return numbers

    if header.get("NDims") != "2":
        raise refuse("NDims", "images of two dimensions are read")
    if header["ElementDataFile"] != "LOCAL":
        raise refuse("ElementDataFile", "data in the same file are read (LOCAL)")
    for field in ("CompressedData", "BinaryDataByteOrderMSB", "ElementByteOrderMSB"):
        if header.get(field, "False").lower() != "false":
            raise refuse(field, "uncompressed little-endian data are read")
    if header.get("ElementType") not in _TYPES:
        raise refuse("ElementType", f"one of {', '.join(_TYPES)} is read")
    size, spacing, origin = two("DimSize", ""), two("ElementSpacing", "1 1"), two("Offset", "0 0")
    channels = header.get("ElementNumberOfChannels", "1")
    if not channels.isdigit() or int(channels) < 1 or any(n < 1 or n % 1 for n in size) or min(spacing) <= 0:
        raise refuse("DimSize", "sizes are whole numbers above 0, spacings above 0")
    dtype = np.dtype(_TYPES[header["ElementType"]])
    shape = (int(size[1]), int(size[0]), int(channels))
    if math.prod(shape) * dtype.itemsize != len(data) - begin:
        raise refuse("DimSize", "the file must hold exactly the elements that it states")
    values = np.frombuffer(data, dtype, offset=begin).reshape(shape)
    coords = {axis: (axis, origin[k] + spacing[k] * np.arange(int(size[k])), {"units": "m"})
              for k, axis in enumerate("yx")}
    image = xr.DataArray(values, coords, ("x", "y", "channel")).transpose("y", "x", "channel")
    return image.isel(channel=0) if shape[2] == 1 else image
