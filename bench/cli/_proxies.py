"""The proxies of the environment, which many libraries ask: for object stores, for MQTT, for language models."""

from __future__ import annotations

from collections.abc import MutableMapping

LOOPBACK = ("localhost", "127.0.0.1", "::1")


def exempt_loopback(environment: MutableMapping[str, str]) -> None:
    """Add this machine to the hosts that are reached without a proxy: no proxy leads back to it. Workers inherit it."""
    if not any(name.lower().endswith("_proxy") for name in environment):
        return
    stated = environment.get("no_proxy") or environment.get("NO_PROXY", "")
    # Alone it exempts every host; in a list, not for all libraries.
    if stated.strip() == "*":
        return
    hosts = [host.strip() for host in stated.split(",") if host.strip()]
    hosts += [host for host in LOOPBACK if host not in hosts]
    # Libraries differ in which spelling they look for first.
    environment["no_proxy"] = environment["NO_PROXY"] = ",".join(hosts)
