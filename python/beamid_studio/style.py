"""The style sheet of the page: colours and tables of the report, and the layout of the steps."""
from __future__ import annotations

import page as h


def report_style() -> str:
    """Return the rules of the report for the part of the page that shows its components.

    The rules of the whole page, which stand before those of headings, and those of small screens
    and paper, which stand last, are left out.
    """
    first, last = h.STYLE.index("\nh3 {"), h.STYLE.index("@media (min-width")
    return ".report {" + h.STYLE[first:last] + "}\n"


OWN = """
body, .q-page, .nicegui-content { background: var(--back); color: var(--text); }
body { font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue",
  "Noto Sans", "Liberation Sans", Arial, sans-serif; }
.nicegui-content { padding: 0; gap: 0; }
a { color: var(--link); }
.top { position: sticky; top: 0; z-index: 20; width: 100%; background: var(--back);
  border-bottom: 1px solid var(--line); padding: 0 1.25rem; display: flex; align-items: center;
  gap: .4rem 1.5rem; flex-wrap: wrap; min-height: 3.4rem; }
.brand { font-weight: 650; font-size: 1.05rem; letter-spacing: -.01em; white-space: nowrap; }
.brand small { font-weight: 400; color: var(--soft); margin-left: .3rem; font-size: .95rem; }
.top .q-tab { text-transform: none; padding: 0 .9rem; min-height: 3.4rem; }
.top .q-tab__label { font-size: .95rem; font-weight: 550; letter-spacing: 0; }
.top .q-tab .q-badge { margin-left: .4rem; }
.what { margin-left: auto; color: var(--soft); font-size: .9rem; max-width: 26rem; overflow: hidden;
  text-overflow: ellipsis; white-space: nowrap; }
.steps { width: 100%; max-width: 92rem; margin: 0 auto; background: none; color: inherit; }
.steps > .q-panel > .q-tab-panel, .steps .q-tab-panel { padding: 1.4rem 1.25rem 4rem; }
.step { display: grid; grid-template-columns: minmax(0, 25rem) minmax(0, 1fr); gap: 1.5rem 2rem;
  width: 100%; align-items: start; }
.step.even { grid-template-columns: minmax(0, 31rem) minmax(0, 1fr); }
.inputs, .views { display: flex; flex-direction: column; gap: 1rem; min-width: 0; width: 100%; }
.panel { border: 1px solid var(--line); border-radius: .6rem; padding: 1rem 1.1rem 1.1rem;
  width: 100%; display: flex; flex-direction: column; gap: .7rem; min-width: 0; }
.panel.flat { border: 0; padding: 0; }
.title { font-weight: 620; font-size: 1rem; line-height: 1.3; }
.lead { color: var(--soft); font-size: .9rem; line-height: 1.45; margin: 0; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: .55rem .8rem; width: 100%; }
.pair > .field:has(.tell) { grid-column: 1 / -1; }
.pair > *, .panel > .q-field { min-width: 0; width: 100%; }
.field { display: flex; flex-direction: column; min-width: 0; width: 100%; gap: .2rem; }
.field .q-field { width: 100%; }
.q-field--outlined .q-field__control { border-radius: .45rem; }
.field .q-field__append .q-field__native { font-size: .85rem; min-width: 0; color: var(--soft); }
.field .q-field__append .q-field__control { padding: 0; }
.q-field .q-field .q-field__control:before, .q-field .q-field .q-field__control:after {
  border: 0 !important; }
.field .q-field__append .q-select__dropdown-icon { font-size: 1.1rem; padding: 0; }
.q-field__append .q-field__native { padding: 0; min-height: 0; }
.q-field__native, .q-field__label { color: var(--text); }
.q-field__label { color: var(--soft); }
.tell { font-size: .84rem; line-height: 1.4; border-left: 3px solid var(--warn-line);
  background: var(--warn-back); color: var(--text); border-radius: 0 .3rem .3rem 0;
  padding: .35rem .6rem; width: 100%; overflow-wrap: anywhere; }
.hint { font-size: .8rem; line-height: 1.3; color: var(--warn); }
.part { scroll-margin-top: 4rem; } .meaning-tip { font-size: .84rem; max-width: 22rem; }
.tell.error { border-color: var(--bad); background: var(--bad-back); }
.tell.note { border-color: var(--blue); background: var(--panel); }
.tell .q-btn { margin-left: .3rem; }
.facts { display: grid; grid-template-columns: auto 1fr; gap: .15rem 1rem; font-size: .9rem;
  width: 100%; font-variant-numeric: tabular-nums; }
.facts > :nth-child(odd) { color: var(--soft); }
.records { display: flex; flex-direction: column; gap: .3rem; width: 100%; }
.records .bar { gap: .2rem; } .records .q-btn { justify-content: start; }
.drops { display: grid; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr)); gap: .6rem;
  width: 100%; }
.drops .drop .q-uploader__title { font-size: .88rem; white-space: nowrap; }
.drop { width: 100%; border: 1.5px dashed var(--line); border-radius: .6rem; box-shadow: none;
  background: var(--panel); color: var(--text); max-height: none; }
.drop .q-uploader__header { background: none; color: var(--text); }
.drop .q-uploader__list, .drop .q-uploader__subtitle { display: none; }
.drop .q-uploader__header-content { padding: .55rem .9rem; }
.nicegui-column:empty, .facts:empty, .records:empty, .w-full:empty { display: none; }
.drop.q-uploader--dnd, .drop .q-uploader__dnd { outline-color: var(--link); }
.drop .q-uploader__title { font-size: .95rem; font-weight: 550; }
.chart { width: 100%; min-width: 0; }
.bar { display: flex; align-items: center; gap: .6rem; width: 100%; flex-wrap: wrap; }
.bar .title { margin-right: auto; }
.q-btn { text-transform: none; letter-spacing: 0; border-radius: .45rem; }
.q-btn-group { box-shadow: none; border: 1px solid var(--line); border-radius: .45rem; }
.drawing { width: 100%; height: auto; display: block; max-width: 60rem; }
.drawing, .modes svg { fill: none; stroke: var(--ink); stroke-width: 2; }
.drawing text { fill: var(--text); stroke: none; font-size: 14px; }
.drawing .body { fill: var(--sky); stroke: var(--blue); stroke-width: 1.5; }
.drawing .mass { fill: var(--panel); } .drawing .sensor { fill: var(--vermilion); stroke: none; }
.thin { stroke: var(--grey) !important; stroke-width: 1 !important; }
.modes { display: grid; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr));
  gap: .4rem 1.2rem; width: 100%; }
.modes figure { margin: 0; } .modes figcaption { font-size: .86rem; color: var(--soft); }
.modes svg { width: 100%; height: auto; display: block; } .modes b { color: var(--text); }
.modes .ghost { stroke: var(--grid); stroke-width: 1.2; }
.modes .mode { stroke-width: 2.6; }
.mode1 { stroke: var(--blue); } .mode2 { stroke: var(--vermilion); }
.mode3 { stroke: var(--green); } .mode4 { stroke: var(--purple); }
@media (prefers-reduced-motion: reduce) { .modes animate { display: none; } }
.choices { display: grid; grid-template-columns: auto minmax(0, 1fr) minmax(6.5rem, 9rem);
  gap: .1rem .5rem; align-items: center; width: 100%; }
.choices .head { color: var(--soft); font-size: .82rem; }
.choices .wide { grid-column: 1 / -1; }
.meaning { line-height: 1.25; } .meaning small { color: var(--soft); display: block; }
.report { width: 100%; min-width: 0; } .report figure { margin: .2rem 0 0; }
div.report th, div.report td { padding: .22rem .5rem; } div.report table { font-size: .88rem; }
.fits .refused { color: var(--bad); }
.report h3 { font-weight: 620; line-height: 1.3; } .report ul { list-style: disc; }
.report summary { display: list-item; } .report pre { box-sizing: border-box; }
.report > :first-child { margin-top: 0; } .report h3:first-child { margin-top: .4rem; }
.grid-of-figures { display: grid; gap: .6rem 1rem; width: 100%;
  grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr)); }
.caption { font-size: .88rem; color: var(--soft); }
.fits .q-tab { text-transform: none; min-height: 2.4rem; }
.report pre, pre.code { background: var(--panel); border-radius: .4rem; padding: .7rem .9rem;
  overflow-x: auto; margin: 0; width: 100%; white-space: pre-wrap;
  font: .82rem/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
.empty { color: var(--soft); padding: 4rem 1rem; text-align: center; width: 100%; }
.better { background: var(--free-back); }
.q-notification { max-width: 34rem; } .js-plotly-plot .plotly .modebar { right: 2px !important; }
@media (max-width: 1000px) { .step, .step.even { grid-template-columns: minmax(0, 1fr); }
  .what { display: none; }
  div.report th, div.report td { padding: .2rem .35rem; } div.report table { font-size: .82rem; }
  .top { padding: 0 .8rem; } .steps .q-tab-panel { padding: 1rem .8rem 3rem; } }
@media (max-width: 640px) { .brand small { display: none; } .top .q-tab { padding: 0 .55rem; } }
"""


def sheet() -> str:
    """Return the whole style sheet."""
    return (f":root {{ {h.LIGHT} }}\nbody.body--dark {{ {h.DARK} }}\n"
            "body.body--dark { color-scheme: dark; --q-primary: #3a93d2 !important; }\n"
            + OWN + report_style())
