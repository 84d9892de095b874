"""Whatever a service sends ends in a clear error, at once, and takes nothing else down."""

import asyncio
import concurrent.futures
import contextlib
import struct
import threading
import time

import grpc
import numpy as np
import pytest
from conftest import short_folder

import teletact
from teletact.v1 import common_pb2 as common
from teletact.v1 import elastography_pb2 as elastography
from teletact.v1 import elastography_pb2_grpc as elastography_grpc
from teletact.v1 import palpation_pb2 as palpation
from teletact.v1 import palpation_pb2_grpc as palpation_grpc


class Liar(palpation_grpc.PalpationServicer, elastography_grpc.ElastographyServicer):
    """Answers what a test tells it to."""

    def __init__(self):
        self.scene = palpation.Scene()
        self.estimate = []
        self.touch = lambda requests, context: iter(())
        self.observe = lambda requests, context: iter(())
        self.over = threading.Event()  # of the newest touch

    def ListScenes(self, request, context):
        return palpation.ListScenesResponse()

    def GetScene(self, request, context):
        return self.scene

    def Estimate(self, requests, context):
        for _ in requests:
            pass
        yield from self.estimate

    def Observe(self, requests, context):
        yield from self.observe(requests, context)

    def Touch(self, requests, context):
        context.add_callback(self.over.set)
        yield from self.touch(requests, context)


@pytest.fixture(scope="module")
def liar():
    with short_folder() as folder:
        server = grpc.server(concurrent.futures.ThreadPoolExecutor(8))
        servant = Liar()
        palpation_grpc.add_PalpationServicer_to_server(servant, server)
        elastography_grpc.add_ElastographyServicer_to_server(servant, server)
        servant.address = f"unix:{folder}/liar"
        server.add_insecure_port(servant.address)
        server.start()
        yield servant
        server.stop(None).wait()


@pytest.fixture
def lied_to(liar):
    liar.over.clear()
    with teletact.connect(liar.address) as service:
        yield service


def a_map(name, values, dtype=common.DATA_TYPE_FLOAT32, unit="Pa"):
    height, width = np.shape(values)
    out = common.Map(name=name, unit=unit)
    out.grid.size.extend([width, height])
    out.grid.origin_m.extend([0.0, 0.0])
    out.grid.spacing_m.extend([0.001, 0.001])
    out.values.dtype = dtype
    out.values.shape.extend([height, width])
    out.values.data = np.asarray(values, "u1" if dtype == common.DATA_TYPE_UINT8 else "<f4").tobytes()
    return out


def good_maps():
    return [a_map("youngs_modulus", np.full((3, 4), 1e4)),
            a_map("valid", np.ones((3, 4)), common.DATA_TYPE_UINT8, "1")]


def spoilt(change):
    maps = good_maps()
    change(maps)
    return maps


MAP_LIES = {
    "too few bytes": lambda m: setattr(m[0].values, "data", b"1234"),
    "a shape of 16 billion": lambda m: m[0].values.shape.__setitem__(0, 4_000_000_000),
    "no shape": lambda m: m[0].values.ClearField("shape"),
    "an unknown type": lambda m: setattr(m[0].values, "dtype", 17),
    "a grid of one axis": lambda m: m[0].grid.size.pop(),
    "a grid of another size": lambda m: m[0].grid.size.__setitem__(0, 3),
    "no spacing": lambda m: m[0].grid.spacing_m.__setitem__(0, 0.0),
    "an origin that is NaN": lambda m: m[0].grid.origin_m.__setitem__(1, float("nan")),
    "a flag of 2": lambda m: setattr(m[1].values, "data", b"\x02" * 12),
    "NaN that is valid": lambda m: setattr(m[0].values, "data", struct.pack("<12f", *[float("nan")] * 12)),
    "infinity that is valid": lambda m: setattr(m[0].values, "data", struct.pack("<12f", *[float("inf")] * 12)),
}


