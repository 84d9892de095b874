"""Children that are forked, which get none of gRPC's threads: each call answers or raises, and none waits for ever."""

import json
import subprocess
import sys

import pytest
import teletact.channel

CHILD = """
import asyncio, gc, json, os, sys, teletact, weakref
from teletact import aio

def in_child(work):
    # What it returns or raises there; the child ends as any program does.
    read, write = os.pipe()
    try:
        child = os.fork()
    except teletact.TeletactError as error:
        return str(error)
    if child == 0:
        try:
            said = work()
        except teletact.TeletactError as error:
            said = str(error)
        os.write(write, json.dumps(said).encode())
        sys.exit()
    os.close(write)
    with open(read) as pipe:
        said = json.load(pipe)
    assert os.wait()[1] == 0
    return said

def kept(service, seen):
    # To free what the parent's gRPC holds would wait, now and then, for a lock of its threads.
    held = [weakref.ref(one) for one in (service._channel, seen._channel, seen._stream)]
    service._channel = seen._channel = seen._stream = None
    gc.collect()
    return [one() is not None for one in held]

def connects():
    with teletact.connect(sys.argv[1]) as service:
        return len(service.scenes())

async def connects_aio():
    async with await aio.connect(sys.argv[1]) as service:
        return len(await service.scenes())

async def opened_aio():
    service = await aio.connect(sys.argv[1])
    touch, seen = await service.touch(sys.argv[2]).start(), service.observe(sys.argv[2], answers=True)
    await touch.at([0.05, 0.001])
    await seen.next()
    return service, touch, seen
"""
BEFORE = CHILD + """
print(json.dumps({"connected": in_child(connects), "by aio": in_child(lambda: asyncio.run(connects_aio())),
                  "the parent": connects()}))
"""
AFTER = CHILD + """
with teletact.connect(sys.argv[1]) as service, service.touch(sys.argv[2]) as touch, \\
        service.observe(sys.argv[2], answers=True) as seen:
    touch.at([0.05, 0.001])
    seen.next()
    said = {"a call": in_child(service.scenes), "a pose": in_child(lambda: touch.at([0.05, 0.001])),
            "another touch": in_child(lambda: service.touch(sys.argv[2])), "looking on": in_child(seen.next),
            "a fresh connection": in_child(connects), "by aio": in_child(lambda: asyncio.run(connects_aio())),
            "kept": in_child(lambda: kept(service._core, seen._core)),
            "closing": [in_child(it.close) for it in (seen, touch, service)]}
    assert touch.at([0.05, 0.001]).force_n[1] < 0  # the parent goes on
print(json.dumps(said))
"""
AFTER_AIO = CHILD + """
loop = asyncio.new_event_loop()
service, touch, seen = loop.run_until_complete(opened_aio())
of_child = lambda work: in_child(lambda: asyncio.run(work()))
print(json.dumps({
    "a call": of_child(service.scenes), "a pose": of_child(lambda: touch.at([0.05, 0.001])),
    "another touch": of_child(lambda: service.touch(sys.argv[2]).start()), "looking on": of_child(seen.next),
    "a fresh connection": of_child(connects_aio), "by threads": in_child(connects),
    "kept": in_child(lambda: kept(service, seen)), "closing": [of_child(it.close) for it in (seen, touch, service)]}))
for it in (seen, touch, service):
    loop.run_until_complete(it.close())
"""
REFUSED = ("FAILED_PRECONDITION: this process was forked from one that had connected, and gRPC does not work here; "
           "connect in children alone, or start them by multiprocessing's \"spawn\"")

NEVER_RETURNS = ("FAILED_PRECONDITION: this process has connected, and Debian 13's gRPC would wait in fork() for ever; "
                 "fork before connecting, or start children by multiprocessing's \"spawn\"")


def said_by(script, *arguments):
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", script, *arguments], capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_child_forked_before_the_first_connection_connects(process, lump):
    scenes = said_by(BEFORE, process.address)
    assert set(scenes) == {"connected", "by aio", "the parent"} and min(scenes.values()) >= 1


@pytest.mark.parametrize("script", [AFTER, AFTER_AIO], ids=["threads", "aio"])
def test_a_child_forked_after_it_is_told_so(process, lump, script):
    said = said_by(script, process.address, lump)
    if teletact.channel._fork_never_returns():
        assert said.pop("closing") == [NEVER_RETURNS] * 3
        assert set(said.values()) == {NEVER_RETURNS}, said
        return
    assert said.pop("kept") == [True] * 3 and said.pop("closing") == [None, None, None]
    assert set(said.values()) == {REFUSED}, said
