"""HTML for report.py: text, symbols, numbers, tables, figures and the page around them.

The figures are drawn by Plotly in the browser. The page holds Plotly itself, compressed, and the
data of each figure as JSON, so that it needs no network. A colour in a figure is a variable of the
style sheet, such as `var(--blue)`, which the page resolves for light and dark screens and paper.
"""

import base64
import gzip
import html
import json
import math
import re

from plotting import SUPERSCRIPTS

INDEPENDENT = '<span class="badge free">independent</span>'
REBUILT = '<span class="badge rebuilt">reconstructed record</span>'
MOST_DIGITS = 9    # of a number with an interval
GREEK = {"gamma": "γ", "rho": "ρ", "kappa": "κ", "omega": "ω", "Delta": "Δ"}

LIGHT = """--text: #1c1c1e; --soft: #5b5f66; --line: #d4d7dc; --grid: #e6e8eb;
  --back: #ffffff; --panel: #f5f6f8; --warn: #8a4b00; --warn-back: #fff6e8; --warn-line: #e69f00;
  --bad: #a11d1d; --bad-back: #fdecec; --free: #00664b; --free-back: #e6f5f0; --link: #00558c;
  --ink: #1c1c1e; --grey: #74787f; --blue: #0072b2; --vermilion: #d55e00; --green: #009e73;
  --purple: #b0608f; --orange: #e69f00; --sky: #56b4e9; --band: rgba(86, 180, 233, .35);
  --haze: rgba(120, 126, 135, .22);"""
DARK = """--text: #e7e8ea; --soft: #a7acb5; --line: #3b3f46; --grid: #2c3036;
  --back: #17191c; --panel: #202327; --warn: #ffcf87; --warn-back: #2f2617; --warn-line: #b98116;
  --bad: #ff9d9d; --bad-back: #331a1a; --free: #7fdcc0; --free-back: #14302a; --link: #7cc0ee;
  --ink: #e7e8ea; --grey: #8d929b; --blue: #4fa8e0; --vermilion: #ff8a3d; --green: #2fc79a;
  --purple: #e0a3c6; --orange: #f0b440; --sky: #7cc4f0; --band: rgba(86, 180, 233, .28);
  --haze: rgba(160, 166, 175, .25);"""

