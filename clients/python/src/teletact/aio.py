"""A teletact service from asyncio. ``teletact`` has the same names for programs without it.

    service = await teletact.aio.connect("127.0.0.1:50051")
    async with service:
        maps = await service.estimate(pre, post, ...)
        async with service.touch("liver") as touch:
            answer = await touch.at([0.05, 0.002])
"""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any, Awaitable, Callable, Collection, Mapping, TypeVar

import grpc
import grpc.aio
import xarray as xr

from teletact import arrays, estimates, scenes
from teletact.answers import PATHS, Answer, Opened, TactileImage
from teletact.channel import ElastographyStub, InfoStub, PalpationStub, Peer, forked, peer_of
from teletact.errors import InvalidArgument, Unavailable, from_rpc
from teletact.observing import MAPS, Observation, Observing, Surface
from teletact.scenes import Info, Region, Scene, Window
from teletact.touching import Touch
from teletact.v1 import info_pb2 as info
from teletact.v1 import palpation_pb2 as palpation

__all__ = ["connect", "Service", "Touch", "Answer", "Opened", "TactileImage", "Observing", "Observation", "Surface",
           "Info", "Region", "Scene", "Window"]

_T = TypeVar("_T")
_UNARY_S = 60.0
_CONNECT_S = 3.0  # for a connection
_TIPS = {"rounded": palpation.FINGERTIP_SHAPE_ROUNDED_TIP, "punch": palpation.FINGERTIP_SHAPE_FLAT_PUNCH,
         "node": palpation.FINGERTIP_SHAPE_NODE, "pad": palpation.FINGERTIP_SHAPE_PAD,
         "sphere": palpation.FINGERTIP_SHAPE_SPHERE}


async def connect(address: str, *, tls_ca: str | Path | None = None, tls_certificate: str | Path | None = None,
                  tls_key: str | Path | None = None, token: str | None = None, token_file: str | Path | None = None,
                  name: str | None = None, wait_s: float = 60.0, proxy: bool = False) -> Service:
    """A service that answers.

    ``address``: HOST:PORT or unix:/path. ``tls_ca``, ``tls_certificate``, ``tls_key``: PEM files. ``token`` or
    ``token_file``: by which the service knows who calls. ``name``: this client's, for fair shares. ``wait_s``: how
    long to wait for one that is still starting; one that nobody runs is not waited for. ``proxy``: by the proxy that
    the environment names (grpc_proxy, https_proxy, http_proxy); else past it.

    Raises InvalidArgument, Unavailable, NotPermitted.
    """
    service = Service(peer_of(address, tls_ca, tls_certificate, tls_key, token, token_file, name, proxy))
    try:
        await service._reach(wait_s)
    except BaseException:
        await service.close()
        raise
    return service


