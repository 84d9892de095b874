"""Looking on: what a real service shows of a scene that others touch and image, and what is made of lies."""

import asyncio
import pathlib
import threading
import time

import conftest
import numpy as np
import pytest
from conftest import Process, short_folder
from lying_service import a_map

import teletact
from teletact.v1 import common_pb2 as common
from teletact.v1 import palpation_pb2 as palpation

MAPS = ["youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"]


def until(seen, true, within_s=120):
    """The first state that is so."""
    end = time.monotonic() + within_s
    for state in seen:
        assert time.monotonic() < end, f"no such state; the last one was {state}"
        if true(state):
            return state


def test_what_a_touch_feels_and_how_the_layer_gives_way(service, lump):
    with service.observe(lump, windows=True, maps=["youngs_modulus", "valid"], answers=True, surface=True) as seen:
        first = until(seen, lambda state: state.scene is not None)
        assert first.scene.scene_id == lump and first.scene_version == first.scene.version
        until(seen, lambda state: set(seen.maps) == {"youngs_modulus", "valid"})
        whole = service.modulus(lump)
        np.testing.assert_allclose(seen.maps["youngs_modulus"], whole.youngs_modulus, rtol=1e-6)
        np.testing.assert_allclose(seen.maps["youngs_modulus"].x, whole.x, atol=1e-9)
        assert seen.maps["valid"].dtype == bool and seen.maps["valid"].all()
        with service.touch(lump, session_id="hand") as touch:
            felt = touch.at([0.05, 0.002])
            state = until(seen, lambda state: state.answer is not None and state.answer.position_m[0] == 0.05)
            assert state.steered_by == "hand" and state.answer.status == "ok"
            np.testing.assert_allclose(state.answer.force_n, felt.force_n, rtol=1e-9)
            surface = until(seen, lambda state: state.surface is not None and state.surface.displacement_m.size).surface
            assert surface.displacement_m.dims == ("z", "x")
            assert float(surface.displacement_m.max()) == pytest.approx(0.002, rel=0.05)
        until(seen, lambda state: state.steered_by == "")


def test_windows_are_drawn_as_they_are_published(service, patient):
    folder, truth = patient
    probe = {name: truth[name] for name in ("center_frequency_hz", "sampling_frequency_hz", "sound_speed_m_s",
                                            "line_pitch_m", "first_sample_depth_m")}
    service.create_scene("imaged", size_m=(truth["width_m"], truth["depth_m"]))
    try:
        with service.observe("imaged", maps=MAPS) as seen:
            assert not seen.next().changed
            for k, window in enumerate(truth["windows"]):
                pair = [teletact.read_metaimage(folder / window[name]) for name in ("pre", "post")]
                service.estimate(*pair, frame="probe", method="direct", force_n=window["force_n"], publish="imaged",
                                 contact_area_m2=window["contact_area_m2"], window_x_m=window["window_x_m"],
                                 maps=["valid"], **probe)
                until(seen, lambda state: len(seen.b_mode) == k + 1)
            whole = service.modulus("imaged")
            until(seen, lambda state: set(seen.maps) == set(MAPS) - {"b_mode"} and
                  seen.maps["valid"].sum() == whole.valid.sum())
            drawn = seen.maps["youngs_modulus"].where(seen.maps["valid"])
            there = whole.youngs_modulus.sel(x=drawn.x, y=drawn.y, method="nearest")
            np.testing.assert_allclose(there.x, drawn.x, atol=1e-6)
            np.testing.assert_allclose(drawn, there, rtol=1e-6)
            assert float(seen.maps["youngs_modulus_log_std"].median()) > 0
            first, second = (image for _, image in sorted(seen.b_mode.items()))
            assert first.dtype == np.uint8 and first.max() == second.max() == 255
            assert float(second.x[0] - first.x[0]) == pytest.approx(0.06, abs=1e-3)
    finally:
        service.delete_scene("imaged")


def test_who_asks_rarely_gets_the_newest_and_goes_on_where_the_stream_has_ended():
    with short_folder() as folder:
        config = pathlib.Path(folder) / "config.toml"
        config.write_text("[limits]\nacknowledge_s = 0.3\n")
        process = Process(folder, "--config", str(config))
        try:
            with teletact.connect(process.address) as service:
                service.create_scene("s", np.full((20, 40), 1e4), x_m=np.linspace(0, 0.08, 41),
                                     y_m=np.linspace(0, 0.04, 21))
                with service.observe("s", maps=["valid"]) as seen, service.touch("s") as touch:
                    until(seen, lambda state: "valid" in seen.maps)
                    conftest.until(lambda: "event=observe_closed" in process.log())  # nothing was acknowledged
                    assert touch.at([0.04, 0.001]).status == "ok"
                    until(seen, lambda state: "valid" in seen.maps)
                    assert seen.streams == 2
        finally:
            process.stop()