STYLE = """
:root { color-scheme: light dark; }
:root, .paper { @LIGHT@ }
@media (prefers-color-scheme: dark) { :root { @DARK@ } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.5rem 1.25rem 5rem; max-width: 56rem; background: var(--back);
  color: var(--text); font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto,
  "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif; overflow-wrap: break-word; }
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
.box code { background: none; padding: 0; }
.box strong:first-child { color: var(--warn); } .box ul { margin-bottom: 0; }
.box ul, .box li { padding-left: 0; } .box ul { padding-left: 1.1rem; }
.bad { border-color: var(--bad); background: var(--bad-back); }
.bad strong:first-child { color: var(--bad); }
.good { border-color: var(--free); background: var(--free-back); }
.good strong:first-child { color: var(--free); }
.bars { display: grid; grid-template-columns: auto minmax(6rem, 22rem) auto; align-items: center;
  justify-content: start; gap: .35rem .8rem; margin: .8rem 0; }
.bars small { color: var(--soft); } .bars b { font-weight: 500; }
.bars div { display: flex; height: .9rem; border-radius: .25rem; overflow: hidden; }
nav ul { columns: 2; padding-left: 1.2rem; } nav li { margin: 0; padding: .1rem 0; }
.scroll { overflow-x: auto; margin: .9rem 0; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .8rem; text-align: right; vertical-align: top; white-space: nowrap; }
th { font-weight: 600; } sub, sup { line-height: 0; }
thead th { border-bottom: 1.5px solid var(--text); vertical-align: bottom; white-space: normal;
  max-width: 9rem; overflow-wrap: normal; }
tbody { border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { padding-left: .2rem; }
.left { text-align: left; } .wrap { white-space: normal; }
tr.soft td, tr.soft th, .unit { color: var(--soft); font-weight: 400; }
pre { background: var(--panel); border-radius: .35rem; padding: .7rem .9rem; overflow-x: auto;
  font: .78rem/1.45 ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace; }
code { font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, "DejaVu Sans Mono", monospace;
  font-size: .88em; background: var(--panel); padding: .1em .3em; border-radius: .2rem; }
figure { margin: 1.3rem 0; min-width: 0; }
.plot { overflow-x: auto; } .live { width: 100%; } .still { display: none; width: 100%; }
.grid { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr));
  gap: .6rem 1rem; margin: 1.3rem 0 .4rem; } .grid figure { margin: 0; }
.keys { display: flex; flex-wrap: wrap; gap: .1rem 1.2rem; font-size: .85rem; margin: 1.2rem 0 0;
  padding: 0; list-style: none; }
.keys svg { width: 1.7rem; height: .8rem; vertical-align: -.05rem; margin-right: .4rem; }
figure > svg { display: block; width: 100%; height: auto; }
figcaption { font-size: .88rem; color: var(--soft); margin-top: .3rem; }
summary { cursor: pointer; font-weight: 600; margin: .5rem 0; }
@media (min-width: 50rem) { pre { white-space: pre-wrap; } }
@media (max-width: 34rem) { body { padding: 1.5rem .9rem 3rem; } nav ul { columns: 1; }
  .bars { grid-template-columns: auto 1fr; } .bars small { grid-column: 2; margin-top: -.3rem; }
  h1 { font-size: 1.5rem; } th, td { padding: .2rem .5rem; } pre { font-size: .7rem; } }
@page { margin: 16mm 15mm; }
@media print { :root { color-scheme: light; @LIGHT@ --back: #fff; --warn-back: #fff;
    --bad-back: #fff; --free-back: #fff; --link: #000; }
  body { max-width: none; padding: 0; font-size: 10.5pt; } nav, details { display: none; }
  table { font-size: 8.5pt; } th, td { padding: .12rem .45rem; } .many td { white-space: normal; }
  h2 { margin-top: 1.6rem; } h3 { margin-top: 1.2rem; } figure, .grid { margin: .8rem 0 .4rem; }
  .live { display: none; } .still { display: block; } .scroll, .plot { overflow: visible; }
  .grid { grid-template-columns: 1fr 1fr; } .grid .still { width: 100%; }
  pre { white-space: pre-wrap; font-size: 7.6pt; } h2, h3 { break-after: avoid; }
  figure, tbody, tr, .box, pre { break-inside: avoid; }
  .bars span { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
""".replace("@LIGHT@", LIGHT).replace("@DARK@", DARK)

