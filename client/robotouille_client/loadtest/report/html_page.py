"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

from html import escape
from importlib.util import find_spec
from string import Template

from robotouille.errors import MissingExtraError
from robotouille_client.loadtest.report.plots import Plot, plots
from robotouille_client.loadtest.report.report import DURATIONS, LoadReport
from robotouille_client.loadtest.report.terminal_summary import facts, milliseconds

__all__ = ["need_matplotlib", "render_page"]

COLUMNS = ("p50", "p90", "p99", "p99.9", "p99.99", "max")

PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Load test of $server</title>
<style>
:root { color-scheme: light; --ink: #0f172a; --soft: #64748b; --line: #e2e8f0; }
* { box-sizing: border-box; }
body { margin: 0; background: #f8fafc; color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 32px 24px 64px; }
h1 { font-size: 26px; line-height: 1.2; margin: 0; }
h2 { font-size: 17px; margin: 36px 0 12px; }
.when { color: var(--soft); margin: 4px 0 24px; }
.cards { display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); }
.card, figure, .table { background: #fff; border: 1px solid var(--line); border-radius: 10px; }
.card { padding: 14px 16px; }
.card b { display: block; font-size: 24px; font-weight: 650; line-height: 1.25; }
.card span { color: var(--soft); font-size: 13px; }
.notes { background: #fffbeb; border: 1px solid #fde68a; border-radius: 10px; margin: 20px 0 0;
  padding: 12px 16px 12px 34px; }
.table { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 8px 16px; text-align: left; border-top: 1px solid var(--line); }
thead th { border-top: 0; color: var(--soft); font-weight: 500; font-size: 13px; }
.numbers td, .numbers thead th:not(:first-child) { text-align: right; white-space: nowrap; }
.numbers tbody th { font-weight: 400; }
.facts th { color: var(--soft); font-weight: 500; vertical-align: top; white-space: nowrap; }
.facts tr:first-child th, .facts tr:first-child td { border-top: 0; }
.plots { display: grid; gap: 16px; grid-template-columns: repeat(auto-fit, minmax(420px, 1fr)); }
figure { margin: 0; padding: 14px 16px 8px; }
figure.wide { grid-column: 1 / -1; }
figcaption { font-weight: 600; font-size: 14px; margin-bottom: 6px; }
svg { display: block; width: 100%; height: auto; }
svg text { font-family: inherit !important; }
footer { color: var(--soft); font-size: 13px; margin-top: 36px; max-width: 75ch; }
@media (max-width: 500px) { .plots { grid-template-columns: 1fr; } }
</style>
</head>
<body>
<main>
<h1>Load test of $server</h1>
<p class="when">$when · $url · $machine</p>
<div class="cards">$cards</div>
$notes
<h2>Milliseconds</h2>
<div class="table"><table class="numbers">
<thead><tr><th>what</th>$columns<th>count</th></tr></thead>
<tbody>$durations</tbody>
</table></div>
<h2>Plots</h2>
<div class="plots">$plots</div>
<h2>Figures</h2>
<div class="table"><table class="facts"><tbody>$facts</tbody></table></div>
<footer>
<p>Durations begin when something was due by an absolute schedule, not when it could be sent, so
that a server that stands still is not measured less often. In real time the wait for the step is
left out: an action is compared with the first step that was due after it, so one that comes too
late for that step costs a whole period. When steps are due is estimated from the earliest
arrival in each episode; ages are relative to it. The shaded part of a plot is the ramp.</p>
</footer>
</main>
</body>
</html>
""")


def need_matplotlib() -> None:
    """MissingExtraError where the plots cannot be drawn."""
    if find_spec("matplotlib") is None:
        raise MissingExtraError("--html", "load")


def render_page(report: LoadReport) -> str:
    """The page's HTML."""
    figures = report.figures
    machine = figures["machine"]
    return PAGE.substitute(
        server=escape(figures["server"] or "a server"),
        when=escape(figures["when"]),
        url=escape(report.plan.url),
        machine=escape(
            f"{machine['cores']} cores, {machine['system']}, Python {machine['python']}"
        ),
        cards="".join(_card(name, value) for name, value in _cards(report)),
        notes=_notes(report.notes),
        columns="".join(f"<th>{column}</th>" for column in COLUMNS),
        durations=_durations(report),
        plots="".join(_figure(plot) for plot in plots(report)),
        facts="".join(
            f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in facts(report)
        ),
    )


def _cards(report: LoadReport) -> list[tuple[str, str]]:
    figures, cards = report.figures, []
    steps, durations = figures["steps"], figures["durations"]
    cards.append(("rooms played", f"{figures['rooms playing']:,}"))
    if steps["rate held"] is not None:
        cards.append(("of the nominal rate", f"{steps['rate held']:.1%}"))
    server = steps.get("by the server")
    if server and server["within"].get("0.05") is not None:
        cards.append(("of steps less than 50 ms late", f"{server['within']['0.05']:.2%}"))
    for name in ("action, lockstep", "action, realtime", "action, turn"):
        if name in durations:
            value = f"{milliseconds(durations[name]['p99'])} ms"
            cards.append((f"{name.removeprefix('action, ')}: action to delta, 99 %", value))
    if storm := figures["storm"]:
        over = storm["over after"]
        cards.append(("storm over after", f"{over:.2f} s" if over is not None else "not over"))
    if process := figures["server process"]:
        cards.append(("cores used by the server", f"{process['cores used']:.2f}"))
        cards.append(("its memory", f"{process['memory'] / 2**20:,.0f} MiB"))
    return cards


def _card(name: str, value: str) -> str:
    return f'<div class="card"><b>{escape(value)}</b><span>{escape(name)}</span></div>'


def _notes(notes: list[str]) -> str:
    if not notes:
        return ""
    return f'<ul class="notes">{"".join(f"<li>{escape(note)}</li>" for note in notes)}</ul>'


def _durations(report: LoadReport) -> str:
    rows = []
    for name, title in DURATIONS.items():
        row = report.figures["durations"].get(name)
        if row is None:
            continue
        cells = "".join(f"<td>{milliseconds(row[column])}</td>" for column in COLUMNS)
        rows.append(f"<tr><th>{escape(title)}</th>{cells}<td>{row['count']:,}</td></tr>")
    return "".join(rows)


def _figure(plot: Plot) -> str:
    kind = ' class="wide"' if plot.wide else ""
    return f"<figure{kind}><figcaption>{escape(plot.caption)}</figcaption>{plot.svg}</figure>"
