"""The names in a certificate: what clients have to call a server for its certificate to hold.

Of the standard library only a handshake reads certificates, and that only if they are valid; so
the one extension that matters is read here.
"""

from __future__ import annotations

import ipaddress
import re
import ssl
from collections.abc import Iterator

__all__ = ["certificate_names"]

SUBJECT_ALT_NAME = bytes.fromhex("0603551d11")
"""The object identifier 2.5.29.17 (RFC 5280, 4.2.1.6) in DER."""
BOOLEAN, OCTET_STRING, SEQUENCE = 0x01, 0x04, 0x30
DNS_NAME, IP_ADDRESS = 0x82, 0x87

_PEM = re.compile(rb"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----", re.DOTALL)


def certificate_names(chain: bytes) -> tuple[list[str], list[str]]:
    """The DNS names and the addresses of a PEM chain's first certificate, in its order; both
    empty where there are none, or nothing can be read."""
    dns: list[str] = []
    addresses: list[str] = []
    found = _PEM.search(chain)
    if found is None:
        return dns, addresses
    try:
        names = list(_alternative_names(ssl.PEM_cert_to_DER_cert(found[0].decode("ascii"))))
        dns += [content.decode("ascii") for tag, content in names if tag == DNS_NAME]
        addresses += [str(ipaddress.ip_address(own)) for tag, own in names if tag == IP_ADDRESS]
    except (ValueError, IndexError):
        return [], []
    return dns, addresses


def _alternative_names(certificate: bytes) -> Iterator[tuple[int, bytes]]:
    _, mark, rest = certificate.partition(SUBJECT_ALT_NAME)
    if not mark:
        return
    tag, content, rest = _element(rest)
    if tag == BOOLEAN:  # Whether the extension is critical.
        tag, content, rest = _element(rest)
    if tag != OCTET_STRING or content[0] != SEQUENCE:
        raise ValueError("not a list of names")
    _, names, _ = _element(content)
    while names:
        tag, content, names = _element(names)
        yield tag, content


def _element(data: bytes) -> tuple[int, bytes, bytes]:
    """The tag and content of the first element in DER, and what follows it."""
    tag, size, start = data[0], data[1], 2
    if size & 0x80:
        start += size & 0x7F
        size = int.from_bytes(data[2:start], "big")
    if len(data) < start + size:
        raise ValueError("the certificate is cut off")
    return tag, data[start : start + size], data[start + size :]
