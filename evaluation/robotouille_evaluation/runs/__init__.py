"""Runs: agents on instances, with a row for each episode, which can be resumed after a kill."""

from robotouille_evaluation.runs.episode_runner import (
    ChosenAction,
    EpisodeRunner,
    PlainRunner,
    RecordedRunner,
    RunnerStep,
    RunnerWrapper,
)
from robotouille_evaluation.runs.execute import RunContext, play_job
from robotouille_evaluation.runs.folder import RunFolder, RunPlan
from robotouille_evaluation.runs.job_list import (
    AgentSpec,
    EpisodeJob,
    JobOptions,
    RealTime,
    plan_jobs,
)
from robotouille_evaluation.runs.text_episode import TextEpisode, TextEpisodeResult, play_team
from robotouille_evaluation.runs.workers import Workers, run_jobs

__all__ = [
    "AgentSpec",
    "ChosenAction",
    "EpisodeJob",
    "EpisodeRunner",
    "JobOptions",
    "PlainRunner",
    "RealTime",
    "RecordedRunner",
    "RunContext",
    "RunFolder",
    "RunPlan",
    "RunnerStep",
    "RunnerWrapper",
    "TextEpisode",
    "TextEpisodeResult",
    "Workers",
    "plan_jobs",
    "play_job",
    "play_team",
    "run_jobs",
]