def test_refused_and_over(service, lump):
    with pytest.raises(teletact.InvalidArgument, match="maps"):
        service.observe(lump, maps=["taste"])
    with service.observe(lump, max_rate_hz=1000.0) as seen:
        with pytest.raises(teletact.InvalidArgument) as caught:
            seen.next()
        assert caught.value.field == "open.max_rate_hz" and caught.value.remedy
    with service.observe("nowhere") as seen, pytest.raises(teletact.NotFound):
        seen.next()
    service.create_scene("gone", size_m=(0.1, 0.04))
    with service.observe("gone") as seen:
        seen.next()
        service.delete_scene("gone")
        with pytest.raises(teletact.Aborted):
            until(seen, lambda state: False)
    with pytest.raises(teletact.Cancelled):
        seen.next()


def test_a_task_that_is_cancelled_leaves_no_stream(process, lump):
    async def work():
        async with await teletact.aio.connect(process.address) as service:
            async with service.observe(lump, max_rate_hz=0.1) as seen:
                await seen.next()
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.2):
                        await seen.next()
                assert (await seen.next()).state == 1 and seen.streams == 2, "a stream of its own"

    asyncio.run(work())


def test_it_outlives_its_service(kept):
    process, service = kept
    with service.observe("kept", maps=["youngs_modulus"], resume_s=300) as seen:
        until(seen, lambda state: seen.maps)
        process.wait_for_state_of("kept")
        process.kill()
        process.start()
        until(seen, lambda state: seen.streams == 2 and seen.maps)
        assert float(seen.maps["youngs_modulus"].min()) == pytest.approx(1e4)
    with service.observe("kept", resume_s=0.3) as seen:
        process.kill()
        with pytest.raises(teletact.Unavailable, match="start one with"):
            seen.next()


# --- lies ---------------------------------------------------------------------------------------------------------


def state(number=1, **fields):
    return palpation.Observation(state=number, **fields)


def each_asked_for(*states):
    """Who ends a stream before it has read what was written to it may leave the writer waiting: gRPC's, 10 s."""
    return lambda requests, context: (said for _, said in zip(requests, states))


def part(name, values, dtype=common.DATA_TYPE_FLOAT32, origin_m=(0.0, 0.0), **fields):
    out = palpation.ObservedMap(map=a_map(name, values, dtype), **fields)
    out.map.grid.origin_m[:] = origin_m
    return out


def valid(**fields):
    return part("valid", np.ones((3, 4)), common.DATA_TYPE_UINT8, **fields)


def surface(z_m=(0.0,), x_m=(0.0, 0.001), values=(0.001, 0.002), shape=(1, 2)):
    out = palpation.DeformedSurface(sequence=1, z_m=z_m, x_m=x_m)
    out.displacement_m.dtype = common.DATA_TYPE_FLOAT32
    out.displacement_m.shape.extend(shape)
    out.displacement_m.data = np.asarray(values, "<f4").tobytes()
    return out


LIES = {
    "a state that is not the next": (state(2), "state"),
    "a map that nobody has": (state(maps=[part("taste", np.ones((3, 4)))]), "map 'taste'"),
    "more parts than anybody sends": (state(maps=[valid()] * 5000), "maps"),
    "a B-mode image of floats": (state(maps=[part("b_mode", np.ones((3, 4)))]), "map 'b_mode'"),
    "a modulus of bytes": (state(maps=[part("youngs_modulus", np.ones((3, 4)), common.DATA_TYPE_UINT8)]),
                           "map 'youngs_modulus'"),
    "a flag of 2": (state(maps=[part("valid", np.full((3, 4), 2), common.DATA_TYPE_UINT8)]), "map 'valid'"),
    "a part beside the grid": (state(maps=[valid(), valid(origin_m=(0.0005, 0.0))]), "map 'valid'"),
    "a part that is far away": (state(maps=[valid(), valid(origin_m=(1e9, 0.0))]), "map 'valid'"),
    "a part that is endlessly far away": (state(maps=[valid(), valid(origin_m=(1e308, 0.0))]), "map 'valid'"),
    "two that take too much": (state(maps=[valid(), valid(origin_m=(9.0, 9.0))]), "map 'valid'"),
    "a surface without values": (state(surface=surface(values=(), shape=(0,))), "surface.displacement_m"),
    "one of another shape": (state(surface=surface(shape=(2, 1))), "surface.displacement_m"),
    "one that is NaN": (state(surface=surface(values=(0, float("nan")))), "surface.displacement_m"),
    "nodes that go back": (state(surface=surface(x_m=(0.001, 0.0))), "surface"),
    "an answer without a force": (state(answer=palpation.TouchAnswer(status=1, position_m=[0, 0])), "answer.force_n"),
}


