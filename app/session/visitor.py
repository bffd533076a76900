"""Who asks: the network address and the session that are being served now."""

from __future__ import annotations

import ipaddress

import panel as pn


def this_visitor() -> tuple[str, str]:
    """Network and session of the visitor whose handler runs now; empty outside a server."""
    context = getattr(pn.state.curdoc, "session_context", None)
    request = getattr(context, "request", None)
    return network(getattr(request, "remote_ip", None) or ""), str(getattr(context, "id", ""))


def network(address: str) -> str:
    """What one person has: an IPv4 address, or an IPv6 network of 64 bits."""
    try:
        number = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address[:64]
    if number.version == 4:
        return str(number)
    return str(ipaddress.ip_network((number, 64), strict=False))