@pytest.mark.parametrize("lie", MAP_LIES)
def test_maps_of_a_scene(lie, liar, lied_to):
    modulus, valid = spoilt(MAP_LIES[lie])
    liar.scene = palpation.Scene(scene_id="s", youngs_modulus=modulus, valid=valid)
    with pytest.raises(teletact.BadAnswer, match="GetScene: DATA_LOSS: map '") as caught:
        lied_to.modulus("s")
    assert caught.value.field and caught.value.remedy


def test_a_scene_without_size_or_with_an_endless_window(liar, lied_to):
    liar.scene = palpation.Scene(scene_id="s")
    with pytest.raises(teletact.BadAnswer, match="size_m"):
        lied_to.scene("s")
    liar.scene.geometry.size_m.extend([0.1, 0.04])
    liar.scene.windows.add().covers.end_x_m = float("nan")
    with pytest.raises(teletact.BadAnswer, match="covered"):
        lied_to.scene("s")


def estimate(service, maps=("youngs_modulus",)):
    frame = np.zeros((64, 8), np.int16)
    return service.estimate(frame, frame, center_frequency_hz=5e6, sampling_frequency_hz=4e7, line_pitch_m=3e-4,
                            frame="probe", maps=maps)


def answers_of(maps, summaries=1):
    return ([elastography.EstimateResponse(map=elastography.MapResult(map=map_)) for map_ in maps] +
            [elastography.EstimateResponse(summary=elastography.EstimateSummary())] * summaries)


@pytest.mark.parametrize("lie", MAP_LIES)
def test_maps_of_an_estimate(lie, liar, lied_to):
    liar.estimate = answers_of(spoilt(MAP_LIES[lie]))
    with pytest.raises(teletact.BadAnswer, match="Estimate: DATA_LOSS: map '"):
        estimate(lied_to)


def test_an_estimate_of_too_much_and_too_little(liar, lied_to):
    liar.estimate = answers_of(good_maps())
    assert estimate(lied_to).youngs_modulus.values.max() == 1e4
    for answers, wrong in ((answers_of(good_maps(), 0), "summary"), (answers_of(good_maps(), 2), "summary"),
                           (answers_of(good_maps()[:1]), "valid"), (answers_of(good_maps()[1:]), "youngs_modulus"),
                           (answers_of(good_maps() * 2), "youngs_modulus"),
                           (answers_of(good_maps() + [a_map("b_mode", np.ones((3, 4)))]), "b_mode"),
                           (answers_of([*good_maps()[:1], a_map("valid", np.ones((2, 2)), common.DATA_TYPE_UINT8)]),
                            "valid"), ([], "summary")):
        liar.estimate = answers
        with pytest.raises(teletact.BadAnswer, match=wrong):
            estimate(lied_to)


def test_a_b_mode_image_lies_on_a_grid_of_its_own(liar, lied_to):
    grey = np.arange(30).reshape(5, 6)
    liar.estimate = answers_of([a_map("b_mode", grey, common.DATA_TYPE_UINT8, "1"), *good_maps()])
    maps = estimate(lied_to, None)
    assert maps.b_mode.dims == ("y_b_mode", "x_b_mode") and maps.b_mode.dtype == np.uint8
    assert (maps.b_mode.values == grey).all()
    assert maps.youngs_modulus.dims == ("y", "x") and maps.youngs_modulus.shape == (3, 4)


def opened(**changes):
    out = palpation.TouchOpened(period_s=0.002, credit=2, instance=5)
    out.covered.end_x_m = 0.1
    for name, value in changes.items():
        setattr(out, name, value)
    return palpation.TouchResponse(opened=out)


def answer_to(request, number, **changes):
    out = palpation.TouchAnswer(answer=number, sequence=request.pose.sequence, status=palpation.TOUCH_STATUS_OK,
                                position_m=request.pose.position_m, force_n=[0.0, -0.1, 0.0], tangent_n_m=[0.0] * 9)
    out.covered.end_x_m = 0.1
    for name, value in changes.items():
        if isinstance(value, list):
            del getattr(out, name)[:]
            getattr(out, name).extend(value)
        else:
            setattr(out, name, value)
    return palpation.TouchResponse(answer=out)


