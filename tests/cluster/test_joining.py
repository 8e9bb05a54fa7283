"""What an operator is told when a node cannot join."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import RobotouilleError
from robotouille_server import ServerSettings
from robotouille_server.cluster.joining import joined
from tests.support.nats import missing, nats_cluster

real = pytest.mark.skipif(bool(missing()), reason=missing())


async def refusal(folder: Path, **options: Any) -> str:
    """Return why a node with these settings cannot join."""
    settings = ServerSettings(recordings=folder / "recordings", **options)
    with pytest.raises(RobotouilleError) as error:
        async with joined(settings):
            pass
    return str(error.value)


class TestSettings:
    @pytest.mark.parametrize(
        ("options", "text"),
        [
            ({"cluster": "http://localhost"}, "is not nats://"),
            ({"cluster": "nats://"}, "is not nats://"),
            ({"cluster": "nats://localhost:99999"}, "is not nats://"),
            ({"cluster": ","}, "no address"),
            ({"cluster": "nats://ann:secret@localhost"}, "--cluster-password-file"),
            ({"cluster": "nats://ann@a,nats://bob@b"}, "the same user"),
            ({"cluster": "nats://localhost", "workers": 2}, "--workers 1"),
            ({"cluster": "nats://localhost", "record": False}, "needs recordings"),
        ],
    )
    async def test_invalid_settings_are_named(
        self, tmp_path: Path, options: dict[str, Any], text: str
    ) -> None:
        assert text in await refusal(tmp_path, **options)


@real
@pytest.mark.slow
@pytest.mark.process
class TestServers:
    async def test_nobody_listens(self, tmp_path: Path) -> None:
        text = await refusal(tmp_path, cluster="nats://127.0.0.1:1")
        assert "cannot connect to NATS at nats://127.0.0.1:1" in text

    async def test_nats_without_jetstream(self, tmp_path: Path) -> None:
        with nats_cluster(tmp_path / "nats", 1, ["jetstream: disabled"]) as nats:
            text = await refusal(tmp_path, cluster=nats.url(0))
        assert "has no JetStream" in text

    async def test_wrong_password(self, tmp_path: Path) -> None:
        password = tmp_path / "password"
        password.write_text("wrong\n")
        password.chmod(0o600)
        users = ["authorization {user: ann, password: right}"]
        with nats_cluster(tmp_path / "nats", 1, users) as nats:
            url = nats.url(0).replace("//", "//ann@")
            text = await refusal(tmp_path, cluster=url, cluster_password_file=password)
            assert "uthorization" in text
            assert "wrong" not in text
            password.write_text("right\n")
            folder = tmp_path / "recordings"
            settings = ServerSettings(
                cluster=url, cluster_password_file=password, recordings=folder
            )
            async with joined(settings):
                pass
