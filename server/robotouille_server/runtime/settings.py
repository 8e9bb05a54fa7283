"""Settings of the server, read from flags, environment variables and a TOML file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr, field_validator
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from robotouille.domain.task import Timing
from robotouille.episode.lifecycle import Absence
from robotouille.episode.rules import (
    Clock,
    Countdown,
    Grace,
    MaxSteps,
    MoveBudget,
    Rules,
    SightDistance,
    StepRate,
    Substitute,
    Thinking,
)

MAX_CONFIG_BYTES = 1024 * 1024
PREFIX = "ROBOTOUILLE_"
"""Beginning of the names of environment variables."""


class ServerSettings(BaseSettings):
    """Settings of a server.

    Arguments (flags) take precedence over environment variables, which take precedence over the
    file named by `config`.

    Raises:
        ValueError: A setting is unknown or has an invalid value.
        FileNotFoundError: The file named by `config` does not exist.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="forbid", allow_inf_nan=False)

    config: Path | None = Field(None, description="TOML file to read settings from.")
    host: str = Field(
        "127.0.0.1",
        description="Address to listen on; 0.0.0.0 listens on all interfaces, :: also with IPv6.",
    )
    port: Annotated[int, Field(ge=0, le=65535)] = Field(
        8765, description="TCP port to listen on; 0 picks a free port."
    )
    mode: Clock = Field(
        Clock.LOCKSTEP, description="Clock of an episode: turn, lockstep or realtime."
    )
    step_rate: StepRate = Field(5.0, description="Steps per second of the realtime clock.")
    move_budget: MoveBudget | None = Field(
        None,
        description="Seconds a seat may take for a move before the step is taken without it; "
        "0 removes the limit. Default: 300 with several seats, no limit with one.",
    )
    thinking: Thinking = Field(
        "wall",
        description="How the realtime clock measures thinking time: wall (elapsed time) or "
        "declared (by the client).",
    )
    timing: Timing | None = Field(
        None,
        description="Timing profile: benchmark or people. Default: people with the realtime "
        "clock, otherwise benchmark.",
    )
    task: str = Field(
        "multi_agent/01_lettuce_burger",
        description="Task name or problem file of the first episode, which the server opens "
        "at startup.",
    )
    tasks: Path | None = Field(
        None,
        description="Folder of your own problem files and their pictures. Clients can open "
        "these tasks by name.",
    )
    seats: Annotated[int, Field(ge=1, le=16)] | None = Field(
        None, description="Number of seats, for tasks that allow several."
    )
    seed: Annotated[int, Field(ge=0, le=2**53)] = Field(
        0, description="Random seed. It chooses the objects that a problem file leaves open."
    )
    max_steps: MaxSteps = Field(
        500,
        description="Maximum number of steps of an episode. If unset, episodes with people's "
        "timing get a limit computed from the shortest plan.",
    )
    grace: Grace = Field(
        30.0, description="Seconds for which a disconnected player's seat is kept."
    )
    countdown: Countdown = Field(
        3.0,
        description="Seconds of countdown before a realtime episode with people; 0 starts it "
        "immediately.",
    )
    absence: Absence = Field(
        Absence.WAIT,
        description="Policy for disconnected players: wait, pause, bot or end.",
    )
    substitute: Substitute = Field(
        "planner",
        description="Bot that plays for an absent player with --absence bot: planner or random.",
    )
    sight: SightDistance | None = Field(
        None,
        description="Number of tiles that players see in each direction. Default: no limit.",
    )
    sight_blocked: bool = Field(False, description="Hide from players what is behind stations.")
    recordings: Path = Field(Path("recordings"), description="Folder for recordings.")
    record: bool = Field(
        True, description="Record every episode. Without recordings, a restart ends all episodes."
    )
    min_free_space: Annotated[int, Field(ge=0)] = Field(
        256,
        description="Free space on the recordings' disk, in MiB, below which no episodes are "
        "opened; 0 removes the limit. Running episodes continue.",
    )
    state: Path | None = Field(
        None,
        description="Folder for keys, revoked tokens and the audit log. Default: the name of "
        "the recordings folder plus .state.",
    )
    keys: Path | None = Field(
        None,
        description="File with the keys that sign tokens. Default: keys.json in the state folder.",
    )
    signing_keys: SecretStr | None = Field(
        None,
        description="Signing keys as NAME:BASE64URL,… instead of a key file. The first key signs.",
    )
    require_token: bool = Field(
        False,
        description="Refuse connections without a role token, including connections from this "
        "machine.",
    )
    resume_hours: Annotated[float, Field(gt=0)] = Field(
        24.0, description="Hours for which a resume token is valid."
    )
    recovery_seconds: Annotated[float, Field(ge=0)] = Field(
        10.0, description="Seconds for which episodes wait for their players after a restart."
    )
    drain_seconds: Annotated[float, Field(ge=0)] = Field(
        10.0, description="Seconds that running episodes have to finish after SIGTERM."
    )
    tls_cert: Path | None = Field(None, description="TLS certificate chain (PEM). Turns on TLS.")
    tls_key: Path | None = Field(None, description="Private key of the TLS certificate (PEM).")
    origins: str = Field(
        "",
        description="Comma-separated origins of web pages that may connect, such as "
        "https://example.org.",
    )
    page: bool = Field(True, description="Serve the page on which people play in a browser.")
    page_names: str = Field(
        "",
        description="Comma-separated host names of the page, such as those of a proxy and of the "
        "nodes of a cluster. Addresses, localhost and the certificate's name need no entry.",
    )
    page_parents: str = Field(
        "",
        description="Comma-separated origins of web pages that may show the page in a frame, such "
        "as https://lab.example.org.",
    )
    page_consent: str = Field(
        "",
        max_length=500,
        description="Address of the information about a study. People must agree to it before they "
        "play in a browser, and the recording has a note of it.",
    )
    trust_proxy: str = Field(
        "",
        description="Comma-separated proxies whose X-Forwarded-For header is trusted: "
        "addresses, networks, loopback or private.",
    )
    metrics_from: str = Field(
        "",
        description="Comma-separated addresses or networks that may read /metrics in addition "
        "to this machine; private means all private networks.",
    )
    record_addresses: bool = Field(
        False,
        description="Write participants' IP addresses to the log and show them on the "
        "operator page.",
    )
    workers: Annotated[int, Field(ge=1, le=23)] = Field(
        1, description="Number of worker processes. Each worker also listens on a port of its own."
    )
    worker_url: str = Field(
        "", description="Public URL of a worker behind a proxy, such as wss://HOST/w{worker}."
    )
    cluster: str = Field(
        "",
        description="NATS servers that connect this server with others to a cluster, as "
        "nats://[USER@]HOST[:PORT],… or tls://….",
    )
    cluster_name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = Field(
        "robotouille",
        description="Name of the cluster, so that several clusters can share the NATS servers.",
    )
    cluster_url: str = Field(
        "",
        description="Address at which clients reach this node, such as wss://HOST. Default: the "
        "certificate's or the machine's name and the port.",
    )
    cluster_key: Path | None = Field(
        None,
        description="File with 32 bytes, the same on all nodes, that encrypts the signing keys in "
        "NATS.",
    )
    cluster_ca: Path | None = Field(
        None,
        description="Certificate authority of the NATS servers (PEM). Default: the system's "
        "authorities.",
    )
    cluster_credentials: Path | None = Field(
        None, description="Credentials file for NATS, as nsc makes it."
    )
    cluster_password_file: Path | None = Field(
        None, description="File with the password of the NATS user."
    )
    operator: bool = Field(True, description="Serve the operator page and API.")
    operator_host: str = Field("127.0.0.1", description="Address of the operator page.")
    operator_names: str = Field(
        "", description="Comma-separated host names that browsers may use for the operator page."
    )
    operator_port: Annotated[int, Field(ge=0, le=65535)] | None = Field(
        None,
        description="Port of the operator page. Default: the first port after the server's "
        "and the workers' ports.",
    )
    mqtt: str = Field(
        "",
        description="MQTT broker for live data and commands, as mqtt://[USER@]HOST[:PORT] or "
        "mqtts://….",
    )
    mqtt_name: str = Field(
        "", description="Name of this server in MQTT topics. Default: host name and port."
    )
    mqtt_ca: Path | None = Field(
        None,
        description="Certificate authority of the MQTT broker (PEM). Default: the system's "
        "authorities.",
    )
    mqtt_password_file: Path | None = Field(
        None, description="File with the password for the MQTT broker."
    )
    mqtt_password: SecretStr | None = Field(None, description="Password for the MQTT broker.")
    max_episodes: Annotated[int, Field(ge=1)] = Field(
        2000, description="Maximum number of episodes that have not ended."
    )
    max_connections: Annotated[int, Field(ge=1)] = Field(
        20_000, description="Maximum number of connections."
    )
    max_connections_per_address: Annotated[int, Field(ge=1)] = Field(
        64,
        description="Maximum number of connections per IP address, or per token subject. "
        "Connections from this machine are not limited.",
    )
    max_episodes_per_owner: Annotated[int, Field(ge=1)] = Field(
        50, description="Maximum number of open episodes per token subject."
    )
    max_reserved_per_owner: Annotated[int, Field(ge=1)] = Field(
        1000,
        description="Maximum number of episodes per token subject that are kept open with "
        "open_for and wait for their first player. They do not count towards "
        "max_episodes_per_owner.",
    )
    max_spectators: Annotated[int, Field(ge=0)] = Field(
        200, description="Maximum number of spectators per episode."
    )
    hello_seconds: Annotated[float, Field(gt=0)] = Field(
        10.0, description="Seconds within which a new connection must send hello."
    )
    stall_seconds: Annotated[float, Field(gt=0)] = Field(
        15.0,
        description="Seconds after which a client that does not read its messages is disconnected.",
    )
    messages_per_second: Annotated[float, Field(gt=0)] = Field(
        200.0,
        description="Sustained messages per second and connection. Bursts may be twice as large.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="Lowest severity of log lines to print: debug, info, warning or error."
    )
    log_format: Literal["console", "json"] = Field(
        "console", description="Format of log lines: console or json."
    )

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Return the sources of settings, highest precedence first. Called by pydantic."""
        variables = {name.lower() for name in os.environ}
        # Looking for each setting would take half of the time in which a server starts.
        named = any(f"{PREFIX.lower()}{setting}" in variables for setting in cls.model_fields)
        sources = [init_settings, env_settings] if named else [init_settings]
        file = next((given["config"] for each in sources if "config" in (given := each())), None)
        if file:
            if not Path(file).is_file():
                found = "is a folder" if Path(file).is_dir() else "does not exist"
                raise FileNotFoundError(f"{file} {found}; config must name a TOML file")
            if Path(file).stat().st_size > MAX_CONFIG_BYTES:
                raise ValueError(f"{file} is larger than 1 MiB; it may be the wrong file")
            sources.append(TomlConfigSettingsSource(settings_cls, Path(file)))
        return tuple(sources)

    @field_validator("*", mode="before")
    @classmethod
    def _has_no_null(cls, value: object) -> object:
        if isinstance(value, str) and "\0" in value:
            raise ValueError("a setting must not contain a null character")
        return value

    @field_validator("host", "operator_host")
    @classmethod
    def _is_host(cls, value: str) -> str:
        # asyncio would listen on all interfaces for an empty name.
        try:
            if value and value.encode("idna"):
                return value
        except UnicodeError:
            pass
        raise ValueError("not a host name or an address, such as 127.0.0.1")

    @field_validator("recordings", "keys")
    @classmethod
    def _has_name(cls, value: Path | None) -> Path | None:
        # Names of other files are derived from these.
        if value is not None and value.name in ("", ".."):
            raise ValueError("the path must end with a name")
        return value

    def rules(self) -> Rules:
        """Return the default rules of an episode.

        The move budget is missing because it also depends on the number of seats.
        """
        return Rules(
            clock=self.mode,
            step_rate=self.step_rate,
            max_steps=self.max_steps,
            thinking=self.thinking,
            grace=self.grace,
            countdown=self.countdown,
            absence=self.absence,
            substitute=self.substitute,
            sight=self.sight,
            sight_blocked=self.sight_blocked,
        )

    @property
    def state_folder(self) -> Path:
        """Folder for keys, revoked tokens and the audit log. Only the server may read it."""
        return self.state or self.recordings.with_name(f"{self.recordings.name}.state")

    @property
    def reserved_bytes(self) -> int:
        """Bytes on the recordings' disk that are left to running episodes."""
        return self.min_free_space * 1024 * 1024

    @property
    def is_local(self) -> bool:
        """True if the server listens on a loopback address only."""
        return self.host in ("127.0.0.1", "localhost", "::1")

    def timing_for(self, clock: Clock) -> Timing:
        """Return the timing profile that is set, or the default for a clock."""
        if self.timing is not None:
            return self.timing
        return Timing.PEOPLE if clock is Clock.REALTIME else Timing.BENCHMARK
