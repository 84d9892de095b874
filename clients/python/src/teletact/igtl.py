"""An OpenIGTLink server: maps as IMAGE, the finger as TRANSFORM, the force as STRING, for 3D Slicer and others.

    python3 -m teletact.igtl --service 127.0.0.1:50051 --scene liver --session touch.record

From a program:

    with teletact.igtl.Server() as server:
        server.image("axial_strain", maps.axial_strain)

Each peer has a thread, and of each name a slot with the newest message: who reads slowly misses what is old, and holds
up nobody. Who does not read for ``send_timeout_s`` is let go. The protocol has no encryption and no passwords.
"""

from __future__ import annotations

import argparse
import fcntl
import ipaddress
import logging
import select
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, BinaryIO

import xarray as xr

import teletact
from teletact import igtl_messages as messages
from teletact import recordings
from teletact.errors import TeletactError

_LOG = logging.getLogger("teletact.igtl")
_MAX_BYTES = 1 << 20       # of a message that a peer sends
_FOLLOW_S = 0.5             # how often a scene's version is asked for
_SILENCE_S = 0.5            # of a session, after which there is no force
_PERIOD_S = 1 / 60          # of finger and force
_LOOK_S = 0.004             # between looks at what a session has written
_STATES = ("DISABLED", "ENABLED", "PAUSED", "FAULT")
NO_FORCE = "none: "


class Server:
    """Serves until it is closed. Every method may be called from any thread, and waits for no peer."""

    def __init__(self, host: str = "127.0.0.1", port: int = 18944, *, max_peers: int = 8,
                 send_timeout_s: float = 2.0) -> None:
        """``port``: 0 takes a free one. Raises OSError where it cannot listen."""
        self._max_peers, self._send_timeout_s = max_peers, send_timeout_s
        self._listening = socket.create_server((host, port))
        self.port: int = self._listening.getsockname()[1]
        self._lock = threading.Lock()
        self._peers: set[_Peer] = set()
        self._images: dict[str, messages.Message] = {}  # what a newcomer gets first
        self._closed = False
        threading.Thread(target=self._accept, name="igtl", daemon=True).start()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def peers(self) -> int:
        with self._lock:
            return len(self._peers)

    def image(self, name: str, values: xr.DataArray, unix_s: float | None = None) -> None:
        """A map over (y, x) or (z, y, x); it is kept for peers that come later. ``unix_s``: when it was true; now."""
        message = messages.image(name, values, time.time() if unix_s is None else unix_s)
        with self._lock:
            self._images[name] = message
        self._send(message)

    def transform(self, name: str, position_m: Any, unix_s: float | None = None) -> None:
        """A place of the scene, [x, y, z]."""
        self._send(messages.transform(name, position_m, time.time() if unix_s is None else unix_s))

    def string(self, name: str, text: str, unix_s: float | None = None) -> None:
        self._send(messages.string(name, text, time.time() if unix_s is None else unix_s))

    def close(self) -> None:
        """Ends all connections."""
        with self._lock:
            self._closed = True
            peers = list(self._peers)
        try:
            self._listening.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
        except OSError:
            pass
        self._listening.close()
        for peer in peers:
            peer.end("")

    def _send(self, message: messages.Message) -> None:
        with self._lock:
            peers = list(self._peers)
        for peer in peers:
            peer.put(message)

    def _accept(self) -> None:
        while not self._closed:
            try:
                connection, address = self._listening.accept()
            except OSError:
                return
            with self._lock:
                full = self._closed or len(self._peers) >= self._max_peers
                if not full:
                    peer = _Peer(connection, f"{address[0]}:{address[1]}", self._send_timeout_s, self._gone)
                    self._peers.add(peer)
                    for image in self._images.values():
                        peer.put(image)
            if full:
                _LOG.warning("%s:%d refused: %d peers are connected, as many as may be", *address[:2], self._max_peers)
                connection.close()
            else:
                _LOG.info("%s connected", peer.name)
                peer.start()

    def _gone(self, peer: _Peer) -> None:
        with self._lock:
            self._peers.discard(peer)


