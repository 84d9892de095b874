"""Images that teletact-client, ITK, PLUS and SUPRA write: MetaImage (.mha, or .mhd with its data beside it)."""

from __future__ import annotations

import math
import warnings
import zlib
from pathlib import Path, PurePath

import numpy as np
import xarray as xr

from teletact.errors import DamagedFile

_TYPES = {"MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
          "MET_LONG": "i4", "MET_ULONG": "u4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8"}
_LONGEST_HEADER = 16 << 20
_LARGEST_COMPRESSION = 1100  # zlib cannot shrink by more than about 1032


def read_metaimage(path: str | Path) -> xr.DataArray:
    """An image with its places in metres, over y (depth) and x (A-lines); with ``frame`` where there are several, and
    with ``channel`` where an element has. The first axis of these files is depth, the fastest, unless
    UltrasoundImageOrientation says that it lies across the A-lines. Raises DamagedFile, also where the file does not
    state ElementSpacing, or is turned. A file that says it holds no RF is read with a warning."""
    data = _bytes_of(Path(path))
    header, begin = _header_of(path, data)

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

    def is_true(field: str, usual: bool = False) -> bool:  # as MetaIO reads it
        return header[field][:1] in ("T", "t", "1") if field in header else usual

    if header.get("NDims") not in ("2", "3", "4"):
        raise refuse("NDims", "images of two dimensions, and of frames, are read")
    dims = int(header["NDims"])
    if not is_true("BinaryData", True):
        raise refuse("BinaryData", "save it binary")
    if header.get("ElementType") not in _TYPES:
        raise refuse("ElementType", f"one of {', '.join(_TYPES)} is read")
    for field in ("TransformMatrix", "Rotation", "Orientation"):
        side = 3 if dims == 4 and len(header.get(field, "").split()) == 9 else dims
        if field in header and numbers(field, side * side) != [float(k % (side + 1) == 0) for k in range(side * side)]:
            raise refuse(field, "resample the image to its own axes: the identity is read")
    size = numbers("DimSize", dims)
    origin = numbers(next((name for name in ("Offset", "Position", "Origin") if name in header), "Offset"), dims,
                     "0 " * dims)
    spacing_field = "ElementSize" if "ElementSize" in header and "ElementSpacing" not in header else "ElementSpacing"
    if spacing_field not in header:
        raise refuse("ElementSpacing", "add it: metres along depth, and between A-lines")
    spacing = numbers(spacing_field, dims)
    channels = numbers("ElementNumberOfChannels", 1, "1")
    if any(n < 1 or n % 1 for n in (*size, *channels)) or min(spacing) <= 0:
        raise refuse("DimSize", "sizes are whole numbers above 0, spacings above 0")
    if dims == 4 and size[2] != 1:
        raise refuse("DimSize", "give planes: the third of four dimensions is 1")
    is_big = is_true("BinaryDataByteOrderMSB") or is_true("ElementByteOrderMSB")
    dtype = np.dtype((">" if is_big else "<") + _TYPES[header["ElementType"]])
    frames = 1 if dims == 2 else int(size[-1])
    shape = (frames, int(size[1]), int(size[0]), int(channels[0]))
    samples = _samples(path, header, data, begin, math.prod(shape) * dtype.itemsize, is_true("CompressedData"))
    values = np.frombuffer(samples, dtype).reshape(shape).astype(dtype.newbyteorder("="), copy=False)
    kind, turned = header.get("UltrasoundImageType", "RF_REAL"), header.get("UltrasoundImageOrientation", "")[:1] in ("M", "U")
    if kind != "RF_REAL":
        warnings.warn(f"{path}: UltrasoundImageType = {kind}: it says that it holds no RF", stacklevel=2)
    axes = "xy" if turned else "yx"
    coords = {axis: (axis, origin[k] + spacing[k] * np.arange(int(size[k])), {"units": "m"}) for k, axis in enumerate(axes)}
    image = xr.DataArray(values, coords, ("frame", axes[1], axes[0], "channel")).transpose("y", "x", "frame", "channel")
    if frames == 1:
        image = image.isel(frame=0)
    return image.isel(channel=0) if shape[3] == 1 else image


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DamagedFile(f"{path} cannot be read ({error.strerror})", remedy="give another file") from None


def _header_of(path: str | Path, data: bytes) -> tuple[dict[str, str], int]:
    """Its fields, and where it ends."""
    header: dict[str, str] = {}
    begin = 0
    while "ElementDataFile" not in header:
        end = data.find(b"\n", begin, _LONGEST_HEADER)
        line = data[begin:end].decode("latin-1")
        name, mark, value = line.partition("=") if "=" in line else line.partition(":")
        if end < 0 or not mark:
            if "NDims" in header and len(data) > _LONGEST_HEADER and end < 0:
                raise DamagedFile(f"{path}: its header is longer than 16 MiB", remedy="save fewer frames in one file")
            raise DamagedFile(f"{path} is no MetaImage", remedy="give an .mha or .mhd file")
        if name.strip() in header:
            raise DamagedFile(f"{path}: it is given twice", field=name.strip(), remedy="keep one")
        header[name.strip()] = value.strip()
        begin = end + 1
    return header, begin


def _samples(path: str | Path, header: dict[str, str], data: bytes, begin: int, wanted: int, packed: bool) -> bytes:
    name = header["ElementDataFile"]
    if name.lower() != "local":
        # A header from elsewhere must not have other files of this person read.
        if name in ("", "..") or PurePath(name).name != name or name.startswith("LIST") or "%" in name:
            raise DamagedFile(f"{path}: {name}", field="ElementDataFile", remedy="give one file beside this one")
        data, begin = _bytes_of(Path(path).parent / name), 0
    try:
        skipped = int(header.get("HeaderSize", "0"))
        stored = int(header.get("CompressedDataSize", "0")) if packed else wanted
    except ValueError:
        raise DamagedFile(f"{path}: it is no number", field="HeaderSize", remedy="correct the header") from None
    if skipped > 0:
        begin = skipped
    elif skipped == -1 and 0 < stored <= len(data):
        begin = len(data) - stored
    out = data[begin:]
    if packed and wanted <= _LARGEST_COMPRESSION * len(out):
        unpack = zlib.decompressobj(32 + zlib.MAX_WBITS)  # zlib's or gzip's
        try:
            out = unpack.decompress(out, wanted + 1)
        except zlib.error:
            out = b""
        if not unpack.eof:
            out = b""
    if len(out) != wanted:
        raise DamagedFile(f"{path}: {header['DimSize']}", field="DimSize",
                          remedy="the file must hold exactly the elements that it states")
    return out
