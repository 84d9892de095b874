"""How a service is reached: its address, and by which client and service know each other."""

from __future__ import annotations

import ctypes
import gc
import os
import re
import secrets
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import grpc
import grpc.aio

from teletact.errors import FailedPrecondition, InvalidArgument
from teletact.v1 import elastography_pb2_grpc, info_pb2_grpc, palpation_pb2_grpc

# Generated without types.
ElastographyStub: Any = elastography_pb2_grpc.ElastographyStub
InfoStub: Any = info_pb2_grpc.InfoStub
PalpationStub: Any = palpation_pb2_grpc.PalpationStub

_MOST_MESSAGE_BYTES = 256 << 20
_LONGEST_TOKEN = 512
_MOST_FILE_BYTES = 1 << 20  # of a token, a certificate or a key
_OPTIONS = [
    ("grpc.initial_reconnect_backoff_ms", 50),
    ("grpc.min_reconnect_backoff_ms", 3000),  # how long one attempt may take: gRPC's name for it
    ("grpc.max_reconnect_backoff_ms", 200),
    ("grpc.keepalive_time_ms", 30000),
    ("grpc.enable_retries", 0),
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.max_receive_message_length", _MOST_MESSAGE_BYTES),
    ("grpc.max_send_message_length", -1),
]
_process: int | None = None  # that uses gRPC by this module


def forked() -> bool:
    """Whether this process was forked from one that had used gRPC. gRPC's threads stay with the parent, so that here
    every call would wait for ever."""
    return _process not in (None, os.getpid())


def require_not_forked() -> None:
    """Before gRPC is used."""
    global _process
    if forked():
        raise FailedPrecondition("this process was forked from one that had connected, and gRPC does not work here",
                                 remedy="connect in children alone, or start them by multiprocessing's \"spawn\"")
    if _process is None and _fork_never_returns():
        for fork in ("fork", "forkpty"):
            setattr(os, fork, _refuse_to_fork)
    _process = os.getpid()


def _fork_never_returns() -> bool:
    """Debian 13's build of gRPC 1.51, once it is used: in fork() it waits for its own poller to end, which never does.
    The index has no gRPC of these versions for these Pythons."""
    return sys.version_info >= (3, 12) and grpc.__version__.startswith("1.51.")


def _refuse_to_fork() -> NoReturn:
    raise FailedPrecondition("this process has connected, and Debian 13's gRPC would wait in fork() for ever",
                             remedy="fork before connecting, or start children by multiprocessing's \"spawn\"")


def _leave_to_the_parent() -> None:
    """A forked child never frees a channel or a call: it would wait for a lock that a thread of its parent had."""
    for one in gc.get_objects() if forked() else []:
        if issubclass(type(one), (grpc.aio.Channel, grpc.aio.Call)):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(one))


os.register_at_fork(after_in_child=_leave_to_the_parent)


@dataclass(frozen=True)
class Peer:
    """A service, and how to speak to it."""

    address: str
    tls_ca: bytes | None = None
    tls_certificate: bytes | None = None
    tls_key: bytes | None = None
    token: str | None = None
    name: str = ""
    proxy: bool = False

    def channel(self) -> grpc.aio.Channel:
        """A new connection, made when it is first used."""
        require_not_forked()
        options = [*_OPTIONS, ("grpc.enable_http_proxy", int(self.proxy))]  # gRPC would take the environment's unasked
        if self.tls_ca is None:
            return grpc.aio.insecure_channel(_target(self.address), options=options)
        credentials = grpc.ssl_channel_credentials(self.tls_ca, self.tls_key, self.tls_certificate)
        return grpc.aio.secure_channel(_target(self.address), credentials, options=options)

    def metadata(self, scene_id: str = "") -> list[tuple[str, str]]:
        """What goes with a call about a scene."""
        require_not_forked()
        said = [("teletact-client", self.name)]
        if self.token is not None:
            said.append(("authorization", f"Bearer {self.token}"))
        if scene_id and _plain(scene_id):
            said.append(("teletact-scene", scene_id))
        return said

    def remedy(self) -> str:
        """What helps when nobody answers."""
        if host := _unresolved_host(self.address):
            return f"the name {host} does not resolve; check it"
        if self.proxy:
            return "check the proxy of the environment (grpc_proxy, https_proxy or http_proxy), or leave proxy= out"
        start = f"start one with './teletact serve --listen {self.address}' (teletact-service), "
        if self.tls_ca is None:
            return start + "or give tls_ca= if it serves TLS"
        start += "with a certificate that tls_ca= signed for that name and that is valid by this machine's clock, "
        if self.tls_certificate is None:
            return start + "or give tls_certificate= and tls_key= if it asks for them"
        return start + "and --tls-client-ca that signed tls_certificate="


