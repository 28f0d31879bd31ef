"""Proxies of the environment: none is asked for this machine."""

from __future__ import annotations

import subprocess
import sys
import urllib.request

import pytest

from bench.cli import exempt_loopback

PROXIES = {"http_proxy": "http://proxy:3128", "mqtt_proxy": "socks://proxy:1080"}


@pytest.mark.parametrize(
    ("stated", "exempt"),
    [
        ({}, "localhost,127.0.0.1,::1"),
        ({"NO_PROXY": ".example, ::1"}, ".example,::1,localhost,127.0.0.1"),
        ({"no_proxy": "a", "NO_PROXY": "b"}, "a,localhost,127.0.0.1,::1"),
    ],
)
def test_this_machine_is_exempt_beside_the_hosts_that_were(stated: dict[str, str], exempt: str) -> None:
    environment = PROXIES | stated
    exempt_loopback(environment)
    assert environment == PROXIES | {"no_proxy": exempt, "NO_PROXY": exempt}
    once = dict(environment)
    exempt_loopback(environment)
    assert environment == once


def test_nothing_is_changed_where_there_is_no_proxy_or_none_is_used() -> None:
    for stated in ({}, {"PATH": "/bin"}, PROXIES | {"NO_PROXY": "*"}):
        environment = dict(stated)
        exempt_loopback(environment)
        assert environment == stated


def test_every_command_begins_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the standard library, on which MQTT's proxies rest too, understands it."""
    monkeypatch.setenv("HTTP_PROXY", "http://proxy:3128")
    monkeypatch.setenv("NO_PROXY", "")
    code = (
        "import sys, urllib.request, bench.cli\nsys.argv = ['rebar', '--version']\n"
        "try:\n    bench.cli.main()\nfinally:\n"
        "    print([bool(urllib.request.proxy_bypass(host)) for host in ('127.0.0.1', 'localhost', 'models.example')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[True, True, False]"
    assert not urllib.request.proxy_bypass("models.example")