class _Peer(threading.Thread):
    """One connection: sends what is in its slots, and looks at what comes."""

    def __init__(self, connection: socket.socket, name: str, send_timeout_s: float, gone: Any) -> None:
        super().__init__(name=name, daemon=True)
        self._connection, self._gone = connection, gone
        connection.settimeout(send_timeout_s)  # of a whole message
        self._send_timeout_s = send_timeout_s
        self._wakes, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        self._lock = threading.Lock()
        self._slots: dict[tuple[str, str], messages.Message] = {}
        self._reader = messages.Reader(_MAX_BYTES)
        self._version = 1  # as the peer speaks
        self._ended: str | None = None
        self._unused: set[str] = set()

    def put(self, message: messages.Message) -> None:
        with self._lock:
            self._slots[message.type, message.name] = message
        self._nudge()

    def end(self, why: str) -> None:
        self._ended = why
        self._nudge()

    def _nudge(self) -> None:
        try:
            self._wake.send(b"x")
        except OSError:
            pass  # full: it is awake already; closed: it has ended

    def run(self) -> None:
        try:
            while self._ended is None:
                ready, _, _ = select.select([self._connection, self._wakes], [], [])
                if self._wakes in ready:
                    self._wakes.recv(4096)
                if self._connection in ready and not self._read():
                    break
                self._write()
        except TimeoutError:
            self._ended = f"it took no message within {self._send_timeout_s} s"
        except messages.BadMessage as error:
            self._ended = f"it sent {error}"
        except OSError as error:
            self._ended = error.strerror or str(error)
        finally:
            self._gone(self)
            for end in (self._connection, self._wakes, self._wake):
                end.close()
        if self._ended:
            _LOG.warning("%s let go: %s", self.name, self._ended)
        else:
            _LOG.info("%s gone", self.name)

    def _write(self) -> None:
        with self._lock:
            newest, self._slots = self._slots, {}
        for message in newest.values():
            self._connection.sendall(message.packed(self._version))

    def _read(self) -> bool:
        data = self._connection.recv(65536)
        self._reader.feed(data)
        while True:
            try:
                message = self._reader.next()
            except messages.BadMessage as error:
                if error.fatal:
                    raise
                _LOG.warning("%s: dropped: %s", self.name, error)
                continue
            if message is None:
                return bool(data)
            self._version = message.version
            if message.type not in self._unused and len(self._unused) < 16:
                self._unused.add(message.type)
                _LOG.info("%s: %s is not used here", self.name, message.type)


# --- what is served -------------------------------------------------------------------------------------------


def follow_scene(server: Server, service: teletact.Service, scene_id: str, over: threading.Event) -> None:
    """Sends the scene's modulus (Pa) whenever there is another, and each window's B-mode, until ``over`` is set."""
    version, said, streams = None, "", 0
    with service.observe(scene_id, maps=["b_mode"], max_rate_hz=1 / _FOLLOW_S, resume_s=0) as seen:
        while not over.is_set():
            try:
                newest = seen.next()
                if seen.streams != streams:  # another service perhaps, whose versions begin anew
                    version, streams = None, seen.streams
                for window in newest.changed:
                    server.image(f"b_mode_{window}", seen.b_mode[int(window)])
                if newest.scene_version != version and newest.scene_version > 0:
                    server.image("modulus", service.modulus(scene_id).youngs_modulus)
                    version = newest.scene_version
                said = ""
            except TeletactError as error:
                if str(error) != said:
                    said = str(error)
                    _LOG.warning("no maps: %s", said)
                over.wait(_FOLLOW_S)


class _Written:
    """A recording that a session writes: ``read`` waits for what comes, and calls ``silent`` while nothing does."""

    def __init__(self, file: BinaryIO, silent: Callable[[], None], over: threading.Event) -> None:
        self._file, self._silent, self._over = file, silent, over

    def still(self) -> bool:
        """Whether the session's process has the file: RecordWriter's lock (client/link/recording.h)."""
        lock = fcntl.fcntl(self._file, fcntl.F_OFD_GETLK, struct.pack("hhqqi0q", fcntl.F_WRLCK, 0, 0, 0, 0))
        return bool(struct.unpack("hhqqi0q", lock)[0] != fcntl.F_UNLCK)

    def read(self, size: int) -> bytes:
        data, since_s = self._file.read(size), time.monotonic()
        while len(data) < size and self.still() and not self._over.is_set():
            if time.monotonic() - since_s > _SILENCE_S:
                self._silent()
                since_s = time.monotonic()
            time.sleep(_LOOK_S)
            data += self._file.read(size - len(data))
        return data + self._file.read(size - len(data))


