"""The OpenIGTLink server against a client of the test's, pyigtl, the protocol's own library, and peers that misbehave."""

import contextlib
import fcntl
import logging
import os
import pathlib
import shutil
import socket
import struct
import subprocess
import threading
import time

import numpy as np
import pytest
import xarray as xr
from conftest import short_folder
from igtl_peer import Client, bitwise, plane, until
from lying_service import a_map

import teletact
from teletact import igtl
from teletact import igtl_messages as messages
from teletact.v1 import common_pb2 as common
from teletact.v1 import palpation_pb2 as palpation
from teletact.v1 import recording_pb2 as recording


@pytest.fixture
def server():
    with igtl.Server(port=0, send_timeout_s=1.0) as server:
        yield server


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.INFO, "teletact.igtl")
    return lambda text: any(text in record.getMessage() for record in caplog.records)


def connected(server, count=1):
    client = Client(server.port)
    until(lambda: server.peers == count, "nobody connected")
    return client


def test_peers_get_images_places_and_words(server):
    server.image("modulus", plane(), unix_s=1000.25)  # before anybody is there
    client = connected(server)
    version, _, name, unix_s, body = client.until("IMAGE")
    assert (version, name, unix_s) == (1, "modulus", 1000.25)
    head = struct.unpack(">HBBBB3H12f6H", body[:72])
    assert head[:5] == (1, 1, 10, 2, 1) and head[5:8] == (3, 4, 1)
    np.testing.assert_allclose(head[8:17], [0.5, 0, 0, 0, 2, 0, 0, 0, 1])
    np.testing.assert_allclose(head[17:20], [10.5, 4.0, 0.0], rtol=1e-6)  # its middle, in mm
    np.testing.assert_array_equal(np.frombuffer(body[72:], "<f4"), np.arange(12))
    server.transform("finger", [0.02, 0.003, -0.001])
    np.testing.assert_allclose(struct.unpack(">12f", client.until("TRANSFORM")[4]),
                               [1, 0, 0, 0, 1, 0, 0, 0, 1, 20, 3, -1], rtol=1e-6)
    server.string("force", "nothing")
    assert client.until("STRING")[4] == struct.pack(">HH", 106, 7) + b"nothing"
    solid = xr.DataArray(np.zeros((2, 3, 4), bool), {a: 0.001 * np.arange(n) for a, n in zip("zyx", (2, 3, 4))},
                         ("z", "y", "x"))
    server.image("valid", solid)
    head = struct.unpack(">HBBBB3H12f6H", client.until("IMAGE")[4][:72])
    assert head[2] == 3 and head[5:8] == (4, 3, 2)


def test_a_peer_that_speaks_version_2_is_answered_so(server):
    client = connected(server)
    client.socket.sendall(messages.string("hello", "", 0).packed(2))
    end = time.monotonic() + 30
    version = 1
    while version == 1 and time.monotonic() < end:
        server.string("force", "x")
        version, *_, body = client.next()
    assert version == 2 and body == struct.pack(">HHII", 12, 2, 0, 0) + struct.pack(">HH", 106, 1) + b"x" + b"\0\0"


def header(version=1, type_=b"STATUS", name=b"peer", size=0, crc=0):
    return struct.pack(">H12s20sIIQQ", version, type_, name, 0, 0, size, crc)


DROPPED = {
    "a wrong CRC": (header(size=4, crc=7) + b"abcd", "STATUS with a wrong CRC"),
    "a name that is none": (header(name=b"\xff\x01"), "not printable ASCII"),
    "no type": (header(type_=b""), "not printable ASCII"),
    "an extended header that is cut": (header(2, size=1, crc=bitwise(b"a")) + b"a", "without its extended header"),
    "one that is too long": (header(2, size=12, crc=bitwise(struct.pack(">HHII", 99, 0, 0, 0))) +
                             struct.pack(">HHII", 99, 0, 0, 0), "does not fit its body"),
    "metadata that is too long": (header(2, size=12, crc=bitwise(struct.pack(">HHII", 12, 0, 2**32 - 1, 0))) +
                                  struct.pack(">HHII", 12, 0, 2**32 - 1, 0), "does not fit its body"),
}
LET_GO = {
    "a header of another version": (header(3), "version 3"),
    "a body without an end": (header(size=2**63), "at most"),
    "HTTP": (b"GET / HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\nUser-Agent: x\r\n\r\n", "version"),
}


@pytest.mark.parametrize("lie", DROPPED)
def test_bad_messages_are_dropped_and_said(lie, server, said):
    client = connected(server)
    client.socket.sendall(DROPPED[lie][0] + messages.string("hello", "", 0).packed(1))
    until(lambda: said(f"dropped: {DROPPED[lie][1]}") or said(DROPPED[lie][1]), lie)
    until(lambda: said("STRING is not used here"), "what follows is not read")
    server.string("force", "still here")
    assert client.until("STRING")[4].endswith(b"still here")


