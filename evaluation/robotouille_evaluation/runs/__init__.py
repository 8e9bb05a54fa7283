"""Runs: agents on instances, a row an episode, gone on with after a kill."""

from robotouille_evaluation.runs.execute import play_job
from robotouille_evaluation.runs.folder import RunFolder, RunPlan
from robotouille_evaluation.runs.jobs import AgentSpec, Job, RealTime, jobs
from robotouille_evaluation.runs.runner import Workers, run_jobs
from robotouille_evaluation.runs.stage import Decision, PlainStage, RecordedStage, Stage, Watch
from robotouille_evaluation.runs.team_episode import play_team
from robotouille_evaluation.runs.text_episode import TextEpisode, TextResult

__all__ = [
    "AgentSpec",
    "Decision",
    "Job",
    "PlainStage",
    "RealTime",
    "RecordedStage",
    "RunFolder",
    "RunPlan",
    "Stage",
    "TextEpisode",
    "TextResult",
    "Watch",
    "Workers",
    "jobs",
    "play_job",
    "play_team",
    "run_jobs",
]