def follow_session(server: Server, path: str, over: threading.Event) -> None:
    """Sends finger and force of a session as it is recorded (``touch --record``), and says where there is none."""
    def silent() -> None:
        server.string("force", f"{NO_FORCE}the session says nothing for {_SILENCE_S} s")

    while not over.is_set():
        why = "no session"
        try:
            with open(path, "rb") as file:
                written = _Written(file, silent, over)
                if written.still():
                    _send_ticks(server, written, path, silent)
                    why = "the session has ended"
        except TeletactError as error:  # first: some are OSErrors, too
            why = str(error)
        except OSError as error:
            why = f"no session ({error.strerror})"
        server.string("force", NO_FORCE + why)
        over.wait(_FOLLOW_S)


def _send_ticks(server: Server, file: Any, path: str, silent: Callable[[], None]) -> None:
    next_s = heard_s = time.monotonic()
    entries = recordings.entries_of(file, path)
    recordings.check_header(next(entries, None), path)
    for entry in entries:
        now = time.monotonic()
        if now - heard_s > _SILENCE_S:  # other entries come, or ticks of long ago
            silent()
            heard_s = now
        if entry is None or not entry.HasField("servo") or now < next_s:
            continue
        tick, age_s = entry.servo, 1e-9 * (time.monotonic_ns() - entry.monotonic_ns)
        if age_s > _SILENCE_S:  # of before this looked on, or it is behind
            continue
        heard_s = now
        next_s = now + _PERIOD_S
        state = _STATES[tick.state] if tick.state < len(_STATES) else str(tick.state)
        force = ",".join(f"{value:.4f}" for value in tick.force_n)
        server.transform("finger", (list(tick.position_m) + [0.0] * 3)[:3], time.time() - age_s)
        server.string("force", f"force_n={force} state={state} degraded={int(tick.degraded)} "
                               f"service_degraded={int(tick.service_degraded)}", time.time() - age_s)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teletact.igtl", description="OpenIGTLink server of a scene and a session.")
    parser.add_argument("--listen", default="127.0.0.1:18944", metavar="ADDRESS:PORT", help="127.0.0.1:18944")
    parser.add_argument("--allow-insecure-remote", action="store_true", help="listen beyond this machine")
    parser.add_argument("--service", help="HOST:PORT or unix:/path, for --scene")
    parser.add_argument("--scene", help="whose modulus is sent, as IMAGE 'modulus', and B-mode, 'b_mode_1' ...")
    parser.add_argument("--session", metavar="FILE", help="of touch --record: TRANSFORM 'finger', STRING 'force'")
    parser.add_argument("--tls-ca")
    parser.add_argument("--token-file")
    given = parser.parse_args(arguments)
    if (given.service is None) != (given.scene is None) or (given.scene is None and given.session is None):
        parser.error("give --service and --scene, or --session, or all three")
    host, _, port = given.listen.rpartition(":")
    try:
        local = ipaddress.ip_address(host).is_loopback
        number = int(port)
    except ValueError:
        parser.error(f"--listen: {given.listen}; give an IPv4 address and a port, such as 127.0.0.1:18944")
    if not local and not given.allow_insecure_remote:
        parser.error(f"--listen: {host} is beyond this machine, and OpenIGTLink encrypts nothing; "
                     "on a closed network give --allow-insecure-remote")
    logging.basicConfig(format="teletact.igtl: %(message)s", level=logging.INFO)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    over = threading.Event()
    threads = []
    try:
        with Server(host, number) as server:
            _LOG.info("serving on %s:%d", host, server.port)
            if given.session is not None:
                threads.append(threading.Thread(target=follow_session, args=(server, given.session, over)))
            if given.scene is not None:
                service = teletact.connect(given.service, tls_ca=given.tls_ca, token_file=given.token_file)
                threads.append(threading.Thread(target=follow_scene, args=(server, service, given.scene, over)))
            for thread in threads:
                thread.start()
            try:
                while all(thread.is_alive() for thread in threads):
                    over.wait(1)
                return 1  # a thread has failed: its error is printed
            finally:
                over.set()
                for thread in threads:
                    thread.join()
    except KeyboardInterrupt:
        return 0
    except (TeletactError, OSError, OverflowError) as error:
        print(f"teletact.igtl: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