class Service:
    """A connection to a service; made by ``connect``. All lengths are metres, forces N, moduli Pa.

    Every method raises a TeletactError, whose ``field`` and ``remedy`` are the service's. ``retry_s``: for so long a
    call that may be repeated is, while the service is UNAVAILABLE.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._channel = peer.channel()
        self.retry_s = 10.0

    async def __aenter__(self) -> Service:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Ends the connection and what runs over it, but for touches. A forked child leaves it to its parent."""
        if not forked():
            await self._channel.close(grace=None)

    async def _reach(self, wait_s: float) -> None:
        end = time.monotonic() + wait_s
        try:
            async with asyncio.timeout(_CONNECT_S):
                await self._channel.channel_ready()
        except TimeoutError:
            tls = "" if self._peer.tls_ca is None else ", or TLS with it failed"
            raise Unavailable(f"no service at {self._peer.address}{tls}", call="connect",
                              remedy=self._peer.remedy()) from None
        while True:
            try:
                await self._once("connect", self._palpation().ListScenes, palpation.ListScenesRequest())
                return
            except Unavailable:
                if time.monotonic() > end:
                    raise
            await asyncio.sleep(0.1)

    def _palpation(self) -> Any:
        return PalpationStub(self._channel)

    async def _once(self, call: str, method: Any, request: Any, scene_id: str = "") -> Any:
        try:
            return await method(request, metadata=self._peer.metadata(scene_id), timeout=_UNARY_S)
        except grpc.RpcError as error:
            raise self._of(from_rpc(error, call)) from None

    def _of(self, error: Any) -> Any:
        """The same; of a peer that cannot be reached, with what helps."""
        if isinstance(error, Unavailable) and error.problem.startswith("failed to connect"):
            error.remedy = self._peer.remedy()
        return error

    async def _repeated(self, attempt: Callable[[], Awaitable[_T]]) -> _T:
        end = time.monotonic() + self.retry_s
        wait_s = 0.05
        while True:
            try:
                return await attempt()
            except Unavailable:
                if time.monotonic() > end:
                    raise
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, 0.5)

    # --- scenes -----------------------------------------------------------------------------------------------

    async def info(self) -> Info:
        """What runs at the other end, and its limits."""
        method = InfoStub(self._channel).GetInfo
        return scenes.info_from(await self._repeated(lambda: self._once("GetInfo", method, info.GetInfoRequest())))

    async def scenes(self) -> list[Scene]:
        """All that this client may see."""
        request = palpation.ListScenesRequest()
        answer = await self._repeated(lambda: self._once("ListScenes", self._palpation().ListScenes, request))
        return [scenes.scene_from(scene, "ListScenes") for scene in answer.scenes]

    async def scene(self, scene_id: str) -> Scene:
        """Raises NotFound."""
        return scenes.scene_from(await self._get(scene_id, palpation.SCENE_VIEW_BASIC), "GetScene")

    async def modulus(self, scene_id: str) -> xr.Dataset:
        """Young's modulus over y, x in the scene, ``youngs_modulus`` (Pa; NaN: not measured) and ``valid``.

        Of a solid it is the slice nearest to the middle."""
        return scenes.modulus_from(await self._get(scene_id, palpation.SCENE_VIEW_FULL), "GetScene")

    async def _get(self, scene_id: str, view: Any) -> palpation.Scene:
        request = palpation.GetSceneRequest(scene_id=scene_id, view=view)
        scene: palpation.Scene = await self._repeated(
            lambda: self._once("GetScene", self._palpation().GetScene, request, scene_id))
        return scene

    async def create_scene(self, scene_id: str = "", modulus: Any = None, *, x_m: Any = None, y_m: Any = None,
                           z_m: Any = None, slices: Mapping[float, Any] | None = None, size_m: Any = None,
                           poisson_ratio: float | None = None, thickness_m: float | None = None,
                           held: Collection[str] | None = None, linear: bool = False) -> Scene:
        """A scene to touch, or an empty one of ``size_m`` (width, depth) into which estimates are published.

        ``modulus``: Pa of each element, shape (y, x) of a plane or (z, y, x) of a solid. ``x_m``, ``y_m``, ``z_m``:
        the nodes between them, one more than elements; those of an evenly spaced DataArray are halfway between its
        places. ``slices``: instead, {z: modulus (y, x)} of a solid that may grow, with ``z_m``. ``scene_id``: "" has
        the service choose. ``held``: faces that are held still, of "surface", "bottom", "x_min", "x_max" (the bottom).
        ``linear``: it does not stiffen with strain, as a phantom; else forces may be larger by ``Answer.above``.
        """
        request = scenes.create_request(scene_id, modulus, x_m, y_m, z_m, slices, size_m, poisson_ratio, thickness_m,
                                        held, linear)
        answer = await self._once("CreateScene", self._palpation().CreateScene, request, scene_id)
        return scenes.scene_from(answer, "CreateScene")

    async def publish_slice(self, scene_id: str, modulus: Any, z_m: float, log_std: Any = None) -> list[str]:
        """One more slice of a solid, or another in its place; returns what makes it doubtful.

        ``modulus``: (y, x) on the solid's own elements, Pa. ``log_std``: of ln E, the same shape; None: exact."""
        request = palpation.PublishSliceRequest(scene_id=scene_id)
        scenes.slice_to(request.slice, modulus, z_m, log_std)
        answer = await self._repeated(
            lambda: self._once("PublishSlice", self._palpation().PublishSlice, request, scene_id))
        return list(answer.warnings)

    async def delete_scene(self, scene_id: str) -> None:
        """Touches of it end, too. Raises NotFound."""
        request = palpation.DeleteSceneRequest(scene_id=scene_id)
        await self._once("DeleteScene", self._palpation().DeleteScene, request, scene_id)

    # --- estimates --------------------------------------------------------------------------------------------

    async def estimate(self, pre: Any, post: Any, *, center_frequency_hz: float, sampling_frequency_hz: float,
                       line_pitch_m: float, frame: str, sound_speed_m_s: float = 1540.0,
                       first_sample_depth_m: float = 0.0, force_n: float | None = None,
                       contact_area_m2: float | None = None, force_std_n: float | None = None,
                       contact_area_std_m2: float | None = None, force_zero_n: float | None = None,
                       force_zero_std_n: float | None = None, force_gain: float | None = None,
                       force_gain_std: float | None = None, plane: str | None = None, method: str | None = None,
                       poisson_ratio: float | None = None, max_strain: float | None = None,
                       tissue_width_m: float | None = None, tissue_depth_m: float | None = None,
                       probe_elevation_m: float | None = None, modulus_time_limit_s: float | None = None,
                       finish_within_s: float | None = None, poisson_ratio_std: float | None = None,
                       sound_speed_std_m_s: float | None = None, tissue_depth_std_m: float | None = None,
                       tissue_width_std_m: float | None = None, probe_elevation_std_m: float | None = None,
                       preload_m: float | None = None, preload_std_m: float | None = None,
                       surface: str | None = None, capsule_thickness_m: float | None = None,
                       capsule_ratio: float | None = None, capsule_thickness_std_m: float | None = None,
                       capsule_ratio_std: float | None = None, pad_thickness_m: float | None = None,
                       pad_youngs_modulus_pa: float | None = None, pad_thickness_std_m: float | None = None,
                       pad_youngs_modulus_std_pa: float | None = None,
                       publish: str | None = None, window_x_m: float | None = None,
                       maps: Collection[str] | None = None,
                       timeout_s: float = 120.0) -> xr.Dataset:
        """Displacement, strain and Young's modulus from two RF frames.

        ``pre``, ``post``: before and after a compression, shape (samples, lines), int16 or float; float64 is sent as
        float32. ``frame``: "probe" where the probe's face rests, "lab" where the far side does. With ``force_n``, the
        change of the probe's force, and ``contact_area_m2``, or with a pad on a solid, the modulus is in Pa, else
        relative; each ``_std`` is the standard deviation of what it is named after. ``plane``: "solid", "strain" or
        "stress"; left out, "strain" of what is published and "solid" of what is not. ``surface``: of a solid, "unknown", "bare", "capsule" or
        "uneven". ``publish`` and ``window_x_m``: into which scene, and where the window's left border lies there.
        ``maps``: names (all).

        Returns maps over y, x of the window: NaN where not ``valid`` (but for ``correlation``, and
        ``b_mode`` over a ``y_b_mode`` and ``x_b_mode`` of its own), and in ``attrs`` the
        ``warnings`` and the rest of the summary. What the options mean: docs/guide/recorded-data.md.
        """
        before, after = estimates.rf_frame(pre, "pre"), estimates.rf_frame(post, "post")
        numbers = {"center_frequency_hz": center_frequency_hz, "sampling_frequency_hz": sampling_frequency_hz,
                   "sound_speed_m_s": sound_speed_m_s, "line_pitch_m": line_pitch_m,
                   "first_sample_depth_m": first_sample_depth_m, "poisson_ratio": poisson_ratio,
                   "max_strain": max_strain, "tissue_width_m": tissue_width_m, "tissue_depth_m": tissue_depth_m,
                   "probe_elevation_m": probe_elevation_m, "modulus_time_limit_s": modulus_time_limit_s,
                   "finish_within_s": finish_within_s, "poisson_ratio_std": poisson_ratio_std,
                   "sound_speed_std_m_s": sound_speed_std_m_s, "tissue_depth_std_m": tissue_depth_std_m,
                   "tissue_width_std_m": tissue_width_std_m, "probe_elevation_std_m": probe_elevation_std_m,
                   "preload_m": preload_m, "preload_std_m": preload_std_m,
                   "capsule_thickness_m": capsule_thickness_m, "capsule_ratio": capsule_ratio,
                   "capsule_thickness_std_m": capsule_thickness_std_m, "capsule_ratio_std": capsule_ratio_std,
                   "pad_thickness_m": pad_thickness_m, "pad_youngs_modulus_pa": pad_youngs_modulus_pa,
                   "pad_thickness_std_m": pad_thickness_std_m,
                   "pad_youngs_modulus_std_pa": pad_youngs_modulus_std_pa}
        sensor = {"force_std_n": force_std_n, "contact_area_std_m2": contact_area_std_m2,
                  "force_zero_n": force_zero_n, "force_zero_std_n": force_zero_std_n, "force_gain": force_gain,
                  "force_gain_std": force_gain_std}
        acquisition = estimates.acquisition_of(
            before, after, frame=frame, plane=plane, method=method, force_n=force_n, contact_area_m2=contact_area_m2,
            sensor=sensor, surface=surface, publish=publish, window_x_m=window_x_m, maps=maps, numbers=numbers)
        return await self._repeated(lambda: self._estimate(acquisition, before, after, publish or "", timeout_s))

    async def _estimate(self, acquisition: Any, before: Any, after: Any, scene_id: str, timeout_s: float) -> xr.Dataset:
        answers = estimates.Answers(acquisition, "Estimate")
        requests = estimates.requests_of(acquisition, before, after)
        call = ElastographyStub(self._channel).Estimate(
            requests, metadata=self._peer.metadata(scene_id), timeout=timeout_s)
        try:
            async for response in call:
                answers.take(response)
        except grpc.RpcError as error:
            raise self._of(estimates.with_cause(from_rpc(error, "Estimate"), before)) from None
        finally:
            call.cancel()  # where it has not ended
        return answers.dataset()

    # --- touch ------------------------------------------------------------------------------------------------

    def touch(self, scene_id: str, *, tip: str = "rounded", tip_radius_m: float = 0.0, half_width_m: float = 0.0,
              stuck: bool = False, layer_depth_m: float = 0.0, path: str | None = None, period_s: float = 0.001,
              credit: int = 2, laws: bool = False, tactile: bool = False, pressure: bool = False,
              tolerance: float | None = None, tolerance_n: float = 0.0, session_id: str = "",
              resume_s: float = 30.0, dead_s: float = 3.0) -> Touch:
        """Touches a scene: ``async with service.touch("liver") as touch``.

        ``tip``: "rounded", "sphere", "punch", "pad" or "node". ``layer_depth_m``: 0 is the surface. ``laws``: have
        the contact law sent, too (``Touch.law``). ``period_s``: between answers, at least. ``credit``: most answers on
        their way; a rate over a link takes rate x round trip. ``tolerance``: the share that a model may put a force
        off by. ``path``: a model by its name. ``session_id``: "" chooses one; it stays over interruptions, which are
        waited out for ``resume_s``; a stream that says nothing to a pose for ``dead_s`` is one.
        """
        request = palpation.TouchOpen(scene_id=scene_id, credit=credit, period_s=period_s, session_id=session_id,
                                      laws=laws, pressure=pressure)
        if tip not in _TIPS:
            raise InvalidArgument(f"{tip!r}", field="tip", remedy=f"give one of {', '.join(_TIPS)}")
        request.fingertip.shape = _TIPS[tip]
        request.fingertip.stuck = stuck
        request.fingertip.radius_m, request.fingertip.half_width_m = tip_radius_m, half_width_m
        if layer_depth_m != 0:
            request.layer.depth_m = layer_depth_m
        if path is not None:
            if path not in PATHS:
                raise InvalidArgument(f"{path!r}", field="path", remedy=f"give one of {', '.join(PATHS)}")
            request.path = PATHS[path]
        if tactile:
            request.tactile.SetInParent()
        if tolerance is not None:
            request.tolerance.relative, request.tolerance.force_n = tolerance, tolerance_n
        return Touch(self._peer, request, resume_s, dead_s)

    # --- looking on -------------------------------------------------------------------------------------------

    def observe(self, scene_id: str, *, windows: bool = False, maps: Collection[str] = (), answers: bool = False,
                surface: bool = False, session_id: str = "", max_rate_hz: float = 0.0,
                resume_s: float = 30.0) -> Observing:
        """Looks on at a scene: ``async with service.observe("liver", maps=["youngs_modulus"]) as seen`` and then
        ``async for state in seen``. Nobody's touch is slowed by it.

        ``windows``: the scene whenever it changed. ``maps``: of youngs_modulus, youngs_modulus_log_std, valid and
        b_mode. ``answers``: of the touch that steers, or of ``session_id``. ``surface``: how the layer gives way.
        ``max_rate_hz``: of states; 0: as many as the service gives. ``resume_s``: how long an interruption is waited
        out.
        """
        for name in maps:
            if name not in MAPS:
                raise InvalidArgument(f"{name!r}", field="maps", remedy=f"give some of {', '.join(MAPS)}")
        return Observing(self._peer, palpation.ObserveOpen(
            scene_id=scene_id, windows=windows, maps=maps, answers=answers, surface=surface, session_id=session_id,
            max_rate_hz=max_rate_hz), resume_s)
