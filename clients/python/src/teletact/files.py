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
    element has several. The first axis of these files is depth, the fastest. Raises DamagedFile, also where the file
    does not state ElementSpacing, or is turned."""
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
        if name.strip() in header:
            raise DamagedFile(f"{path}: it is given twice", field=name.strip(), remedy="keep one")
        header[name.strip()] = value.strip()
        begin = end + 1

    def refuse(field: str, remedy: str) -> DamagedFile:
        return DamagedFile(f"{path}: {header.get(field, 'missing')}", field=field, remedy=remedy)

    def numbers(field: str, count: int, usual: str = "") -> list[float]:
        try:
            out = [float(word) for word in header.get(field, usual).split()]
        except ValueError:
            out = []
        if len(out) != count or not all(math.isfinite(number) for number in out):
            raise refuse(field, f"give {count} finite numbers")
        return out

    if header.get("NDims") != "2":
        raise refuse("NDims", "images of two dimensions are read")
    if header["ElementDataFile"] != "LOCAL":
        raise refuse("ElementDataFile", "data in the same file are read (LOCAL)")
    for field, wanted in (("BinaryData", True), ("CompressedData", False), ("BinaryDataByteOrderMSB", False),
                          ("ElementByteOrderMSB", False)):
        if field in header and (header[field][:1] in ("T", "t", "1")) != wanted:  # true as MetaIO reads it
            raise refuse(field, "save it binary, uncompressed and little-endian")
    if header.get("ElementType") not in _TYPES:
        raise refuse("ElementType", f"one of {', '.join(_TYPES)} is read")
    for field in ("TransformMatrix", "Rotation", "Orientation"):
        if field in header and numbers(field, 4) != [1, 0, 0, 1]:
            raise refuse(field, "resample the image to its own axes: the identity is read")
    size = numbers("DimSize", 2)
    origin = numbers(next((name for name in ("Offset", "Position", "Origin") if name in header), "Offset"), 2, "0 0")
    if "ElementSpacing" not in header:
        raise refuse("ElementSpacing", "add it: metres along depth, and between A-lines")
    spacing = numbers("ElementSpacing", 2)
    channels = numbers("ElementNumberOfChannels", 1, "1")
    if any(n < 1 or n % 1 for n in (*size, *channels)) or min(spacing) <= 0:
        raise refuse("DimSize", "sizes are whole numbers above 0, spacings above 0")
    dtype = np.dtype(_TYPES[header["ElementType"]])
    shape = (int(size[1]), int(size[0]), int(channels[0]))
    if math.prod(shape) * dtype.itemsize != len(data) - begin:
        raise refuse("DimSize", "the file must hold exactly the elements that it states")
    values = np.frombuffer(data, dtype, offset=begin).reshape(shape)
    coords = {axis: (axis, origin[k] + spacing[k] * np.arange(int(size[k])), {"units": "m"})
              for k, axis in enumerate("yx")}
    image = xr.DataArray(values, coords, ("x", "y", "channel")).transpose("y", "x", "channel")
    return image.isel(channel=0) if shape[2] == 1 else image
