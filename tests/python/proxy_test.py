"""Proxies of the environment do not come between a client and its service, unless they are asked for."""

import pytest
from lying_service import Liar

import teletact


@pytest.fixture
def on_tcp():
    """A service on TCP: for a Unix socket gRPC asks no proxy."""
    liar = Liar()
    server = liar.serve("127.0.0.1:0")
    yield liar.address
    server.stop(None).wait()


@pytest.mark.parametrize("variable", ["http_proxy", "https_proxy", "grpc_proxy"])
def test_unasked_none_is_taken(on_tcp, impatient, monkeypatch, variable):
    monkeypatch.setenv(variable, "http://127.0.0.1:9")  # nobody is there
    monkeypatch.setenv("no_proxy", "localhost")
    with teletact.connect(on_tcp):
        pass
    with pytest.raises(teletact.Unavailable, match="check the proxy of the environment"):
        teletact.connect(on_tcp, proxy=True)


def test_a_token_does_not_pass_it_in_the_clear():
    with pytest.raises(teletact.InvalidArgument, match="give tls_ca"):
        teletact.connect("127.0.0.1:9", token="secret", proxy=True)


@pytest.mark.parametrize("address", ["::1:50051", "fe80::1:50051", "::1"])
def test_ipv6_stands_in_brackets(address):
    with pytest.raises(teletact.InvalidArgument, match=r"brackets: \[::1\]:50051"):
        teletact.connect(address)
