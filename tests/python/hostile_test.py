"""Whatever a service sends ends in a clear error, at once, and takes nothing else down."""

import asyncio
import contextlib
import struct
import threading
import time

import grpc
import numpy as np
import pytest
from conftest import short_folder
from lying_service import a_map, answer_to, lying, opened

import teletact
from teletact.channel import Peer
from teletact.stream import Board, Pose, Stream
from teletact.v1 import common_pb2 as common
from teletact.v1 import elastography_pb2 as elastography
from teletact.v1 import palpation_pb2 as palpation


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
    liar.touch = lying(well)
    with lied_to.touch("s", dead_s=0.25) as touch:
        time.sleep(0.3)
        assert touch.at([0.05, 0.002]).force_n[1] == -0.1
        assert touch.streams == 1


def test_who_touches_waits_until_the_model_is_made(liar, lied_to):
    def touch(requests, context):
        next(requests)
        yield opened()
        pose = next(requests)
        yield answer_to(pose, 1, status=palpation.TOUCH_STATUS_PREPARING, force_n=[], tangent_n_m=[])
        yield answer_to(pose, 2)
        for _ in requests:
            pass

    liar.touch = touch
    with lied_to.touch("s") as touch:
        assert touch.at([0.05, 0.002], timeout_s=20).status == "ok"


@pytest.mark.parametrize("given, asked", [({}, None), ({"tolerance": 0}, (0.0, 0.0)),
                                          ({"tolerance": 0.1, "tolerance_n": 0.02}, (0.1, 0.02))])
def test_the_tolerance_is_asked_for_as_given(given, asked, liar, lied_to):
    requested = []

    def touch(requests, context):
        requested.append(next(requests).open)
        yield opened()
        for _ in requests:
            pass

    liar.touch = touch
    lied_to.touch("s", **given).close()
    tolerance = requested[0].tolerance if requested[0].HasField("tolerance") else None
    assert asked == (tolerance and (tolerance.relative, tolerance.force_n))


@pytest.mark.parametrize("sent, due", [(0, True), (1, True), (2, False)])
def test_no_pose_is_due_beyond_the_credit(sent, due):
    stream = Stream(Peer("unix:/nobody"), palpation.TouchOpen(), Board(), dead_s=3.0)

    async def opened_and_sent():
        await stream._take_opened(opened(credit=2).opened)
        stream._board.pose = Pose(np.zeros(3), np.zeros(3))
        stream._board.sequence += sent

    asyncio.run(opened_and_sent())
    assert (stream._wait_s(sent=None, next_s=100.0, now=100.01) == 0) == due


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


def test_a_name_that_does_not_resolve_is_said(impatient):
    with pytest.raises(teletact.Unavailable, match="the name nosuchhost.invalid does not resolve"):
        teletact.connect("nosuchhost.invalid:50972")


@pytest.mark.parametrize("host", ["dns", "ipv4", "ipv6", "xds"])
def test_a_host_with_the_name_of_a_scheme_is_a_host(host, impatient):
    with pytest.raises(teletact.Unavailable, match=f"the name {host} does not resolve"):
        teletact.connect(f"{host}:50972")


def test_a_certificate_must_be_valid_by_this_clock():
    for certificate in (None, b"certificate"):
        peer = Peer("127.0.0.1:1", tls_ca=b"certificate", tls_certificate=certificate)
        assert "valid by this machine's clock" in peer.remedy()


def test_nobody_answers(impatient):
    with nobody() as address, pytest.raises(teletact.Unavailable, match="no service at .*teletact serve --listen"):
        teletact.connect(address)
