"""Certificate and key in files, which tests renew."""

from __future__ import annotations

import ssl
from pathlib import Path

import trustme

__all__ = ["Pair", "replace"]


class Pair:
    """Certificate chain and key on disk, with the authority that clients trust."""

    def __init__(self, folder: Path) -> None:
        self.cert = folder / "chain.pem"
        self.key = folder / "key.pem"
        self.authority = trustme.CA()
        self.renew()

    def renew(self, *, key: bool = True, cert: bool = True) -> None:
        issued = self.authority.issue_cert("127.0.0.1")
        if key:
            replace(self.key, issued.private_key_pem.bytes())
        if cert:
            replace(self.cert, b"".join(blob.bytes() for blob in issued.cert_chain_pems))

    def client(self) -> ssl.SSLContext:
        context = ssl.create_default_context()
        self.authority.configure_trust(context)
        return context


def replace(path: Path, content: bytes) -> None:
    """Replace a file as renewal programs do: by a new file with its name."""
    new = path.with_suffix(".new")
    new.write_bytes(content)
    new.chmod(0o600)
    new.replace(path)
