"""Scenes of tissue: what a service says of them, and how one is asked for. Lengths are metres, moduli Pa."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Collection, Mapping

import numpy as np
import xarray as xr

from teletact import arrays
from teletact.errors import BadAnswer, InvalidArgument
from teletact.v1 import info_pb2 as info
from teletact.v1 import palpation_pb2 as palpation

FACES = ("surface", "bottom", "x_min", "x_max")
_KINDS = {palpation.SCENE_KIND_PLANE: "plane", palpation.SCENE_KIND_EXTRUDED: "extruded",
          palpation.SCENE_KIND_SOLID: "solid"}


@dataclass(frozen=True)
class Info:
    """What runs at the other end. ``limits``: by name, as the service's configuration file has them."""

    build: str
    instance: int  # another one: the service was restarted
    device: str
    limits: Mapping[str, float]
    memory_bytes: Mapping[str, int]  # held now, by place


@dataclass(frozen=True)
class Region:
    """A part of the surface, [begin, end) along x, and along z of a solid; a plane's is infinite there."""

    begin_x_m: float
    end_x_m: float
    begin_z_m: float = -math.inf
    end_z_m: float = math.inf


@dataclass(frozen=True)
class Window:
    """A part of the tissue that was published at once."""

    window_id: int
    version: int
    covers: Region
    touchable: bool
    warnings: tuple[str, ...]      # what makes its modulus doubtful, "NAME: words for people"
    youngs_modulus_log_std: float  # median over what was measured; NaN: not known
    quality: float                 # 0 .. 1; NaN: not known
    plan: str                      # which model answers a usual touch, and why


@dataclass(frozen=True)
class Scene:
    """What a service says of a scene."""

    scene_id: str
    version: int  # 0: nothing was published
    kind: str     # "plane", "extruded", "solid" or, of an older service, ""
    width_m: float
    depth_m: float
    poisson_ratio: float
    thickness_m: float  # of a plane: how wide the finger's contact is across it
    windows: tuple[Window, ...]
    slices_z_m: tuple[float, ...]
    tissue: str = ""  # of an imaged solid: what tissue it was taken to be, and where; else empty


def region_from(message: Any, call: str) -> Region:
    ends = [message.begin_x_m, message.end_x_m]
    if message.HasField("begin_z_m") and message.HasField("end_z_m"):
        ends += [message.begin_z_m, message.end_z_m]
    for begin_m, end_m in zip(ends[::2], ends[1::2]):
        if not (math.isfinite(begin_m) and math.isfinite(end_m) and begin_m <= end_m):
            raise BadAnswer(f"from {begin_m} to {end_m} m", field="covered", call=call)
    return Region(*ends)


def info_from(message: info.GetInfoResponse) -> Info:
    memory: dict[str, int] = {}
    for use in message.memory:
        memory[use.place] = memory.get(use.place, 0) + use.bytes
    return Info(message.build, message.instance, message.device.name,
                {limit.name: limit.value for limit in message.limits}, memory)


def scene_from(message: palpation.Scene, call: str) -> Scene:
    geometry = message.geometry
    if len(geometry.size_m) < 2 or not all(0 < size < math.inf for size in geometry.size_m):
        raise BadAnswer(f"{list(geometry.size_m)} is not a size", field="geometry.size_m", call=call)
    windows = []
    for window in message.windows:
        evidence = window.evidence if window.HasField("evidence") else None
        windows.append(Window(
            window.window_id, window.version, region_from(window.covers, call), window.touchable,
            tuple(evidence.warnings) if evidence else (),
            (evidence.youngs_modulus_log_std if evidence else 0) or math.nan,
            evidence.quality if evidence else math.nan, window.plan))
    return Scene(message.scene_id, message.version, _KINDS.get(message.kind, ""), geometry.size_m[0],
                 geometry.size_m[1], geometry.poisson_ratio, geometry.thickness_m, tuple(windows),
                 tuple(message.slices_z_m), message.tissue)


def modulus_from(message: palpation.Scene, call: str) -> xr.Dataset:
    """The modulus of a full view, NaN where it was not measured, and ``valid``."""
    if not message.HasField("youngs_modulus") or not message.HasField("valid"):
        raise BadAnswer("a full view without a modulus", field="youngs_modulus", call=call)
    valid = arrays.is_valid(arrays.map_from(message.valid, call), call)
    modulus = arrays.masked(arrays.map_from(message.youngs_modulus, call), valid, call)
    return xr.Dataset({"youngs_modulus": modulus, "valid": valid},
                      attrs={"scene_id": message.scene_id, "version": message.version})


