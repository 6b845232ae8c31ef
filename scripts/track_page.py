"""The page of the command track for report.py."""

import figures as f
import numpy as np
import page as h
import plot_track

FLAGS = {"moving": ("orange", "one set of parameters does not explain the window"),
         "unseen": ("grey", "the motion is too small to determine the parameter"),
         "gap": ("purple", "too few samples")}


def followed(outputs):
    """Returns the verdict box and the sections of a followed parameter."""
    name, unit, track = plot_track.read_track(outputs.folder)
    time = outputs.units.get("time")
    clear = track["flag"] == ""
    count = len(clear)
    points = [f"{(track['flag'] == flag).sum()} windows are flagged `{flag}`: {meaning}."
              for flag, (_, meaning) in FLAGS.items() if (track["flag"] == flag).any()]
    if not clear.any():
        box = h.box("bad", f"No window determines {name}.", points)
    else:
        low, high = (h.significant(limit(track["estimate"][clear])) for limit in (min, max))
        box = h.box("good" if clear.mean() > 0.5 else "warn",
                    f"{name} is followed in {clear.sum()} of {count} windows: {low} to {high} "
                    f"{unit}".rstrip() + ".", points)
    text = h.figure(draw(name, track, unit, time), "Estimate of each window, at the middle of the "
                    "window, with its 95 % interval; below, the share of the energy that the model "
                    "does not explain.")
    return box, [("track", "The parameter in each window", text)]


def draw(name, track, unit, time):
    """Draws estimates, intervals and misfits."""
    figure = f.stacked([3, 1], f.label("middle of the window", time),
                       [f.label(h.symbol(name), unit), "unexplained"], 430)
    t = track["middle"]
    low, high = plot_track.view(track)
    f.add_band(figure, t, np.clip(np.nan_to_num(track["lower95"], nan=low), low, high),
               np.clip(np.nan_to_num(track["upper95"], nan=high, posinf=high), low, high),
               "95 % interval", row=1)
    for flag, tone in [*((flag, tone) for flag, (tone, _) in FLAGS.items()), ("", "blue")]:
        mine = track["flag"] == flag
        if mine.any():
            figure.add_scatter(x=f.numbers(t[mine]), y=f.numbers(track["estimate"][mine]),
                               name=flag or "no flag", mode="markers",
                               marker=dict(size=3, color=f.colour(tone)), row=1, col=1)
    figure.update_yaxes(row=1, range=[low, high])
    f.add_line(figure, t, track["misfit"], "unexplained share", f.colour("grey"), row=2)
    f.hide_repeated(figure)
    return figure
