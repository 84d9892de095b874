"""From RF frames to maps: what Estimate is asked, and what it answers."""

from __future__ import annotations

from typing import Any, Collection, Iterator

import numpy as np
import xarray as xr

from teletact import arrays
from teletact.errors import BadAnswer, InvalidArgument, TeletactError
from teletact.v1 import common_pb2 as common
from teletact.v1 import elastography_pb2 as elastography

_CHUNK_BYTES = 1 << 20  # the contract's largest
_FRAMES = {"probe": elastography.DISPLACEMENT_FRAME_PROBE, "lab": elastography.DISPLACEMENT_FRAME_LAB}
_PLANES = {"strain": elastography.PLANE_CONDITION_STRAIN, "stress": elastography.PLANE_CONDITION_STRESS,
           "solid": elastography.PLANE_CONDITION_SOLID}
_METHODS = {"reference-stress": elastography.MODULUS_METHOD_REFERENCE_STRESS,
            "direct": elastography.MODULUS_METHOD_DIRECT, "iterative": elastography.MODULUS_METHOD_ITERATIVE,
            "solid": elastography.MODULUS_METHOD_SOLID}
_SURFACES = {"unknown": elastography.SURFACE_KIND_UNSPECIFIED, "bare": elastography.SURFACE_KIND_BARE,
             "capsule": elastography.SURFACE_KIND_CAPSULE, "uneven": elastography.SURFACE_KIND_UNEVEN}
_SIZES = ("sample_count", "line_count")  # ends of the fields that refuse them
_METHOD_NAMES = {number: name for name, number in _METHODS.items()}


def _named(field: str, name: str, known: dict[str, Any]) -> Any:
    if name not in known:
        raise InvalidArgument(f"{name!r}", field=field, remedy=f"give one of {', '.join(known)}")
    return known[name]


def rf_frame(values: Any, field: str) -> Any:
    """A frame as the contract has it: int16 or float32, shape (lines, samples). ``values``: (samples, lines)."""
    if isinstance(values, xr.DataArray) and set(values.dims) == {"y", "x"}:
        values = values.transpose("y", "x")
    frame = arrays.numbers(values, field, (2,))
    if frame.dtype == np.int16:
        dtype = "<i2"
    elif frame.dtype.kind == "f":
        dtype = "<f4"
    else:
        raise InvalidArgument(f"samples of type {frame.dtype}", field=field,
                              remedy="give int16, or convert them with .astype('float32')")
    return np.ascontiguousarray(frame.T, dtype)


def _set(message: Any, numbers: dict[str, float | None]) -> None:
    for field, value in numbers.items():
        if value is None:
            continue
        if ("_std" in field or field == "force_gain") and not value > 0:  # 0 is the contract's default
            raise InvalidArgument(f"{value}", field=field, remedy="give a number above 0, or leave it out")
        setattr(message, field, float(value))


def acquisition_of(pre: Any, post: Any, *, frame: str, plane: str | None, method: str | None,
                   force_n: float | None, contact_area_m2: float | None, sensor: dict[str, float | None],
                   surface: str | None, publish: str | None, window_x_m: float | None, maps: Collection[str] | None,
                   numbers: dict[str, float | None]) -> elastography.Acquisition:
    """``pre``, ``post``: as rf_frame gives them. ``numbers`` and, of the force, ``sensor``: fields of the messages
    that are sent where given."""
    if pre.shape != post.shape or pre.dtype != post.dtype:
        raise InvalidArgument(f"pre is {pre.shape[::-1]} {pre.dtype}, post is {post.shape[::-1]} {post.dtype}",
                              field="post", remedy="give frames of one shape and type")
    out = elastography.Acquisition(sample_count=pre.shape[1], line_count=pre.shape[0])
    out.dtype = common.DATA_TYPE_INT16 if pre.dtype == np.int16 else common.DATA_TYPE_FLOAT32
    out.displacement_frame = _named("frame", frame, _FRAMES)
    out.plane = _named("plane", plane or ("strain" if publish else "solid"), _PLANES)
    if method is not None:
        out.modulus_method = _named("method", method, _METHODS)
    if surface is not None:
        out.surface = _named("surface", surface, _SURFACES)
    _set(out, numbers)
    if (force_n is None) != (contact_area_m2 is None):
        raise InvalidArgument("only one is given", field="force_n, contact_area_m2", remedy="give both or none")
    if force_n is not None and contact_area_m2 is not None:
        _set(out.probe_force, {"force_n": force_n, "contact_area_m2": contact_area_m2, **sensor})
    elif given := [field for field, value in sensor.items() if value is not None]:
        raise InvalidArgument("without a force", field=given[0], remedy="give force_n and contact_area_m2 with it")
    if (publish is None) != (window_x_m is None):
        raise InvalidArgument("only one is given", field="publish, window_x_m",
                              remedy="give the scene and where the window's left border is in it, or neither")
    if publish is not None and window_x_m is not None:
        out.publish.scene_id = publish
        out.publish.window.origin_m.extend([window_x_m, 0.0, 0.0])
    if maps is not None:
        out.maps.extend(dict.fromkeys([*maps, "valid"]))  # what is not valid is never told without it
    return out


