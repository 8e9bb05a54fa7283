"""Files with the authorities that programs trust: `--cluster-ca` and `--mqtt-ca`."""

from __future__ import annotations

import os
import ssl
from collections.abc import Callable
from pathlib import Path

import pytest
import trustme

from robotouille.errors import RobotouilleError
from robotouille.nats.address import nats_address
from robotouille_server import ServerSettings
from robotouille_server.mqtt.broker import BrokerAddress

Connect = Callable[[Path], ssl.SSLContext | None]


def cluster(file: Path) -> ssl.SSLContext | None:
    return nats_address("tls://nats", "lab", ca=file).tls


def mqtt(file: Path) -> ssl.SSLContext | None:
    return BrokerAddress.from_settings(ServerSettings(mqtt="mqtts://broker", mqtt_ca=file)).tls


both = pytest.mark.parametrize(
    ("context", "option"), [(cluster, "--cluster-ca"), (mqtt, "--mqtt-ca")]
)


@both
@pytest.mark.parametrize(
    "content",
    [b"", b"\n", b"# no certificate\n", b"\xff\xfe", b"-----BEGIN CERTIFICATE-----\n?\n"],
    ids=["empty", "blank", "comment", "binary", "cut off"],
)
def test_file_without_a_certificate_is_refused(
    tmp_path: Path, context: Connect, option: str, content: bytes
) -> None:
    file = tmp_path / "ca.pem"
    file.write_bytes(content)
    with pytest.raises(RobotouilleError, match=rf"{option}: .*ca.pem is not a certificate in PEM"):
        context(file)


@both
def test_missing_file_is_refused(tmp_path: Path, context: Connect, option: str) -> None:
    with pytest.raises(RobotouilleError, match=rf"{option}: .*none.pem: No such file"):
        context(tmp_path / "none.pem")


@both
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_pipe_is_refused(tmp_path: Path, context: Connect, option: str) -> None:
    os.mkfifo(tmp_path / "pipe.pem")
    with pytest.raises(RobotouilleError, match=rf"{option}: .*pipe.pem: not a regular file"):
        context(tmp_path / "pipe.pem")


@both
@pytest.mark.parametrize(
    "comment",
    [b"", "# Müller\n".encode(), b"# M\xfcller\n", b"# long\n" * 700_000],
    ids=["none", "UTF-8", "Latin-1", "5 MB"],
)
def test_only_the_certificate_of_the_file_is_trusted(
    tmp_path: Path, context: Connect, option: str, comment: bytes
) -> None:
    file = tmp_path / "ca.pem"
    file.write_bytes(comment + trustme.CA().cert_pem.bytes())
    found = context(file)
    assert found is not None, option
    assert found.cert_store_stats()["x509"] == 1
