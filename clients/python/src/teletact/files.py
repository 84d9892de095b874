"""Images that teletact-client, ITK, PLUS and SUPRA write: MetaImage (.mha, or .mhd with its data beside it). What is
refused, and in which words, is as in client/files/metaimage.cpp."""

from __future__ import annotations

import math
import re
import warnings
import zlib
from pathlib import Path, PurePath

import numpy as np
import xarray as xr

from teletact.errors import DamagedFile, one_line

_TYPES = {"MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
          "MET_LONG": "i4", "MET_ULONG": "u4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8"}
_LONGEST_HEADER = 16 << 20
_LARGEST_DIMENSION = 1 << 24
_LARGEST_COMPRESSION = 1100  # zlib cannot shrink by more than about 1032


def read_metaimage(path: str | Path) -> xr.DataArray:
    """An image with its places in metres, over y (depth) and x (A-lines); with ``frame`` where there are several, and
    with ``channel`` where an element has. The first axis of these files is depth, the fastest, unless
    UltrasoundImageOrientation says that it lies across the A-lines. Raises DamagedFile, also where the file does not
    state ElementSpacing, or is turned. A file that says it holds no RF is read with a warning."""
    path = Path(path)
    data = _bytes_of(path)
    header, begin = _header_of(path, data)

    def numbers(field: str, count: int) -> list[float]:
        out = []
        for word in header[field].split():
            try:
                out.append(float(word))
            except ValueError:
                out.append(math.nan)
            if not math.isfinite(out[-1]):
                raise _refusal(path, field, f"header field {field}: '{word}' is not a number")
        if len(out) != count:
            raise _refusal(path, field, f"header field {field} has {len(out)} values, not {count}")
        return out

    def wholes(field: str, count: int, largest: int) -> list[int]:
        out = numbers(field, count)
        if any(not 1 <= value <= largest or value % 1 for value in out):
            raise _refusal(path, field, f"header field {field} must be a whole number from 1 to {largest}")
        return [int(value) for value in out]

    def is_true(field: str, usual: bool = False) -> bool:  # as MetaIO reads it
        return header[field][:1] in ("T", "t", "1") if field in header else usual

    for field in ("NDims", "DimSize", "ElementType"):
        if field not in header:
            raise _refusal(path, field, f"header field {field} is missing", "add it")
    if not is_true("BinaryData", True):
        raise _refusal(path, "BinaryData", "BinaryData = False is not supported", "save it as binary")
    [dims] = wholes("NDims", 1, 4)
    if dims < 2:
        raise _refusal(path, "NDims", "NDims must be 2, 3 or 4", "give an image of A-lines")
    for field in ("TransformMatrix", "Rotation", "Orientation"):
        side = 3 if dims == 4 and len(header.get(field, "").split()) == 9 else dims
        if field in header and numbers(field, side * side) != [float(k % (side + 1) == 0) for k in range(side * side)]:
            raise _refusal(path, field, f"{field} is not the identity", "resample the image to its own axes")
    size = wholes("DimSize", dims, _LARGEST_DIMENSION)
    channels = wholes("ElementNumberOfChannels", 1, 4096)[0] if "ElementNumberOfChannels" in header else 1
    if header["ElementType"] not in _TYPES:
        raise _refusal(path, "ElementType", f"ElementType {header['ElementType']} is not supported",
                       "use MET_SHORT, MET_FLOAT, MET_DOUBLE or MET_UCHAR")
    spacing_field = "ElementSize" if "ElementSize" in header and "ElementSpacing" not in header else "ElementSpacing"
    if spacing_field not in header:
        raise _refusal(path, spacing_field, "header field ElementSpacing is missing",
                       "add it: metres along depth, and between A-lines")
    spacing = numbers(spacing_field, dims)
    if min(spacing) <= 0:
        raise _refusal(path, spacing_field, f"header field {spacing_field} must be positive")
    origin_field = next((name for name in ("Offset", "Position", "Origin") if name in header), None)
    origin = numbers(origin_field, dims) if origin_field else [0.0] * dims
    if dims == 4 and size[2] != 1:
        raise _refusal(path, "DimSize", f"NDims is 4: each image has {size[2]} channels or planes",
                       "beamform them, and save samples x A-lines x frames")
    if header.get("HeaderSize", "0") not in ("0", "-1"):
        raise _refusal(path, "HeaderSize", f"HeaderSize = {header['HeaderSize']} is not supported",
                       "convert it to one .mha file")
    is_big = is_true("BinaryDataByteOrderMSB") or is_true("ElementByteOrderMSB")
    dtype = np.dtype((">" if is_big else "<") + _TYPES[header["ElementType"]])
    shape = (size[-1] if dims > 2 else 1, size[1], size[0], channels)
    place, stored = _stored(path, header["ElementDataFile"], data[begin:])
    samples = _samples(place, stored, math.prod(shape) * dtype.itemsize, is_true("CompressedData"))
    values = np.frombuffer(samples, dtype).reshape(shape).astype(dtype.newbyteorder("="), copy=False)
    kind = header.get("UltrasoundImageType", "RF_REAL")
    if kind != "RF_REAL":
        warnings.warn(one_line(f"{path}: says UltrasoundImageType = {kind}: it may hold no RF"), stacklevel=2)
    axes = "xy" if header.get("UltrasoundImageOrientation", "")[:1] in ("M", "U") else "yx"
    coords = {axis: (axis, origin[k] + spacing[k] * np.arange(size[k]), {"units": "m"}) for k, axis in enumerate(axes)}
    image = xr.DataArray(values, coords, ("frame", axes[1], axes[0], "channel")).transpose("y", "x", "frame", "channel")
    return image.isel({name: 0 for name in ("frame", "channel") if image.sizes[name] == 1})