def requests_of(acquisition: elastography.Acquisition, pre: Any, post: Any) -> Iterator[elastography.EstimateRequest]:
    """The messages of a call, one after the other."""
    yield elastography.EstimateRequest(acquisition=acquisition)
    for kind, frame in ((elastography.FRAME_KIND_PRE, pre), (elastography.FRAME_KIND_POST, post)):
        data = memoryview(frame).cast("B")
        for offset in range(0, len(data), _CHUNK_BYTES):
            request = elastography.EstimateRequest()
            request.chunk.frame, request.chunk.offset_bytes = kind, offset
            request.chunk.data = bytes(data[offset:offset + _CHUNK_BYTES])
            yield request


def lies_across(frame: Any) -> bool:
    """Whether the samples of ``frame``, (lines, samples), oscillate across the lines and not along them."""
    def low(lines: Any) -> float:  # the mean spectrum's density at its low end over that at its peak
        piece = min(128, lines.shape[1])
        pieces = lines[::max(1, len(lines) // 256), :lines.shape[1] // piece * piece].reshape(-1, piece).astype(float)
        pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * np.hanning(piece)
        each = np.abs(np.fft.rfft(pieces)) ** 2
        density = (each / np.maximum(each.sum(axis=1, keepdims=True), np.finfo(float).tiny)).mean(axis=0)
        return float(density[1:3].mean() / density[1:].max()) if density[1:].any() else float("nan")
    return low(frame) > 0.5 and low(frame.T) < 0.25  # echoes have 0.004 at most, across the lines 0.85


def with_cause(error: TeletactError, frame: Any) -> TeletactError:
    """``error``; where a size is refused because the axes of ``frame`` are exchanged, with that."""
    if not isinstance(error, InvalidArgument) or not error.field.endswith(_SIZES) or not lies_across(frame):
        return error
    return InvalidArgument(error.problem, field=error.field, call=error.call,
                           remedy="the samples oscillate along the second axis: give pre.T and post.T")


class Answers:
    """Collects what a call answers."""

    def __init__(self, acquisition: elastography.Acquisition, call: str) -> None:
        self._asked, self._call = set(acquisition.maps), call
        self._maps: dict[str, xr.DataArray] = {}
        self._summary: elastography.EstimateSummary | None = None

    def take(self, response: elastography.EstimateResponse) -> None:
        kind = response.WhichOneof("kind")
        if kind in ("map", "summary") and self._summary is not None:
            raise BadAnswer("more after the summary", field=kind, call=self._call)
        if kind == "summary":
            self._summary = response.summary
        elif kind == "map":
            map_ = arrays.map_from(response.map.map, self._call)
            name = str(map_.name)
            if name in self._maps or (self._asked and name not in self._asked):
                raise BadAnswer("twice, or not asked for", field=f"map '{name}'", call=self._call)
            if name == "b_mode":  # lies on a grid of its own
                map_ = map_.rename({axis: f"{axis}_b_mode" for axis in map_.dims})
            elif any(map_.shape != other.shape for key, other in self._maps.items() if key != "b_mode"):
                raise BadAnswer("not on the grid of the others", field=f"map '{name}'", call=self._call)
            self._maps[name] = map_

    def dataset(self) -> xr.Dataset:
        """All of it. Raises BadAnswer where something is missing."""
        summary = self._summary
        if summary is None:
            raise BadAnswer("the call ended without one", field="summary", call=self._call)
        for name in self._asked | {"valid"}:
            if name not in self._maps:
                raise BadAnswer("it was not sent", field=f"map '{name}'", call=self._call)
        valid = arrays.is_valid(self._maps.pop("valid"), self._call)
        out = xr.Dataset({"valid": valid})
        for name, map_ in self._maps.items():
            out[name] = map_ if name in ("correlation", "b_mode") else arrays.masked(map_, valid, self._call)
        out.attrs = {  # what NetCDF can hold, so truths are 0 or 1
            "warnings": list(summary.warnings),
            "modulus_absolute": int(summary.modulus_absolute),
            "background_modulus": summary.background_modulus_pa,
            "modulus_method": _METHOD_NAMES.get(summary.modulus_method, ""),
            "modulus_converged": int(summary.modulus_converged),
            "modulus_iterations": summary.modulus_iterations,
            "modulus_model": summary.modulus_model,
            "median_correlation": summary.median_correlation,
            "valid_fraction": summary.valid_fraction,
            "mean_axial_strain": summary.mean_axial_strain,
            "quality": summary.quality,
            "stages": [stage.stage for stage in summary.stages],
            "stages_s": [stage.seconds for stage in summary.stages],
        }
        if summary.HasField("youngs_modulus_correlation_m"):
            out.attrs["youngs_modulus_correlation_m"] = summary.youngs_modulus_correlation_m
        if summary.HasField("youngs_modulus_log_std"):
            out.attrs |= {"youngs_modulus_log_std": summary.youngs_modulus_log_std,
                          "youngs_modulus_common_log_std": summary.youngs_modulus_common_log_std}
        if summary.scene_id:
            out.attrs |= {"scene_id": summary.scene_id, "window_id": summary.window_id,
                          "scene_version": summary.scene_version,
                          "received_to_published_s": summary.received_to_published_s}
        return out