def _edges(values: Any, given: Any, axis: str, count: int) -> arrays.Floats:
    """The nodes between ``count`` elements: given, or halfway between evenly spaced centres of a DataArray."""
    field = f"{axis}_m"
    if given is not None:
        nodes = arrays.numbers(given, field, (1,), np.float64)
    elif isinstance(values, xr.DataArray) and axis in values.coords:
        centres = arrays.numbers(values.coords[axis].values, field, (1,), np.float64)
        if count < 2:
            raise InvalidArgument("one element along it, whose size the DataArray does not say", field=field,
                                  remedy="give the nodes, too")
        half = np.diff(centres) / 2
        if not np.allclose(half, half.mean(), rtol=1e-6, atol=0):
            raise InvalidArgument("the DataArray's places are not evenly spaced", field=field,
                                  remedy="give the nodes, too")
        nodes = np.append(centres - half.mean(), centres[-1] + half.mean())
        nodes[np.abs(nodes) < 1e-9] = 0.0
    else:
        raise InvalidArgument("missing", field=field,
                              remedy=f"give the {count + 1} nodes between the {count} elements, in metres")
    if len(nodes) != count + 1:
        raise InvalidArgument(f"{len(nodes)} nodes for {count} elements", field=field,
                              remedy=f"give {count + 1}: the elements' ends")
    return nodes


def _ordered(values: Any) -> Any:
    """A DataArray's dimensions in the contract's order."""
    if not isinstance(values, xr.DataArray):
        return values
    wanted = [axis for axis in ("z", "y", "x") if axis in values.dims]
    if len(wanted) != values.ndim:
        raise InvalidArgument(f"dimensions {values.dims}", field="modulus", remedy="name them y, x or z, y, x")
    return values.transpose(*wanted)


def _warn_of_doubt(modulus: Any) -> None:
    """Where no soft tissue has such a modulus, another unit was meant."""
    median = float(np.median(modulus))
    if 0 < median < 100 or median > 1e6:
        warnings.warn(f"modulus: its median is {median:.4g} Pa, and no soft tissue is that "
                      f"{'soft' if median < 100 else 'stiff'}; give it in Pa (10 kPa is 1e4)", stacklevel=2)


def create_request(scene_id: str, modulus: Any, x_m: Any, y_m: Any, z_m: Any, slices: Mapping[float, Any] | None,
                   size_m: Any, poisson_ratio: float | None, thickness_m: float | None,
                   held: Collection[str] | None, linear: bool = False) -> palpation.CreateSceneRequest:
    """Checked as far as it can be without the service. Raises InvalidArgument."""
    request = palpation.CreateSceneRequest(scene_id=scene_id)
    if modulus is not None and slices is not None:
        raise InvalidArgument("modulus and slices", field="modulus", remedy="give one of them")
    map_ = request.modulus
    if modulus is not None:
        modulus = _ordered(modulus)
        values = arrays.numbers(modulus, "modulus", (2, 3), np.float64)
        map_.x_m.extend(_edges(modulus, x_m, "x", values.shape[-1]))
        map_.y_m.extend(_edges(modulus, y_m, "y", values.shape[-2]))
        if values.ndim == 3:
            map_.z_m.extend(_edges(modulus, z_m, "z", values.shape[0]))
        _warn_of_doubt(values)
        arrays.array_to(values, map_.youngs_modulus_pa)
    elif slices is not None:
        if not slices:
            raise InvalidArgument("none", field="slices", remedy="give at least one, {z_m: modulus}")
        first = _ordered(next(iter(slices.values())))
        shape = arrays.numbers(first, "slices", (2,)).shape
        map_.x_m.extend(_edges(first, x_m, "x", shape[1]))
        map_.y_m.extend(_edges(first, y_m, "y", shape[0]))
        if z_m is None:
            raise InvalidArgument("missing", field="z_m", remedy="give the nodes across the slices, in metres")
        map_.z_m.extend(arrays.numbers(z_m, "z_m", (1,), np.float64))
        for at_m, values in slices.items():
            slice_to(request.slices.add(), values, at_m, None)
    else:
        request.ClearField("modulus")
        if size_m is None:
            raise InvalidArgument("missing", field="size_m", remedy="give (width, depth) in metres, or a modulus")
    if size_m is None:
        size_m = (map_.x_m[-1], map_.y_m[-1])
    request.geometry.size_m.extend(arrays.numbers(size_m, "size_m", (1,), np.float64))
    if poisson_ratio is not None:
        request.geometry.poisson_ratio = poisson_ratio
        request.geometry.has_poisson_ratio = True
    if thickness_m is not None:
        request.geometry.thickness_m = thickness_m
    request.geometry.linear = linear
    if held is not None:
        for face in held:
            if face not in FACES:
                raise InvalidArgument(f"{face!r} is not a face", field="held",
                                      remedy=f"give some of {', '.join(FACES)}")
            setattr(request.geometry.supports, face, True)
        request.geometry.supports.SetInParent()
    return request


def slice_to(message: palpation.ModulusSlice, modulus: Any, z_m: float, log_std: Any) -> None:
    """Fills a slice: its modulus over y, x, and the deviation of ln E where it is known."""
    values = arrays.numbers(_ordered(modulus), "modulus", (2,), np.float64)
    message.pose.origin_m.extend([0.0, 0.0, float(z_m)])
    _warn_of_doubt(values)
    arrays.array_to(values, message.modulus.youngs_modulus_pa)
    if log_std is not None:
        deviation = arrays.numbers(_ordered(log_std), "log_std", (2,), np.float64)
        arrays.array_to(deviation, message.youngs_modulus_log_std)
