"""Arrays of the contract as NumPy's and xarray's, and back. Lengths are metres."""

from __future__ import annotations

import math
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from teletact.errors import BadAnswer, InvalidArgument
from teletact.v1 import common_pb2 as common

Floats = npt.NDArray[np.float64]

_DTYPES: dict[int, np.dtype[Any]] = {
    common.DATA_TYPE_INT16: np.dtype("<i2"),
    common.DATA_TYPE_FLOAT32: np.dtype("<f4"),
    common.DATA_TYPE_FLOAT64: np.dtype("<f8"),
    common.DATA_TYPE_UINT8: np.dtype("u1"),
}
_AXES = ("x", "y", "z")


def array_from(message: Any, field: str, call: str) -> npt.NDArray[Any]:
    """A received Array, read-only. Raises BadAnswer where its bytes do not fill its shape."""
    dtype = _DTYPES.get(message.dtype)
    if dtype is None:
        raise BadAnswer(f"data type {message.dtype} is not known", field=field, call=call)
    shape = tuple(message.shape)
    if not shape or math.prod(shape) * dtype.itemsize != len(message.data):
        raise BadAnswer(f"{len(message.data)} bytes do not fill the shape {shape} of {dtype.name}", field=field,
                        call=call)
    return np.frombuffer(message.data, dtype).reshape(shape)


def array_to(values: npt.NDArray[Any], message: Any) -> None:
    """Fills an Array with float32 or float64 values."""
    double = values.dtype == np.float64
    message.dtype = common.DATA_TYPE_FLOAT64 if double else common.DATA_TYPE_FLOAT32
    message.shape.extend(values.shape)
    message.data = np.ascontiguousarray(values, "<f8" if double else "<f4").tobytes()


def map_from(message: Any, call: str) -> xr.DataArray:
    """A received Map: its values over the places of its nodes, x, y[, z] in metres, with its unit."""
    field = f"map '{message.name}'"
    values = array_from(message.values, field, call)
    grid = message.grid
    count = len(grid.size)
    if count not in (2, 3) or len(grid.origin_m) != count or len(grid.spacing_m) != count:
        raise BadAnswer("its grid has not two or three axes", field=field, call=call)
    if values.shape != tuple(reversed(grid.size)):
        raise BadAnswer(f"shape {values.shape} is not that of its grid, {tuple(reversed(grid.size))}", field=field,
                        call=call)
    coords = {}
    for axis, size, origin_m, spacing_m in zip(_AXES, grid.size, grid.origin_m, grid.spacing_m):
        if not (math.isfinite(origin_m) and 0 < spacing_m < math.inf):
            raise BadAnswer(f"its grid along {axis} begins at {origin_m} m, {spacing_m} m apart", field=field,
                            call=call)
        coords[axis] = (axis, origin_m + spacing_m * np.arange(size), {"units": "m"})
    dims = _AXES[:count][::-1]
    return xr.DataArray(values, coords, dims, name=message.name, attrs={"units": message.unit})


def masked(values: xr.DataArray, valid: xr.DataArray, call: str) -> xr.DataArray:
    """NaN where not valid. Raises BadAnswer where a valid value is not finite."""
    if values.shape != valid.shape:
        raise BadAnswer("its grid is not that of 'valid'", field=f"map '{values.name}'", call=call)
    out = np.where(valid.values, values.values, np.float32(np.nan))
    if not np.isfinite(values.values[valid.values]).all():
        raise BadAnswer("not finite where it is valid", field=f"map '{values.name}'", call=call)
    return values.copy(data=out)


def is_valid(flags: xr.DataArray, call: str) -> xr.DataArray:
    """A map of flags as booleans."""
    if flags.dtype != np.uint8 or (flags.values > 1).any():
        raise BadAnswer("flags must be 0 or 1", field="map 'valid'", call=call)
    return flags.astype(bool)


def numbers(values: Any, field: str, dimensions: Sequence[int], dtype: Any = None) -> npt.NDArray[Any]:
    """An argument as an array of finite numbers. Raises InvalidArgument."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InvalidArgument(f"no array ({error})", field=field, remedy="give numbers of one shape") from None
    if array.dtype.kind not in "iuf":
        raise InvalidArgument(f"values of type {array.dtype}", field=field, remedy="give real numbers")
    if array.ndim not in dimensions:
        allowed = " or ".join(str(n) for n in dimensions)
        raise InvalidArgument(f"an array of {array.ndim} dimensions", field=field, remedy=f"give one of {allowed}")
    if dtype is not None:
        array = array.astype(dtype)
    if not np.isfinite(array).all():
        raise InvalidArgument("not finite", field=field, remedy="replace or crop NaN and infinity")
    return array


def vector(values: Any, field: str) -> Floats:
    """An argument [x, y] or [x, y, z], with z = 0 where there is none."""
    given = numbers(values, field, (1,), np.float64)
    if given.size not in (2, 3):
        raise InvalidArgument(f"{given.size} values", field=field, remedy="give [x, y] or [x, y, z]")
    return np.append(given, 0.0) if given.size == 2 else given


def vectors(values: Any, field: str) -> Floats:
    """The same of many: shape (n, 3)."""
    given = numbers(values, field, (2,), np.float64)
    if given.shape[1] not in (2, 3):
        raise InvalidArgument(f"{given.shape[1]} columns", field=field, remedy="give rows [x, y] or [x, y, z]")
    return given if given.shape[1] == 3 else np.column_stack([given, np.zeros(len(given))])
