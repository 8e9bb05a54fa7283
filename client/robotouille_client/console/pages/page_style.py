"""The style of the report's page: readable on a phone and a desktop, by day and by night."""

from __future__ import annotations

from robotouille_client.console.pages.drawing import FAINT, INK, SOFT

__all__ = ["STYLE"]

STYLE = f"""
:root {{ color-scheme: light dark; --ink: {INK}; --soft: #475569; --faint: {FAINT};
  --back: #f8fafc; --card: #fff; --line: #e2e8f0; --link: #1d4ed8; --good: #047857; --bad: #b91c1c;
  --mark: #fef3c7; --mark-ink: #92400e; }}
@media (prefers-color-scheme: dark) {{ :root {{ --ink: #e2e8f0; --soft: #94a3b8; --faint: #475569;
  --back: #0b1120; --card: #111a2e; --line: #243049; --link: #93c5fd; --good: #34d399;
  --bad: #f87171; --mark: #3f2f0b; --mark-ink: #fcd34d; }} }}
* {{ box-sizing: border-box; }}
html {{ scroll-behavior: smooth; }}
body {{ margin: 0; background: var(--back); color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }}
main {{ max-width: 1080px; margin: 0 auto; padding: 36px 20px 64px; }}
h1 {{ font-size: 28px; line-height: 1.2; margin: 0; letter-spacing: -0.01em; }}
h2 {{ font-size: 20px; margin: 44px 0 12px; }}
h3 {{ font-size: 16px; margin: 28px 0 6px; }}
a {{ color: var(--link); }}
.about, .hint, footer, figcaption, small {{ color: var(--soft); }}
.about {{ margin: 6px 0 14px; overflow-wrap: anywhere; }}
.hint {{ margin: 0 0 10px; font-size: 14px; max-width: 78ch; }}
nav {{ display: flex; flex-wrap: wrap; gap: 6px 18px; margin-bottom: 20px; }}
.cards {{ display: grid; gap: 12px; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); }}
.card, figure, .table, details {{ background: var(--card); border: 1px solid var(--line);
  border-radius: 10px; }}
.card {{ padding: 12px 16px; }}
.card b {{ display: block; font-size: 24px; font-weight: 650; line-height: 1.3; }}
.card span {{ color: var(--soft); font-size: 13px; overflow-wrap: anywhere; }}
.notes {{ background: var(--mark); color: var(--mark-ink); border-radius: 10px; margin: 16px 0 0;
  padding: 10px 16px 10px 34px; overflow-wrap: anywhere; }}
figure {{ margin: 0 0 16px; padding: 16px; overflow: hidden; }}
figcaption {{ font-size: 13.5px; margin-top: 8px; max-width: 90ch; }}
figure > div {{ overflow-x: auto; }}
svg {{ display: block; max-width: 100%; height: auto; margin: 0 auto; }}
svg * {{ stroke-linejoin: round; }}
svg text {{ fill: var(--ink); font-family: inherit; }}
svg [stroke="{INK}"] {{ stroke: var(--ink); }}
svg [fill="{INK}"] {{ fill: var(--ink); }}
svg [stroke="{FAINT}"] {{ stroke: var(--faint); }}
svg [stroke="{SOFT}"] {{ stroke: var(--soft); }}
svg [stroke="#ffffff"] {{ stroke: var(--card); }}
svg [id*="axes"] > [id*="patch"]:first-child [fill="#ffffff"], svg [id*="legend"] [fill="#ffffff"],
svg path[fill="#ffffff"] {{ fill: none; }}
.table {{ overflow-x: auto; }}
table {{ border-collapse: collapse; width: 100%; font-size: 14px;
  font-variant-numeric: tabular-nums; }}
th, td {{ padding: 7px 12px; text-align: right; border-top: 1px solid var(--line);
  vertical-align: top; }}
thead th {{ border-top: 0; color: var(--soft); font-weight: 500; font-size: 13px;
  vertical-align: bottom; }}
tbody td {{ white-space: nowrap; }}
th:first-child {{ text-align: left; position: sticky; left: 0; background: var(--card);
  min-width: 190px; max-width: 320px; overflow-wrap: break-word; }}
.text {{ text-align: left; }}
tbody th {{ font-weight: 450; }}
.reference th, .reference td {{ color: var(--soft); font-style: italic; }}
.mark {{ background: var(--mark); color: var(--mark-ink); border-radius: 5px; padding: 0 6px;
  font-size: 11.5px; font-style: normal; white-space: nowrap; }}
.won {{ color: var(--good); }}
.lost {{ color: var(--bad); }}
details {{ margin: 8px 0; content-visibility: auto; contain-intrinsic-size: auto 44px; }}
summary {{ cursor: pointer; padding: 10px 14px; overflow-wrap: anywhere; }}
summary small {{ margin-left: 6px; }}
.inner {{ padding: 0 12px 8px; }}
details .table, details figure {{ border-width: 1px 0 0; border-radius: 0; margin: 0; }}
code {{ font: 12.5px/1.5 ui-monospace, "DejaVu Sans Mono", monospace; }}
footer {{ font-size: 13px; margin-top: 40px; }}
@media (max-width: 560px) {{ main {{ padding: 22px 12px 48px; }} h1 {{ font-size: 23px; }}
  figure {{ padding: 10px; }} svg.wide {{ min-width: 540px; max-width: none; }}
  th, td {{ padding: 6px 8px; }}
  th:first-child {{ min-width: 104px; max-width: 150px; }}
  .cards {{ grid-template-columns: 1fr 1fr; }} }}
@media print {{ .table {{ overflow: visible; }} }}
"""