@pytest.mark.parametrize("lie", LET_GO)
def test_who_does_not_speak_it_is_let_go(lie, server, said):
    other, client = connected(server), connected(server, 2)
    client.socket.sendall(LET_GO[lie][0])
    assert client.socket.recv(1) == b"", "still connected"
    until(lambda: said("let go: it sent") and said(LET_GO[lie][1]) and server.peers == 1, lie)
    server.string("force", "others go on")
    assert other.until("STRING")


def test_who_stalls_is_let_go_and_holds_up_nobody(server, said):
    stalled, reader = connected(server), connected(server, 2)
    ages, big = [], plane(400, 400)
    for k in range(80):
        server.image("b_mode", big + k)
        *_, unix_s, _ = reader.until("IMAGE", lambda body: struct.unpack("<f", body[72:76])[0] == k)
        ages.append(reader.got_s - unix_s)
        if server.peers == 1:
            break
    print(f"images of 640 kB beside a peer that stalls: {1e3 * np.median(ages):.1f} ms old, {1e3 * max(ages):.1f} at most")
    until(lambda: server.peers == 1 and said("let go: it took no message within 1.0 s"), "the stalled peer is kept")
    stalled.socket.close()


def test_a_slow_peer_misses_what_is_old(server):
    client = connected(server)
    big = plane(1000, 1000)
    for k in range(12):  # more than sockets hold
        server.image("b_mode", big + k)
    seen = []
    while not seen or seen[-1] != 11:
        seen.append(struct.unpack("<f", client.until("IMAGE")[4][72:76])[0])
    assert len(seen) < 12 and seen == sorted(seen)


def test_as_many_peers_as_may(said):
    with igtl.Server(port=0, max_peers=2) as server:
        clients = [connected(server, k + 1) for k in range(2)]
        assert Client(server.port).socket.recv(1) == b""
        assert said("2 peers are connected, as many as may be")
        clients[0].socket.close()
        until(lambda: server.peers == 1)
        connected(server, 2)
    assert clients[1].socket.recv(1) == b"", "closed with the server"
    with pytest.raises(OSError):
        Client(server.port)


# --- what is served -----------------------------------------------------------------------------------------------


@contextlib.contextmanager
def following(follow, *arguments):
    over = threading.Event()
    thread = threading.Thread(target=follow, args=(*arguments, over))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(30)
        assert not thread.is_alive()


@pytest.fixture
def looks_often(monkeypatch):
    """For another version of a scene, and for a session where there is none."""
    monkeypatch.setattr("teletact.igtl._FOLLOW_S", 0.02)


def test_a_scene_is_sent_when_it_changes(looks_often, server, liar, lied_to, said):
    def observed(requests, context):
        next(requests)
        for state in range(1, 10000):
            said = palpation.Observation(state=state, scene_version=liar.scene.version)
            if state == 1:
                image = a_map("b_mode", np.full((3, 4), 200), common.DATA_TYPE_UINT8, "1")
                said.maps.add(map=image, version=1, window_id=7)
            yield said
            next(requests)
            time.sleep(0.02)
            if ends.is_set():
                ends.clear()
                return

    ends = threading.Event()

    def publish(version, modulus):
        scene = palpation.Scene(scene_id="s", version=version, youngs_modulus=a_map("youngs_modulus", np.full((3, 4), modulus)),
                                valid=a_map("valid", np.ones((3, 4)), common.DATA_TYPE_UINT8, "1"))
        scene.geometry.size_m.extend([0.1, 0.04])
        liar.scene = scene

    liar.observe = observed
    publish(1, 1e4)
    client = connected(server)
    with following(igtl.follow_scene, server, lied_to, "s"):
        *_, name, _, body = client.until("IMAGE")
        assert name == "b_mode_7" and body[72:] == bytes([200] * 12)
        assert np.frombuffer(client.until("IMAGE")[4][72:], "<f4").tolist() == [1e4] * 12
        publish(2, 2e4)
        assert np.frombuffer(client.until("IMAGE")[4][72:], "<f4").tolist() == [2e4] * 12
        liar.scene = palpation.Scene(scene_id="s", version=9)
        until(lambda: said("no maps: "))
        publish(3, 3e4)
        assert np.frombuffer(client.until("IMAGE")[4][72:], "<f4").tolist() == [3e4] * 12
        publish(3, 4e4)  # another service: its versions began anew
        ends.set()
        assert client.until("IMAGE")[2] == "b_mode_7"
        assert np.frombuffer(client.until("IMAGE")[4][72:], "<f4").tolist() == [4e4] * 12


def entry(**fields):
    data = recording.RecordEntry(monotonic_ns=time.monotonic_ns(), **fields).SerializeToString()
    assert len(data) < 128
    return bytes([len(data)]) + data


def tick(depth_m):
    return entry(servo=recording.ServoSample(position_m=[0.05, depth_m, 0.0], force_n=[0.0, -0.25, 0.0], state=1))


@contextlib.contextmanager
def written(path, *entries):
    """A recording that a session has: locked as RecordWriter does."""
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)
    with open(path, "wb", buffering=0) as file:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack("hhqqi0q", fcntl.F_WRLCK, 0, 0, 0, 0))
        for data in entries:
            file.write(data)
        yield file


