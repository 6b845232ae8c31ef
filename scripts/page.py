"""HTML for report.py: text, tables, pictures and the page around them, in one file."""

import base64
import html
import math
import re

from plotting import SUPERSCRIPTS

INDEPENDENT = '<span class="badge free">independent</span>'
REBUILT = '<span class="badge rebuilt">reconstructed record</span>'

STYLE = """
:root { color-scheme: light dark; --text: #1c1c1e; --soft: #5b5f66; --line: #d4d7dc;
  --back: #ffffff; --panel: #f5f6f8; --warn: #8a4b00; --warn-back: #fff6e8; --warn-line: #e69f00;
  --bad: #a11d1d; --bad-back: #fdecec;
  --free: #00664b; --free-back: #e6f5f0; --link: #00558c; }
@media (prefers-color-scheme: dark) { :root { --text: #e7e8ea; --soft: #a7acb5; --line: #3b3f46;
  --back: #17191c; --panel: #202327; --warn: #ffcf87; --warn-back: #2f2617; --warn-line: #b98116;
  --bad: #ff9d9d; --bad-back: #331a1a;
  --free: #7fdcc0; --free-back: #14302a; --link: #7cc0ee; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.5rem 1.25rem 5rem; max-width: 50rem; background: var(--back);
  color: var(--text); font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto,
  "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .5rem; }
h2 { font-size: 1.35rem; margin: 3rem 0 .6rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
h3 { font-size: 1.08rem; margin: 2.2rem 0 .4rem; }
p, ul, ol { margin: .6rem 0; } li { margin: .2rem 0; }
a { color: var(--link); }
.lead { font-size: 1.12rem; color: var(--soft); }
.badge { display: inline-block; padding: .05rem .5rem; border-radius: .8rem; font-size: .76rem;
  font-weight: 600; white-space: nowrap; border: 1px solid; }
.free { color: var(--free); background: var(--free-back); }
.rebuilt { color: var(--warn); background: var(--warn-back); }
.box { border: 1px solid var(--warn-line); border-left-width: .45rem; background: var(--warn-back);
  border-radius: .35rem; padding: .8rem 1.1rem; margin: 1.5rem 0; }
.box strong:first-child { color: var(--warn); }
.bad { border-color: var(--bad); background: var(--bad-back); }
.bad strong:first-child { color: var(--bad); }
.good { border-color: var(--free); background: var(--free-back); }
.good strong:first-child { color: var(--free); }
.bar { margin: .5rem 0; } .bar small { color: var(--soft); }
.bar div { display: flex; height: 1rem; border-radius: .25rem; overflow: hidden; }
nav ul { columns: 2; padding-left: 1.2rem; }
.scroll { overflow-x: auto; margin: .9rem 0; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .8rem; text-align: right; vertical-align: top; white-space: nowrap; }
th { font-weight: 600; } sub { line-height: 0; }
thead th { border-bottom: 1.5px solid var(--text); vertical-align: bottom; white-space: normal;
  max-width: 9rem; }
tbody { border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { padding-left: .2rem; }
.left { text-align: left; } .wrap { white-space: normal; }
tr.soft td, tr.soft th, .unit { color: var(--soft); font-weight: 400; }
pre { background: var(--panel); border-radius: .35rem; padding: .7rem .9rem; overflow-x: auto;
  font: .78rem/1.45 ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
code { font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace;
  font-size: .88em; background: var(--panel); padding: .1em .3em; border-radius: .2rem; }
figure { margin: 1.3rem 0; } figure img { display: block; width: 100%; height: auto;
  background: #fff; border: 1px solid var(--line); border-radius: .35rem; padding: .6rem; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { font-size: .88rem; color: var(--soft); margin-top: .4rem; }
summary { cursor: pointer; font-weight: 600; margin: .5rem 0; }
@media (min-width: 50rem) { pre { white-space: pre-wrap; } }
@media (max-width: 34rem) { nav ul { columns: 1; } }
@media print { :root { --text: #000; --soft: #444; --back: #fff; --panel: #f3f3f3; --line: #bbb;
    --warn: #8a4b00; --warn-back: #fff;
    --bad: #a11d1d; --bad-back: #fff; --free: #00664b; --free-back: #fff; --link: #000; }
  body { max-width: none; padding: 0; font-size: 10.5pt; } nav, details { display: none; }
  pre { white-space: pre-wrap; font-size: 7.6pt; } h2, h3 { break-after: avoid; }
  figure, tbody, tr, .box, .bar { break-inside: avoid; }
  .bar span { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""

# The structure, drawn in the colour of the text.
SKETCH = """<svg viewBox="0 0 720 190" role="img" aria-label="A beam clamped at the left, a mass
with thruster and accelerometer at its tip, and the hose: a mass on a spring and
a dashpot at the tip">
<g fill="none" stroke="currentColor" stroke-width="2">
<path d="M60 40V150M60 52l-16 14M60 72l-16 14M60 92l-16 14M60 112l-16 14M60 132l-16 14"/>
<path d="M60 95H400" stroke-width="5"/><rect x="400" y="72" width="50" height="46"/>
<path d="M425 160V126M418 137l7-11 7 11"/>
<path d="M450 82h18l6-9 10 18 10-18 10 18 10-18 10 18 6-9h20"/>
<path d="M450 110h36M486 100v20h24v-20M498 101v18M498 110h52"/>
<rect x="550" y="68" width="58" height="54" stroke-dasharray="5 4"/></g>
<g fill="currentColor" font-size="15" font-family="inherit">
<text x="150" y="80">beam: E, I, \u03c1, c<tspan dy="4" font-size="11">D</tspan></text>
<text x="412" y="100">m<tspan dy="4" font-size="11">T</tspan></text>
<text x="410" y="152" text-anchor="end">thruster: f(t)</text>
<text x="352" y="58">accelerometer</text>
<text x="494" y="64">k<tspan dy="4" font-size="11">H</tspan></text>
<text x="488" y="141">c<tspan dy="4" font-size="11">H</tspan></text>
<text x="566" y="100">m<tspan dy="4" font-size="11">H</tspan></text>
<text x="618" y="100">hose</text></g></svg>"""


def rich(text):
    """Text as HTML: m_H with its index, `code`, *stress*."""
    text = html.escape(text, quote=False)
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    text = re.sub(r"\*([^*]+)\*", r"<em>\1</em>", text)
    return re.sub(r"\b([A-Za-z])_([A-Z])\b", r"<i>\1</i><sub>\2</sub>", text)


def paragraph(*texts, badge=""):
    """A paragraph; its badge comes first."""
    return f"<p>{badge}{' ' * bool(badge)}{rich(' '.join(texts))}</p>\n"


def preformatted(text):
    """Text as the program printed it, its word INDEPENDENT in bold."""
    text = html.escape(text.strip("\n"), quote=False)
    return "<pre>" + re.sub(r"(?<!AN )\bINDEPENDENT\b", r"<b>\g<0></b>", text) + "</pre>\n"


class Summary:
    """What a part of the program printed, by blocks between empty lines."""

    def __init__(self, text):
        self.text = text
        self.blocks = re.split(r"\n[ \t]*\n", self.text)

    def block(self, start, remarks=False):
        """The block that begins so, ready for the page; of a table only the remarks below it."""
        text = next((block for block in self.blocks if block.lstrip("\n").startswith(start)), "")
        if remarks:
            text = "\n".join(text[match.start():] for match in [re.search(r"(?m)^ - ", text)]
                             if match)
        return preformatted(text) if text else ""


def unfolded(title, text):
    """Preformatted text that is shown on demand."""
    return f"<details><summary>{rich(title)}</summary>\n{preformatted(text)}</details>\n"


def picture(data, caption):
    """A PNG inside the page, and its caption."""
    text = re.sub(r"<[^>]+>", "", rich(caption)).replace('"', "&quot;")
    code = base64.b64encode(data).decode("ascii")
    return (f'<figure><img src="data:image/png;base64,{code}" alt="{text}">\n'
            f"<figcaption>{rich(caption)}</figcaption></figure>\n")


class Soft(list):
    """A row of a table that stays in the background."""


def table(header, groups, left=1):
    """A table: groups of rows of text, the first `left` columns to the left."""
    def line(row, kind):
        cells = (f'<{kind} class="left">{rich(text)}</{kind}>' if k < left else
                 f"<{kind}>{rich(text)}</{kind}>" for k, text in enumerate(row))
        look = ' class="soft"' if isinstance(row, Soft) else ""
        return f"<tr{look}>{''.join(cells)}</tr>\n"

    bodies = (f"<tbody>{''.join(line(row, 'td') for row in rows)}</tbody>\n" for rows in groups)
    return (f'<div class="scroll"><table>\n<thead>{line(header, "th")}</thead>\n'
            f"{''.join(bodies)}</table></div>\n")


def overview(rows):
    """A table of what, on which ground (HTML) and how it came out, all text."""
    body = "".join(f'<tr><td class="left wrap">{rich(what)}</td><td class="left">{ground}</td>'
                   f'<td class="left wrap">{rich(result)}</td></tr>\n'
                   for what, ground, result in rows)
    head = "".join(f'<th class="left">{text}</th>' for text in ("what", "rests on", "outcome"))
    return (f'<div class="scroll"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody>'
            "</table></div>\n")


def fixed(value, decimals):
    """A number with so many decimals and a proper minus; nothing for None."""
    if value is None:
        return ""
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "\u2212")    # no -0.0


def percent(ratio):
    """A ratio less one, in per cent."""
    return fixed(100 * (ratio - 1), 1) + "\u00a0%"


def scientific(value, decimals=2):
    """A number with its power of ten, which keeps a column of them aligned."""
    mantissa, exponent = f"{value:.{decimals}e}".split("e")
    return f"{mantissa}×10{str(int(exponent)).translate(SUPERSCRIPTS)}"


def column(values, digits=6):
    """Numbers with the same decimals, and the power of ten before which they stand, or nothing."""
    largest = max((abs(value) for value in values if value is not None), default=0) or 1
    exponent = math.floor(math.log10(largest))
    power = exponent if exponent >= 5 else 0
    texts = [fixed(value if value is None else value / 10**power,
                   max(digits - 1 - exponent + power, 0)) for value in values]
    return texts, f"10{str(power).translate(SUPERSCRIPTS)} " if power else ""


def document(title, sections):
    """The page: sections of (identifier, heading, HTML); the first has no heading."""
    links = "".join(f'<li><a href="#{name}">{rich(heading)}</a></li>'
                    for name, heading, _ in sections if heading)
    body = "".join((f'<h2 id="{name}">{rich(heading)}</h2>\n' if heading else "") + content
                   + ("" if heading else f"<nav><ul>{links}</ul></nav>\n")
                   for name, heading, content in sections)
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n"
            f"<body>\n{body}</body>\n</html>\n")
