"""Every setting of the server: a flag, an environment variable (`ROBOTOUILLE_…`) and a file key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from robotouille.domain.task import Timing
from robotouille.episode.rules import (
    Absence,
    Clock,
    Countdown,
    Grace,
    MaxSteps,
    MoveBudget,
    Rules,
    StandIn,
    StepRate,
    Thinking,
)

__all__ = ["ServerSettings"]


class ServerSettings(BaseSettings):
    """Flags (arguments) win over environment variables, those over the file named by `config`.

    Raises:
        ValueError: A setting is unknown or cannot have this value.
        FileNotFoundError: The file named by `config` is not there.
    """

    model_config = SettingsConfigDict(
        env_prefix="ROBOTOUILLE_", extra="forbid", allow_inf_nan=False
    )

    config: Path | None = Field(None, description="TOML file with any of these settings.")
    host: str = Field("127.0.0.1", description="Address to listen on; 0.0.0.0 for all.")
    port: Annotated[int, Field(ge=0, le=65535)] = Field(
        8765, description="TCP port; 0 takes a free one."
    )
    mode: Clock = Field(Clock.LOCKSTEP, description="Clock: turn, lockstep or realtime.")
    step_rate: StepRate = Field(5.0, description="Steps a second in real time.")
    move_budget: MoveBudget | None = Field(
        None,
        description="Seconds a seat may take for a move where steps wait for it; 0: no limit. "
        "If nothing is said, 300 with several seats and no limit with one.",
    )
    thinking: Thinking = Field(
        "wall", description="What thinking costs in real time: wall clock, or declared time."
    )
    timing: Timing | None = Field(
        None, description="Timing profile: benchmark or people; people in real time by default."
    )
    task: str = Field(
        "multi_agent/01_lettuce_burger", description="Task (name or problem file) to open first."
    )
    tasks: Path | None = Field(
        None,
        description="Folder of your own problem files, which clients open by name; with what they "
        "look like.",
    )
    seats: Annotated[int, Field(ge=1, le=16)] | None = Field(
        None, description="Number of seats, where the task leaves a choice."
    )
    seed: Annotated[int, Field(ge=0)] = Field(0, description="Seed of everything random.")
    max_steps: MaxSteps = Field(
        500,
        description="Step limit of an episode. If nothing is said, games with people's timing have "
        "one from the shortest plan.",
    )
    grace: Grace = Field(30.0, description="Seconds a lost connection keeps its seat.")
    countdown: Countdown = Field(
        3.0,
        description="Seconds from when everybody is there until a game in real time begins, if a "
        "person plays; 0: at once.",
    )
    absence: Absence = Field(
        Absence.WAIT,
        description="What happens while a participant is away: wait, pause, bot or end.",
    )
    stand_in: StandIn = Field(
        "planner", description="Which bot plays for the absent, with --absence bot."
    )
    recordings: Path = Field(Path("recordings"), description="Folder for recordings.")
    record: bool = Field(True, description="Record every episode.")
    state: Path | None = Field(
        None, description="Folder for the server's keys (default: RECORDINGS.state)."
    )
    keys: Path | None = Field(
        None, description="File of keys that sign tokens (default: STATE/keys.json)."
    )
    signing_keys: SecretStr | None = Field(
        None, description="The keys themselves, as NAME:BASE64URL,…; the first signs."
    )
    require_token: bool = Field(
        False, description="Let in only those with a token (robotouille-token)."
    )
    resume_hours: Annotated[float, Field(gt=0)] = Field(
        24.0, description="Hours for which a resume token is good."
    )
    recovery_seconds: Annotated[float, Field(ge=0)] = Field(
        10.0, description="Seconds an episode waits for its players after a restart."
    )
    drain_seconds: Annotated[float, Field(ge=0)] = Field(
        10.0, description="Seconds that running episodes have to finish after SIGTERM."
    )
    tls_cert: Path | None = Field(None, description="Certificate chain (PEM); turns on TLS.")
    tls_key: Path | None = Field(None, description="Private key of the certificate (PEM).")
    origins: str = Field(
        "", description="Web sites whose pages may connect, as https://HOST,…; none if empty."
    )
    trust_proxy: str = Field(
        "",
        description="Proxies whose X-Forwarded-For is believed: addresses, networks, loopback.",
    )
    metrics_from: str = Field(
        "",
        description="Who may read /metrics beside this machine, if no proxy is between: addresses, "
        "networks, private.",
    )
    record_addresses: bool = Field(
        False, description="Write addresses of participants to the log and the operator's view."
    )
    workers: Annotated[int, Field(ge=1, le=23)] = Field(
        1, description="Processes that share the load; each has a port of its own too."
    )
    worker_url: str = Field(
        "", description="Address of a worker behind a proxy, e.g. wss://HOST/w{worker}."
    )
    operator: bool = Field(True, description="Serve the operator's view.")
    operator_host: str = Field("127.0.0.1", description="Address of the operator's view.")
    operator_names: str = Field(
        "", description="Host names by which browsers may call the operator's view, with commas."
    )
    operator_port: Annotated[int, Field(ge=0, le=65535)] | None = Field(
        None, description="Port of the operator's view (default: the one after all others)."
    )
    mqtt: str = Field(
        "",
        description="MQTT broker that is told of episodes and may send commands, as "
        "mqtt://[USER@]HOST[:PORT] or mqtts://…; none if empty.",
    )
    mqtt_name: str = Field(
        "", description="The server's name in topics (default: its host's name and port)."
    )
    mqtt_ca: Path | None = Field(
        None, description="Certificate authority of the broker (PEM; default: the system's)."
    )
    mqtt_password_file: Path | None = Field(
        None, description="File with the password for the broker."
    )
    mqtt_password: SecretStr | None = Field(None, description="The password itself.")
    max_episodes: Annotated[int, Field(ge=1)] = Field(2000, description="Episodes at a time.")
    max_connections: Annotated[int, Field(ge=1)] = Field(
        20_000, description="Connections at a time."
    )
    max_connections_per_address: Annotated[int, Field(ge=1)] = Field(
        64,
        description="Connections at a time from one address, or with tokens of one subject (this "
        "machine: no limit).",
    )
    max_episodes_per_owner: Annotated[int, Field(ge=1)] = Field(
        50, description="Episodes at a time that one token may have opened."
    )
    max_reserved_per_owner: Annotated[int, Field(ge=1)] = Field(
        1000,
        description="… that wait for their first player, for as long as `open_for` says: they do "
        "not count among the others.",
    )
    max_spectators: Annotated[int, Field(ge=0)] = Field(200, description="Spectators an episode.")
    hello_seconds: Annotated[float, Field(gt=0)] = Field(
        10.0, description="Seconds in which a new connection must say hello."
    )
    stall_seconds: Annotated[float, Field(gt=0)] = Field(
        15.0, description="Seconds after which a client that does not read is dropped."
    )
    messages_per_second: Annotated[float, Field(gt=0)] = Field(
        200.0,
        description="Messages a second from one connection; bursts of twice that.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="Least severe log lines to print."
    )
    log_format: Literal["console", "json"] = Field("console", description="Format of log lines.")

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Where settings come from, what wins first; pydantic asks for it."""
        file = {**env_settings(), **init_settings()}.get("config")
        sources: list[PydanticBaseSettingsSource] = [init_settings, env_settings]
        if file:
            if not Path(file).is_file():
                found = "is a folder" if Path(file).is_dir() else "is not there"
                raise FileNotFoundError(f"{file} {found}; it names a TOML file")
            sources.append(TomlConfigSettingsSource(settings_cls, Path(file)))
        return tuple(sources)

    def rules(self) -> Rules:
        """The rules of an episode for which its creator asks nothing else, but for the move budget,
        which depends on its seats, too."""
        return Rules(
            clock=self.mode,
            step_rate=self.step_rate,
            max_steps=self.max_steps,
            thinking=self.thinking,
            grace=self.grace,
            countdown=self.countdown,
            absence=self.absence,
            stand_in=self.stand_in,
        )

    @property
    def state_folder(self) -> Path:
        """Where the server keeps what is nobody else's business."""
        return self.state or self.recordings.with_name(f"{self.recordings.name}.state")

    @property
    def is_local(self) -> bool:
        """Whether only programs on this machine can connect, if no proxy lets others in."""
        return self.host in ("127.0.0.1", "localhost", "::1")

    def timing_for(self, clock: Clock) -> Timing:
        """The timing profile: what is set, else people in real time and benchmark elsewhere."""
        if self.timing is not None:
            return self.timing
        return Timing.PEOPLE if clock is Clock.REALTIME else Timing.BENCHMARK