def lying(*makers):
    """A touch that is opened well; then each pose is answered by the next of these, the last one again and again."""
    def touch(requests, context):
        next(requests)
        yield opened()
        for number, request in enumerate(requests, 1):
            yield from makers[min(number, len(makers)) - 1](request, number)

    return touch


def well(request, number):
    yield answer_to(request, number)


def changed(**changes):
    return lambda request, number: iter([answer_to(request, number, **changes)])


TOUCH_LIES = {
    "a force that is NaN": changed(force_n=[0.0, float("nan"), 0.0]),
    "a force of one component": changed(force_n=[1.0]),
    "a tangent of eight": changed(tangent_n_m=[0.0] * 8),
    "a tangent that is infinite": changed(tangent_n_m=[float("inf")] * 9),
    "an energy that is NaN": changed(energy_j=float("nan")),
    "another place": changed(position_m=[0.01, 0.002, 0.0]),
    "no place": changed(position_m=[]),
    "an unknown status": changed(status=77),
    "a pose that was never sent": changed(sequence=10**6),
    "an answer that skips": changed(answer=9),
    "more than the credit": lambda request, number: (answer_to(request, number + k) for k in range(50)),
    "a law that nobody asked for": lambda *_: iter([palpation.TouchResponse(law=palpation.LawPiece(piece=1))]),
    "opened again": lambda *_: iter([opened()]),
}


@pytest.mark.parametrize("lie", TOUCH_LIES)
def test_touches(lie, liar, lied_to):
    liar.touch = lying(well, well, TOUCH_LIES[lie])
    with lied_to.touch("s") as touch:
        touch.at([0.05, 0.002])
        with pytest.raises(teletact.BadAnswer, match="Touch: DATA_LOSS: "):
            for k in range(5):
                touch.at([0.05, 0.002 + 1e-4 * k], timeout_s=20)
        with pytest.raises(teletact.BadAnswer):
            touch.next()
        assert touch.streams == 1, "a liar is not tried again"
    assert liar.over.wait(20), "the stream is left open"


@pytest.mark.parametrize("changes", [{"credit": 0}, {"credit": 1000}, {"period_s": 0.0}, {"period_s": float("nan")},
                                     {"period_s": 1e9}])
def test_how_a_touch_is_opened(changes, liar, lied_to):
    liar.touch = lambda requests, context: iter([opened(**changes)])
    with pytest.raises(teletact.BadAnswer, match=f"opened.{next(iter(changes))}"):
        lied_to.touch("s")
    assert liar.over.wait(20)


def test_an_answer_before_the_stream_is_open(liar, lied_to):
    liar.touch = lambda requests, context: iter([palpation.TouchResponse(answer=palpation.TouchAnswer())])
    with pytest.raises(teletact.BadAnswer, match="answer: before"):
        lied_to.touch("s")


def test_a_malformed_law(liar, lied_to):
    liar.touch = lying(lambda *_: iter([palpation.TouchResponse(law=palpation.LawPiece(piece=1))]))
    with lied_to.touch("s", laws=True) as touch, pytest.raises(teletact.BadAnswer, match="law.columns"):
        touch.at([0.05, 0.002], timeout_s=20)


def test_a_service_that_says_nothing_is_given_up_and_tried_again(liar, lied_to):
    quiet = threading.Event()

    def touch(requests, context):
        next(requests)
        yield opened()
        for number, request in enumerate(requests, 1):
            if not quiet.is_set() and number > 2:
                quiet.set()
                context.add_callback(still.set)
                still.wait(60)
                return
            yield answer_to(request, number)

    still = threading.Event()
    liar.touch = touch
    with lied_to.touch("s", dead_s=0.5) as touch:
        for k in range(20):
            assert touch.at([0.05, 0.002 + 1e-5 * k]).force_n[1] == -0.1
        assert touch.streams == 2


def test_who_opens_and_sends_no_pose_yet_keeps_the_stream(liar, lied_to):
    def touch(requests, context):
        next(requests)
        yield opened()
        for number, request in enumerate(requests, 1):
            yield answer_to(request, number)

    liar.touch = touch
    with lied_to.touch("s", dead_s=0.3) as touch:
        time.sleep(1)
        assert touch.at([0.05, 0.002]).force_n[1] == -0.1
        assert touch.streams == 1