def _refusal(path: Path, field: str, problem: str, remedy: str = "correct the header") -> DamagedFile:
    return DamagedFile(one_line(f"{path}: {problem}"), field=one_line(field), remedy=remedy)


def _bytes_of(path: Path) -> bytes:
    if path.exists() and not path.is_file():
        raise DamagedFile(f"{path}: is not a file", remedy="give the path of a file")
    try:
        return path.read_bytes()
    except OSError as error:
        raise DamagedFile(f"{path}: cannot be read ({error.strerror})", remedy="check its path and permissions") from None


def _header_of(path: Path, data: bytes) -> tuple[dict[str, str], int]:
    """Its fields, and where it ends."""
    header: dict[str, str] = {}
    begin = 0
    while (end := data.find(b"\n", begin, _LONGEST_HEADER)) >= 0:
        line = data[begin:end].decode("latin-1").strip()
        begin = end + 1
        field, *value = (part.strip() for part in re.split("[=:]", line, maxsplit=1))  # MetaIO takes either
        if not value:
            if "ObjectType" not in header and "NDims" not in header:
                break
            if line:
                raise _refusal(path, "", f"header line '{line}' has no '='", "delete it")
            continue
        if field in header:
            raise _refusal(path, field, f"header field {field} is given twice", "keep one")
        header[field] = value[0]
        if field == "ElementDataFile":  # by definition the last one
            return header, begin
    if "NDims" in header and len(data) >= _LONGEST_HEADER:
        raise _refusal(path, "", "its header is longer than 16 MiB", "save fewer frames in one file")
    raise _refusal(path, "", "is not a MetaImage: its header has no ElementDataFile line", "give an .mha or .mhd file")


def _stored(path: Path, name: str, behind: bytes) -> tuple[Path, bytes]:
    """The file that holds the samples, and the samples as it holds them."""
    if name in ("LOCAL", "Local", "local"):
        return path, behind
    # A header from elsewhere must not have other files of this person read.
    if name in ("", "..") or PurePath(name).name != name or name.startswith("LIST") or "%" in name:
        raise _refusal(path, "ElementDataFile", f"ElementDataFile {name} is not one file beside this one",
                       "convert it to one .mha file")
    return path.parent / name, _bytes_of(path.parent / name)


def _samples(path: Path, stored: bytes, wanted: int, packed: bool) -> bytes:
    if wanted > _LARGEST_COMPRESSION * len(stored) if packed else wanted != len(stored):
        raise _refusal(path, "DimSize", f"its header declares {wanted} bytes of samples but {len(stored)}"
                       f"{' packed ones' if packed else ''} follow",
                       f"the file is {'truncated' if wanted > len(stored) else 'corrupt'}: copy or export it again")
    if not packed:
        return stored
    unpack = zlib.decompressobj(32 + zlib.MAX_WBITS)  # zlib's or gzip's
    try:
        out = unpack.decompress(stored, wanted + 1)
    except zlib.error:
        out = b""
    if len(out) != wanted or not unpack.eof:
        raise _refusal(path, "DimSize", "its packed samples are damaged, or not as many as its header declares",
                       "export it again")
    return out