def _target(address: str) -> str:
    """For gRPC, which would take the host of "dns:50051", or of any other of its schemes' names, for the scheme."""
    host_and_port = re.fullmatch(r"(?!unix(-abstract)?:)[^:]+:\d+", address)
    return f"dns:///{address}" if host_and_port else address


def _unresolved_host(address: str) -> str:
    """The name in HOST:PORT that stands for no machine; else empty."""
    address = _target(address)
    if address.startswith(("unix:", "unix-abstract:", "ipv4:", "ipv6:")) or "]" in address:
        return ""
    host = re.split("[:/]", address.rpartition(":")[0])[-1]
    try:
        socket.getaddrinfo(host, None)
    except OSError:
        return host
    return ""


def peer_of(address: str, tls_ca: str | Path | None, tls_certificate: str | Path | None, tls_key: str | Path | None,
            token: str | None, token_file: str | Path | None, name: str | None, proxy: bool = False) -> Peer:
    """Checked: raises InvalidArgument with the argument's name and a remedy."""
    _require_address(address)
    ca = _pem("tls_ca", tls_ca, b"-----BEGIN CERTIFICATE")
    certificate = _pem("tls_certificate", tls_certificate, b"-----BEGIN CERTIFICATE")
    key = _pem("tls_key", tls_key, b"PRIVATE KEY-----")
    if (certificate is None) != (key is None):
        raise InvalidArgument("only one is given", field="tls_certificate, tls_key", remedy="give both or none")
    if certificate is not None and ca is None:
        raise InvalidArgument("it is shown on encrypted connections alone", field="tls_certificate",
                              remedy="give tls_ca, too")
    if token_file is not None:
        if token is not None:
            raise InvalidArgument("token and token_file", field="token", remedy="give one of them")
        token = _read("token_file", token_file).decode("utf-8", "replace").strip()
    if token is not None:
        if not (0 < len(token) <= _LONGEST_TOKEN and _plain(token)):
            raise InvalidArgument("no token", field="token" if token_file is None else "token_file",
                                  remedy=f"give one word of at most {_LONGEST_TOKEN} plain characters")
        if ca is None and proxy:
            raise InvalidArgument("the proxy of proxy= could read it", field="token", remedy="give tls_ca")
        if ca is None and not _on_this_machine(address):
            raise InvalidArgument(f"{address} is beyond this machine, and without tls_ca others could read it",
                                  field="token", remedy="give tls_ca")
    if name is None:
        name = _usual_name()
    elif not (0 < len(name) <= 64 and _plain(name)):
        raise InvalidArgument(f"{name!r}", field="name", remedy="give 1 to 64 plain characters without spaces")
    return Peer(address, ca, certificate, key, token, name, proxy)


def _plain(text: str) -> bool:
    return all(" " < c <= "~" for c in text)


def _usual_name() -> str:
    host = "".join(c if " " < c <= "~" else "-" for c in socket.gethostname()[:40])
    return f"{host or 'unknown'}:{os.getpid()}:{secrets.randbelow(1 << 32)}"


def _require_address(address: str) -> None:
    if re.match(r"(unix|unix-abstract|dns|ipv4|ipv6):", address):
        return
    if address.count(":") > 1 and not address.startswith(("[", "http")):
        raise InvalidArgument(f"{address!r}", field="address", remedy="an IPv6 address stands in brackets: [::1]:50051")
    found = re.fullmatch(r"(.+):(\d{1,5})", address)
    if address.startswith("http") or not found or not 0 < int(found[2]) < 65536:
        raise InvalidArgument(f"{address!r}", field="address",
                              remedy="give HOST:PORT (at most 65535) or unix:/path")


def _on_this_machine(address: str) -> bool:
    address = re.sub(r"^(dns|ipv4|ipv6):", "", address)
    if address.startswith(("unix:", "unix-abstract:")):
        return True
    return re.fullmatch(r"(127[\d.]*|\[::1\]|localhost):\d+", address) is not None


def _read(field: str, path: str | Path) -> bytes:
    try:
        with open(path, "rb") as file:
            data = file.read(_MOST_FILE_BYTES + 1)
    except OSError as error:
        raise InvalidArgument(f"{path} cannot be read ({error.strerror})", field=field,
                              remedy="give another file") from None
    if len(data) > _MOST_FILE_BYTES:
        raise InvalidArgument(f"{path} holds more than {_MOST_FILE_BYTES} bytes", field=field,
                              remedy="give another file")
    return data


def _pem(field: str, path: str | Path | None, kind: bytes) -> bytes | None:
    if path is None:
        return None
    data = _read(field, path)
    if kind not in data:
        raise InvalidArgument(f"no PEM {'key' if b'KEY' in kind else 'certificate'} can be read in {path}", field=field,
                              remedy="give a PEM file")
    return data