def handed_over(to):
    """A touch that answers nothing, and keeps to whom it was handed over."""
    def touch(requests, context):
        next(requests)
        yield opened()
        to.extend(request.hand_over.session_id for request in requests)

    return touch


def test_a_hand_over_arrives_without_a_pose_and_who_leaves_at_once_does_not_lose_it(liar, lied_to):
    names = [f"hand {k}" for k in range(100)]
    to = []
    liar.touch = handed_over(to)
    for name in names:
        liar.over.clear()
        with lied_to.touch("s") as touch:
            touch.hand_over(name)
        assert liar.over.wait(20)
    assert to == names


def test_hand_overs_by_asyncio_are_written_one_after_the_other(liar, lied_to):
    to = []
    liar.touch = handed_over(to)

    async def work():
        async with await teletact.aio.connect(liar.address) as service, service.touch("s") as touch:
            await asyncio.gather(*(touch.hand_over(name) for name in "abc"))
            cancelled = asyncio.create_task(touch.hand_over("d"))
            await asyncio.sleep(0)
            cancelled.cancel()
            await asyncio.gather(cancelled, return_exceptions=True)
            with pytest.raises(TypeError):
                await touch.hand_over(5)
            await touch.hand_over("e")

    asyncio.run(work())
    assert liar.over.wait(20) and [name for name in to if name != "d"] == ["a", "b", "c", "e"]


def test_a_hand_over_waits_for_the_stream_and_says_when_there_is_none(liar, lied_to):
    to, called, may_open, read = [], threading.Event(), threading.Event(), threading.Event()

    def again(requests, context):
        next(requests)
        called.set()
        may_open.wait(20)
        yield opened()
        for request in requests:
            to.append(request.hand_over.session_id)
            read.set()

    def once(requests, context):
        liar.touch = again
        next(requests)
        yield opened()

    liar.touch = once
    with concurrent.futures.ThreadPoolExecutor(1) as beside, lied_to.touch("s") as touch:
        assert called.wait(20)
        written = beside.submit(touch.hand_over, "b")
        with pytest.raises(concurrent.futures.TimeoutError):
            written.result(0.3)
        may_open.set()
        assert written.result(20) is None and touch.streams == 2
    assert read.wait(20) and to == ["b"]
    with pytest.raises(teletact.Cancelled, match="closed"):
        touch.hand_over("b")

    called.clear()
    may_open.clear()
    liar.touch = once
    with concurrent.futures.ThreadPoolExecutor(1) as beside, lied_to.touch("s") as touch:
        assert called.wait(20)
        written = beside.submit(touch.hand_over, "b")
        with pytest.raises(concurrent.futures.TimeoutError):
            written.result(0.3)
        touch.close()
        may_open.set()
        with pytest.raises(teletact.Cancelled, match="closed"):
            written.result(20)


def test_what_a_peer_says_is_one_plain_line(liar, lied_to):
    def touch(requests, context):
        context.abort(grpc.StatusCode.INVALID_ARGUMENT, "open.layer.depth_m: \x1b[31m1\n2; give " + "x" * 5000)
        yield

    liar.touch = touch
    with pytest.raises(teletact.InvalidArgument) as caught:
        lied_to.touch("s")
    assert caught.value.field == "open.layer.depth_m" and caught.value.remedy.startswith("give x")
    assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value) and len(str(caught.value)) < 1200


@contextlib.contextmanager
def nobody():
    with short_folder() as folder:
        yield f"unix:{folder}/nobody"


def test_a_name_that_does_not_resolve_is_said():
    with pytest.raises(teletact.Unavailable, match="the name nosuchhost.invalid does not resolve"):
        teletact.connect("nosuchhost.invalid:50972")


def test_nobody_answers():
    with nobody() as address, pytest.raises(teletact.Unavailable, match="no service at .*teletact serve --listen"):
        teletact.connect(address)