@pytest.mark.parametrize("lie", LIES)
def test_lies(lie, liar, lied_to):
    message, field = LIES[lie]
    liar.observe = lambda requests, context: iter([message])
    with lied_to.observe("s", maps=MAPS) as seen:
        with pytest.raises(teletact.BadAnswer) as caught:
            seen.next()
        assert caught.value.field == field and caught.value.remedy and not seen.maps, "nothing of it was taken"


def test_parts_are_drawn_over_each_other(liar, lied_to):
    parts = [part("youngs_modulus", np.full((2, 2), 5.0), origin_m=(0.002, 0.001)),
             part("youngs_modulus", np.full((1, 1), 7.0), origin_m=(0.002, 0.001)),
             part("youngs_modulus", np.full((1, 2), 9.0), origin_m=(0.0, 0.0))]
    liar.observe = lambda requests, context: iter([state(maps=parts)])
    with lied_to.observe("s", maps=["youngs_modulus"]) as seen:
        assert seen.next().changed == ("youngs_modulus",)
        nan = np.nan
        np.testing.assert_array_equal(seen.maps["youngs_modulus"],
                                      [[9, 9, nan, nan], [nan, nan, 7, 5], [nan, nan, 5, 5]])
        np.testing.assert_allclose(seen.maps["youngs_modulus"].x, [0, 0.001, 0.002, 0.003], atol=1e-12)


def test_another_stream_begins_with_nothing(liar, lied_to):
    """As when a service was started again, with another scene of that name."""
    image = part("b_mode", np.ones((3, 4)), common.DATA_TYPE_UINT8, window_id=3)

    liar.observe = each_asked_for(state(maps=[part("youngs_modulus", np.full((2, 2), 5.0)), valid(), image]))
    with lied_to.observe("s", maps=MAPS) as seen:
        seen.next()
        liar.observe = each_asked_for(
            state(maps=[part("youngs_modulus", np.full((1, 1), 7.0), origin_m=(0.002, 0.001))]))
        assert set(seen.maps) == {"youngs_modulus", "valid"} and set(seen.b_mode) == {3}
        seen.next()
        assert seen.streams == 2 and set(seen.maps) == {"youngs_modulus"} and not seen.b_mode
        np.testing.assert_array_equal(seen.maps["youngs_modulus"], [[7]])


def test_a_map_that_was_not_asked_for_is_a_lie(liar, lied_to):
    liar.observe = lambda requests, context: iter([state(maps=[valid()])])
    with lied_to.observe("s", maps=["b_mode"]) as seen, pytest.raises(teletact.BadAnswer, match="not asked for"):
        seen.next()


def test_b_mode_images_without_end_are_a_lie(liar, lied_to, monkeypatch):
    monkeypatch.setattr("teletact.observing._MOST_B_MODE_BYTES", 20)
    images = [part("b_mode", np.ones((3, 4)), common.DATA_TYPE_UINT8, window_id=k) for k in range(2)]
    liar.observe = each_asked_for(state(1, maps=images[:1]), state(2, maps=images[1:]))
    with lied_to.observe("s", maps=["b_mode"]) as seen:
        assert seen.next().changed == (0,)
        with pytest.raises(teletact.BadAnswer, match="b_mode.*in all"):
            seen.next()


def test_rows_that_come_alone_lie_as_far_apart_as_they_say(liar, lied_to):
    rows = [part("youngs_modulus", np.full((1, 2), 1.0 + k), origin_m=(0.0, 0.001 * k)) for k in (0, 2)]
    liar.observe = lambda requests, context: iter([state(maps=rows)])
    with lied_to.observe("s", maps=["youngs_modulus"]) as seen:
        seen.next()
        np.testing.assert_array_equal(seen.maps["youngs_modulus"], [[1, 1], [np.nan] * 2, [3, 3]])


def test_closed_while_a_state_is_waited_for(liar, lied_to):
    asked = threading.Event()

    def silent(requests, context):
        asked.set()
        context.add_callback(liar.over.set)
        liar.over.wait(20)
        yield from ()

    liar.observe = silent
    seen = lied_to.observe("s")
    closing = threading.Thread(target=lambda: (asked.wait(20), seen.close()))
    closing.start()
    with pytest.raises(teletact.Cancelled, match="closed"):
        seen.next()
    closing.join()