def test_a_session_is_sent_and_its_silence_is_no_force(looks_often, server):
    words = lambda text: lambda body: text.encode() in body  # noqa: E731
    first = entry(header=recording.RecordHeader(kind="touch", version=2))
    with short_folder() as folder:
        path = f"{folder}/session"
        client = connected(server)
        with following(igtl.follow_session, server, path):
            client.until("STRING", words("none: no session"))
            with written(path, first) as file:
                file.write(tick(0.003)[:7])
                client.until("STRING", words("none: the session says nothing"))
            client.until("STRING", words("none: the session has ended"))
            with written(path, first) as file:
                for _ in range(20):
                    file.write(tick(0.002))
                    time.sleep(0.005)
                place = struct.unpack(">12f", client.until("TRANSFORM")[4])[9:]
                np.testing.assert_allclose(place, [50, 2, 0], rtol=1e-6)
                *_, unix_s, body = client.until("STRING", words("force_n="))
                assert b"force_n=0.0000,-0.2500,0.0000 state=ENABLED" in body and abs(time.time() - unix_s) < 30
                client.until("STRING", words("none: the session says nothing"))
            for wrong, said in ((entry(header=recording.RecordHeader(kind="touch", version=9)), "version 9"),
                                (b"\xff" * 20, "damaged")):
                with written(path, wrong):
                    client.until("STRING", words(said))
            with written(path, first, tick(float("nan"))):
                client.until("STRING", words("nan"))


def test_ticks_of_before_are_not_sent(looks_often, server):
    words = lambda text: lambda body: text.encode() in body  # noqa: E731
    with short_folder() as folder:
        old = tick(0.009)
        time.sleep(1.5 * igtl._SILENCE_S)
        client = connected(server)
        with written(f"{folder}/session", entry(header=recording.RecordHeader(kind="touch", version=2)), old) as file:
            with following(igtl.follow_session, server, f"{folder}/session"):
                client.until("STRING", words("none: "))
                file.write(tick(0.001))
                place = struct.unpack(">12f", client.until("TRANSFORM")[4])[9:]
                np.testing.assert_allclose(place, [50, 1, 0], rtol=1e-6)


@pytest.mark.parametrize("options, why", [([], "give --service and --scene"), (["--scene", "s"], "give --service"),
                                          (["--session", "x", "--listen", "0.0.0.0:0"], "beyond this machine"),
                                          (["--session", "x", "--listen", "18944"], "--listen")])
def test_options_that_are_refused(options, why, capsys):
    with pytest.raises(SystemExit):
        igtl.main(options)
    assert why in capsys.readouterr().err


# --- others' clients ----------------------------------------------------------------------------------------------


def test_pyigtl(server):
    pyigtl = pytest.importorskip("pyigtl", reason="pyigtl is not installed (pip install pyigtl)")
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", server.port)
    try:
        until(lambda: server.peers == 1)
        for version in (1, 2):
            server.image("modulus", plane(first=version))
            image = client.wait_for_message("modulus", timeout=30)
            assert image.header_version == version
            np.testing.assert_array_equal(image.image[0], plane(first=version).values)
            np.testing.assert_allclose(image.ijk_to_world_matrix, [[0.5, 0, 0, 10], [0, 2, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]],
                                       atol=1e-5)
            server.transform("finger", [0.02, 0.003, 0.0])
            np.testing.assert_allclose(client.wait_for_message("finger", timeout=30).matrix[:3, 3], [20, 3, 0], rtol=1e-6)
            server.string("force", "0.5 N")
            assert client.wait_for_message("force", timeout=30).string == "0.5 N"
            hello = pyigtl.StringMessage("hello", device_name="slicer")
            hello.header_version = 2
            client.send_message(hello)
            until(lambda: next(iter(server._peers))._version == 2 if server.peers else False)
        assert server.peers == 1
    finally:
        client.stop()


def test_the_library(server, tmp_path, said):
    headers = pathlib.Path("/usr/include/openigtlink")
    if not headers.exists() or not shutil.which("g++"):
        pytest.skip("libopenigtlink-dev is not installed")
    program = tmp_path / "client"
    subprocess.run(["g++", "-std=c++17", "-I", headers, pathlib.Path(__file__).with_name("igtl_client.cpp"), "-o", program,
                    "-lOpenIGTLink", "-pthread"], check=True)
    server.image("modulus", plane())
    client = subprocess.Popen([program, str(server.port)], stdout=subprocess.PIPE, text=True)
    until(lambda: server.peers == 1)
    until(lambda: said("STATUS is not used here"), "its STATUS was not read")
    server.transform("finger", [0.02, 0.003, -0.001])
    server.string("force", "0.5 N")
    out, _ = client.communicate(timeout=60)
    assert client.returncode == 0, out
    lines = dict(line.split(" ", 1) for line in out.splitlines())
    assert lines["IMAGE"] == "modulus 3 4 1 0.5000 2.0000 1.0000 at 10.5000 4.0000 0.0000: 0.0 11.0 type 10 endian 2 axes 1"
    assert lines["TRANSFORM"] == "finger 20.0000 3.0000 -1.0000 1.0"
    assert lines["STRING"] == "force 0.5 N"
    assert not said("dropped")
