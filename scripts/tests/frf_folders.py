"""Output folders with a hand-made frf.csv, as the program writes them."""

import zlib

import frequency_examples as example
import numpy as np

CASE = """&beam length=0.5, rho=0.5, E=2e11, I=1e-9 /
&excitation kind='pulse', x_F=0.1 /
&record kind='frf', file='hammer_frf.csv', quantity='{quantity}', averages={averages} /
{more}&units length='m', force='N', time='s', mass='kg' /
"""
LABELS = ("quantity,unit\nlength,m\nforce,N\ntime,s\nmass,kg\nacceleration,m/s^2\n"
          "velocity,m/s\n")
AVERAGES = 10


def fitted_rows(elements, noise=0.02, seed=3, record=None, shift=0.0):
    """Returns the columns of a fit of a two-mode FRF with noise, whose coherence is the exact one.

    shift  moves the mesh's FRF from the true one, as a share
    """
    f = np.arange(10.0, 201.0, 0.5)
    truth = example.accelerance(f)
    model = truth * (1 + shift)
    generator = np.random.default_rng(seed)
    measured = truth + noise * (generator.standard_normal(len(f))
                                + 1j * generator.standard_normal(len(f)))
    # The variance of each part is |H|^2 (1 - g)/(2 (n - 1) g).
    ratio = 2 * (AVERAGES - 1) * noise**2 / np.abs(truth)**2
    residual = measured - model
    columns = {"elements": np.full(len(f), elements), "frequency_hz": f, "real": model.real,
               "imag": model.imag, "magnitude": np.abs(model),
               "phase_deg": np.degrees(np.angle(model)), "measured_real": measured.real,
               "measured_imag": measured.imag, "residual_real": residual.real,
               "residual_imag": residual.imag, "coherence": 1 / (1 + ratio),
               "magnitude_lower95": np.abs(model) * 0.97, "magnitude_upper95": np.abs(model) * 1.03}
    return columns if record is None else {"record": np.full(len(f), record), **columns}


def only_model(columns):
    """Returns what the command frf writes: no measurement."""
    return {name: values for name, values in columns.items()
            if not name.startswith(("measured", "residual", "coherence"))}


def text_of(*tables):
    """Returns the text of frf.csv with some columns."""
    names = list(tables[0])
    rows = [row for table in tables for row in zip(*(table[name].tolist() for name in names))]
    return ",".join(names) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)


def write(folder, name, text, command):
    """Writes a file, and returns its line of the manifest."""
    (folder / name).write_text(text)
    data = text.encode()
    return f"{name} {len(data)} {zlib.crc32(data):08x} {command}\n"


def make(folder, *tables, command="frf", quantity="accelerance", more=""):
    """Writes an output folder with frf.csv from columns, and its manifest."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"frf.csv": text_of(*tables), "labels.csv": LABELS, "case.txt": CASE.format(
        quantity=quantity, averages=AVERAGES, more=more)}
    (folder / "manifest.txt").write_text("name bytes crc32 command\n" + "".join(
        write(folder, name, text, command) for name, text in texts.items()))
    return folder


def add(folder, *tables):
    """Adds frf.csv to the outputs of a fit."""
    line = write(folder, "frf.csv", text_of(*tables), "identify")
    manifest = folder / "manifest.txt"
    manifest.write_text(manifest.read_text() + line)