# Unpacks Plotly, draws every figure in the colours of the screen, and keeps a still picture of each
# figure in the colours of paper for print. A finger scrolls the page instead of zooming a figure.
SCRIPT = """
(async () => {
  const packed = document.getElementById("plotly").textContent;
  const bytes = Uint8Array.from(atob(packed), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);

  const resolve = (value, style) => typeof value === "string"
    ? value.replace(/var\\((--[a-z-]+)\\)/g, (_, name) => style.getPropertyValue(name).trim())
    : Array.isArray(value) ? value.map((item) => resolve(item, style))
    : value && typeof value === "object" ? Object.fromEntries(Object.entries(value).map(
        ([key, item]) => [key, resolve(item, style)])) : value;
  const paper = document.body.appendChild(document.createElement("span"));
  paper.className = "paper";
  const figures = [...document.querySelectorAll(".plot")].map((figure) => ({
    live: figure.querySelector(".live"), still: figure.querySelector(".still"),
    spec: JSON.parse(figure.querySelector("script").textContent) }));
  const config = { displaylogo: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };

  const draw = () => Promise.all(figures.map(({ live, spec }) => {
    const { data, layout } = resolve(spec, getComputedStyle(document.documentElement));
    if (matchMedia("(pointer: coarse)").matches) layout.dragmode = false;
    return Plotly.react(live, data, layout, config);
  }));
  const root = document.documentElement;
  // Plotly's own resizing leaves a legend that has got fewer rows inside the plotted area.
  const fit = async () => {
    const width = innerWidth;
    for (const { live } of figures) if (live.offsetWidth) await Plotly.Plots.resize(live);
    await draw();
    root.dataset.width = width;
  };
  await draw();
  root.dataset.width = innerWidth;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  let timer;
  addEventListener("resize", () => {
    clearTimeout(timer);
    if (Number(root.dataset.width) !== innerWidth) timer = setTimeout(fit, 200);
  });
  for (const { live, still, spec } of figures) {
    const small = live.closest(".grid");
    const { data, layout } = resolve(spec, getComputedStyle(paper));
    still.src = await Plotly.toImage({ data, layout }, { format: "svg",
      width: small ? 400 : Math.max(780, parseInt(live.style.minWidth) || 0),
      height: layout.height });
  }
  root.dataset.drawn = figures.length;
})();
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


# -- text

# A symbol of a parameter: m_H, cos_1, 1/k_R, E(x), m_S.a, with an index of at most two characters.
SYMBOL = re.compile(r"(?:(?<![\w`/.])|(?<=_\w/))(1/)?"    # not in a path, but in a_h/b_h
                    r"([A-Za-z]|cos|sin|gamma|rho|kappa)_([A-Z]|\d{1,2}|(?<=[ab]_)h)\b")


def symbol(name):
    """Returns the name of a parameter as HTML, which Plotly's texts accept as well: m_H, gamma,
    E(x), 1/k_R, cos_1."""
    inverse, stem = ("1/", name[2:]) if name.startswith("1/") else ("", name)
    match = re.match(r"(\w+?)(?:_([A-Za-z0-9]+))?(?![A-Za-z0-9_])(.*)$", stem)
    if not match:
        return html.escape(name)
    letter, index, rest = match.groups()
    letter = {"frequency": "f", "damping": "ζ"}.get(letter, letter) if index else letter
    letter = GREEK.get(letter, letter)
    letter = f"<i>{letter}</i>" if len(letter) == 1 else letter
    index = f"<sub>{index}</sub>" if index else ""
    rest = re.sub(r"\((x|\d+)\)", lambda m: f"(<i>{m[1]}</i>)" if m[1] == "x" else m[0], rest)
    return inverse + letter + index + rest


def raised(unit):
    """Returns a unit with its powers raised and its factors apart: N s/m^2 becomes N·s/m²."""
    unit = re.sub(r"\^(-?\d+)", lambda match: match[1].translate(SUPERSCRIPTS), unit or "")
    ten, unit = re.fullmatch(r"(10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+ ?)?(.*)", unit.strip()).groups()
    return (ten or "") + unit.replace(" ", "·")


def _readable(text):
    """Returns a piece of text with symbols, Greek letters, raised powers and powers of ten."""
    text = html.escape(text, quote=False)
    text = re.sub(r"\*([^*\n]+)\*", r"<em>\1</em>", text)
    text = SYMBOL.sub(lambda match: symbol(match[0]), text)
    text = re.sub(r"\b(gamma|rho|Delta)\b", lambda match: f"<i>{GREEK[match[1]]}</i>", text)
    text = re.sub(r"\bE\(x\)", "<i>E</i>(<i>x</i>)", text)
    text = re.sub(r"(?<![\w/.])(?:[EJU](?![\w(=/-])|N(?= =))", r"<i>\g<0></i>", text)
    text = re.sub(r"(</sub>)\(x\)", r"\1(<i>x</i>)", text)
    text = re.sub(r"(?<=[A-Za-zµ>])\^(-?\d)\b",
                  lambda match: match[1].translate(SUPERSCRIPTS), text)
    text = re.sub(r"(?<![\w.])-(?=\.?\d)", "\u2212", text)
    return re.sub(r"(\d)E([+-]?\d+)\b", lambda match: match[1] + power_of_ten(int(match[2])), text)


def rich(text):
    """Returns text as HTML: m_H with its index, gamma as a Greek letter, m/s^2 with a raised power,
    `code`, *stress*."""
    return "".join(f"<code>{html.escape(piece, quote=False)}</code>" if k % 2 else _readable(piece)
                   for k, piece in enumerate(text.split("`")))


def shortened(text):
    """Returns a sentence of the program with at most four significant digits in each number."""
    return re.sub(r"(?<![\w.])\d+\.\d{3,}(?![\w.]*\d|E)", lambda match: f"{float(match[0]):.4g}"
                  if abs(float(match[0])) < 1000 else match[0], text)


def paragraph(*texts, badge=""):
    """Returns a paragraph; its badge comes first."""
    return f"<p>{badge}{' ' * bool(badge)}{rich(' '.join(texts))}</p>\n"


def capital(text):
    """Returns a sentence with a capital, unless it begins with a symbol."""
    return text[0].upper() + text[1:] if re.match(r"[a-z]+[\s:,]", text) else text


def box(kind, headline, points=()):
    """Returns a box with a headline and a list of points; `kind` is "good" (green), "" (amber) or
    "bad" (red)."""
    items = "".join(f"<li>{rich(capital(point))}</li>" for point in points)
    return (f'<div class="box{f" {kind}" if kind else ""}"><strong>{rich(headline)}</strong>'
            + f"<ul>{items}</ul>" * bool(items) + "</div>\n")


def preformatted(text):
    """Returns text as the program printed it, its word INDEPENDENT in bold."""
    text = html.escape(text.strip("\n"), quote=False)
    return "<pre>" + re.sub(r"(?<!AN )\bINDEPENDENT\b", r"<b>\g<0></b>", text) + "</pre>\n"


class Summary:
    """The text that a command printed, by blocks between empty lines."""

    def __init__(self, text):
        self.text = text
        self.blocks = re.split(r"\n[ \t]*\n", self.text)

    def block(self, start, remarks=False):
        """Returns the block that begins so, as HTML; of a table only the remarks below it."""
        text = next((block for block in self.blocks if block.lstrip("\n").startswith(start)), "")
        if remarks:
            text = "\n".join(text[match.start():] for match in [re.search(r"(?m)^ - ", text)]
                             if match)
        return preformatted(text) if text else ""


def unfolded(title, text):
    """Returns preformatted text that is shown on demand."""
    return f"<details><summary>{rich(title)}</summary>\n{preformatted(text)}</details>\n"


# -- numbers

def fixed(value, decimals):
    """Returns a number with so many decimals and a proper minus; nothing for None."""
    if value is None:
        return ""
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "\u2212")    # no -0.0


def percent(ratio):
    """Returns a ratio less one, in per cent."""
    return fixed(100 * (ratio - 1), 1) + "\u00a0%"


def power_of_ten(exponent):
    """Returns ×10ⁿ."""
    return f"×10{str(exponent).translate(SUPERSCRIPTS)}"


def scientific(value, decimals=2):
    """Returns a number with its power of ten, which keeps a column of them aligned."""
    mantissa, exponent = f"{value:.{decimals}e}".split("e")
    return mantissa.replace("-", "\u2212") + power_of_ten(int(exponent))


def significant(value, digits=4):
    """Returns a number with so many significant digits: 0.4156, 12.50, 1.731×10⁹."""
    if value is None or not math.isfinite(value):
        return "" if value is None else "∞" if value > 0 else "\u2212∞" if value < 0 else ""
    exponent = math.floor(math.log10(abs(value))) if value else 0
    exponent += f"{abs(value):.{digits - 1}e}"[0] == "1" and round(
        abs(value) / 10.0**exponent, digits - 1) >= 10
    if -4 <= exponent < max(digits, 5):
        return fixed(value, max(digits - 1 - exponent, 0))
    return scientific(value, digits - 1)


def column(values, digits=6):
    """Returns numbers with the same decimals, and the power of ten that they share, or nothing."""
    largest = max((abs(value) for value in values if value is not None), default=0) or 1
    exponent = math.floor(math.log10(largest))
    power = exponent if exponent >= 5 else 0
    texts = [fixed(value if value is None else value / 10**power,
                   max(digits - 1 - exponent + power, 0)) for value in values]
    return texts, f"10{str(power).translate(SUPERSCRIPTS)} " if power else ""


def common_power(values):
    """Returns the power of ten, a multiple of three, that numbers share in a table or on an axis; 0
    for numbers that need none."""
    largest = max((abs(value) for value in values if value is not None and math.isfinite(value)),
                  default=0)
    return 3 * math.floor(math.log10(largest) / 3) if largest and not 1e-3 <= largest < 1e4 else 0


def scaled_unit(power, unit):
    """Returns a unit behind the power of ten of its numbers: 10⁹ N/m²."""
    ten = f"10{str(power).translate(SUPERSCRIPTS)}" if power else ""
    return f"{ten} {raised(unit)}".strip()


def decimals_of(low, high, power=0):
    """Returns as many decimals as leave two digits of half the width of an interval; None without
    an interval."""
    if low is None or high is None or not 0 < high - low < math.inf:
        return None
    half, largest = (x / 10.0**power for x in (0.5 * (high - low), max(abs(low), abs(high))))
    most = MOST_DIGITS - 1 - math.floor(math.log10(largest))
    return max(min(1 - math.floor(math.log10(half) + 1e-9), most), 0)


def interval(low, high, decimals=None, power=0):
    """Returns an interval as text: "1.2 to 3.4", with ∞ for an end that is None."""
    if low is None and high is None:
        return "unbounded"
    def end(value, other):
        if value is None or math.isinf(value):
            return other
        value /= 10.0**power
        return significant(value) if decimals is None else fixed(value, decimals)
    return " to ".join(end(*each) for each in ((low, "\u2212∞"), (high, "∞")))


def measured(value, low, high, power=0):
    """Returns a value and its interval as texts with the decimals that the interval leaves."""
    decimals = decimals_of(low, high, power)
    if value is None:
        return "∞", interval(low, high, decimals, power)
    value /= 10.0**power
    # Without one of the ends there is no width to tell the digits.
    is_open = decimals is None and sum(x is None or math.isinf(x) for x in (low, high)) == 1
    text = significant(value, 3 if is_open else 5) if decimals is None else fixed(value, decimals)
    has_interval = low is not None or high is not None
    return text, interval(low, high, decimals, power) if has_interval else ""


# -- tables

class Soft(list):
    """A row of a table that stays in the background."""


class Raw(str):
    """A cell that is HTML already."""

    __slots__ = ()


def name_cell(name):
    """Returns a cell with the symbol of a parameter."""
    return Raw(symbol(name))


def table(header, groups, left=1, wrap=()):
    """Returns a table.

    `header` has a text for each column, `groups` has groups of rows of texts. The first `left`
    columns and those in `wrap` are aligned to the left; those in `wrap` may break into lines.
    """
    def look(k):
        names = ["left"] * (k < left or k in wrap) + ["wrap"] * (k in wrap)
        return f' class="{" ".join(names)}"' if names else ""

    def line(row, kind):
        cells = (f"<{kind}{look(k)}>{text if isinstance(text, Raw) else rich(text)}</{kind}>"
                 for k, text in enumerate(row))
        soft = ' class="soft"' if isinstance(row, Soft) else ""
        return f"<tr{soft}>{''.join(cells)}</tr>\n"

    bodies = (f"<tbody>{''.join(line(row, 'td') for row in rows)}</tbody>\n" for rows in groups)
    many = ' class="many"' if len(header) > 8 else ""
    return (f'<div class="scroll"><table{many}>\n<thead>{line(header, "th")}</thead>\n'
            f"{''.join(bodies)}</table></div>\n")


def overview(rows):
    """Returns a table of topics, each with its ground (HTML) and its outcome."""
    return table(["topic", "rests on", "outcome"],
                 [[[topic, Raw(ground), outcome] for topic, ground, outcome in rows]],
                 wrap=(0, 1, 2))


# -- figures

def plain(text):
    """Returns HTML as plain text for an attribute."""
    return html.escape(html.unescape(re.sub(r"<[^>]+>", "", text)), quote=True)


def figure(chart, caption="", name="", width=0):
    """Returns a Plotly figure and its caption.

    `name` describes the figure to readers that do not see it (default: the caption). A figure that
    would be illegible below `width` pixels scrolls in its own box.
    """
    text = plain(name or rich(caption))
    wide = f";min-width:{width}px" if width else ""
    spec = json.dumps(json.loads(chart.to_json()), separators=(",", ":"), sort_keys=True)
    spec = spec.replace("</", "<\\/")
    words = f"<figcaption>{rich(caption)}</figcaption>" if caption else ""
    return (f'<figure class="plot"><div class="live" role="img" aria-label="{text}" '
            f'style="height:{chart.layout.height}px{wide}"></div><img class="still" alt="{text}">'
            f'<script type="application/json">{spec}</script>{words}</figure>\n')


def panels(figures, caption, keys=()):
    """Returns figures side by side, with one legend above and one caption below them.

    `keys` lists (colour, mark, text); a mark is "line", "dash", "dot", "point", "square" or "area".
    """
    marks = {"line": '<path d="M0 6h24" stroke-width="2.4"/>',
             "dash": '<path d="M0 6h24" stroke-width="2" stroke-dasharray="6 4"/>',
             "dot": '<path d="M0 6h24" stroke-width="2.4" stroke-dasharray="2 3"/>',
             "point": '<circle cx="12" cy="6" r="4" fill="currentColor" stroke="none"/>',
             "square": '<path d="M8 2h8v8h-8z" fill="currentColor" stroke="none"/>',
             "area": '<path d="M0 0h24v12h-24z" fill="currentColor" stroke="none"/>'}
    legend = "".join(f'<li><svg viewBox="0 0 24 12" style="color:var(--{colour})" fill="none" '
                     f'stroke="currentColor" aria-hidden="true">{marks[mark]}</svg>'
                     f"{rich(text)}</li>"
                     for colour, mark, text in keys)
    legend = f'<ul class="keys">{legend}</ul>\n' if legend else ""
    return (f'{legend}<div class="grid">\n{"".join(figures)}</div>\n'
            f"<figure><figcaption>{rich(caption)}</figcaption></figure>\n")


def document(title, sections):
    """Returns the page: sections of (identifier, heading, HTML); the first has no heading."""
    links = "".join(f'<li><a href="#{name}">{rich(heading)}</a></li>'
                    for name, heading, _ in sections if heading)
    body = "".join((f'<h2 id="{name}">{rich(heading)}</h2>\n' if heading else "") + content
                   + ("" if heading else f"<nav><ul>{links}</ul></nav>\n")
                   for name, heading, content in sections)
    if 'class="plot"' in body:
        from plotly.offline import get_plotlyjs
        packed = base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()
        body += ('<noscript><p class="box">The figures need JavaScript, which is off here. '
                 "<code>scripts/plot_*.py</code> draw them as pictures.</p></noscript>\n"
                 f'<script type="text/plain" id="plotly">{packed}</script>\n'
                 f"<script>{SCRIPT}</script>\n")
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n"
            f"<body>\n{body}</body>\n</html>\n")
