"""to_csv.py keeps the frequency response functions of universal files and of text."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(SCRIPTS))

from responses import measured_by, quantity_of_unit  # noqa: E402

F = 2.0 + 0.5 * np.arange(7)
H = np.array([1 + 2j, -3e-5 + 4j, 5 - 6e3j, -7j, 8, 9 + 1j, -1 - 1j])
G = np.array([0.5, 0.75, 1, 0.25, 0.125, 0.875, 1])
#: Function types, and specific data types of the axes.
FRF, AUTO_SPECTRUM, COHERENCE, TIME_RESPONSE = 4, 2, 6, 1
DISPLACEMENT, VELOCITY, ACCELERATION, FORCE, TIME, FREQUENCY = 8, 11, 12, 13, 17, 18


def data_set(values, kind=FRF, response=(5, 3), reference=(1, 3), axes=(ACCELERATION, FORCE),
             labels=("m/s^2", "N"), single=True, even=True, entity="beam", id1="tip",
             abscissa=(FREQUENCY, "Hz")):
    """Returns a data set 58 as text, by the columns of its definition."""
    is_complex = np.iscomplexobj(values)
    form = 2 + 2 * (not single) + (3 if is_complex and single else 2 if is_complex else 0)
    nodes = (f"{kind:5d}{0:10d}{0:5d}{0:10d} {entity:<10}{response[0]:10d}{response[1]:4d}"
             f" {'NONE':<10}{reference[0]:10d}{reference[1]:4d}")
    grid = f"{F[0] * even:13.5E}{0.5 * even:13.5E}{0.0:13.5E}"
    lines = ["    -1", "    58", id1, "NONE", "26-Nov-26 02:00:00", "NONE", "NONE", nodes,
             f"{form:10d}{len(values):10d}{int(even):10d}{grid}"]
    for axis, label in ((abscissa[0], abscissa[1]), (axes[0], labels[0]), (axes[1], labels[1]),
                        (0, "NONE")):
        lines.append(f"{axis:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {label:<20}")
    rows = np.column_stack([*[F] * (not even), values.real, *[values.imag] * is_complex])
    if single:
        words, per_line = [f"{x:13.5E}" for x in rows.ravel()], 6
    elif even:
        words, per_line = [f"{x:20.12E}" for x in rows.ravel()], 4
    else:
        widths = [(13, 5)] + [(20, 12)] * (rows.shape[1] - 1)
        words = ["".join(f"{x:{width}.{digits}E}" for x, (width, digits) in zip(row, widths))
                 for row in rows]
        per_line = 1 if is_complex else 2
    lines += ["".join(words[k:k + per_line]) for k in range(0, len(words), per_line)]
    return "\n".join([*lines, "    -1"]) + "\n"


def convert(path, *options, status=0):
    """Runs to_csv.py; returns what it prints and its messages."""
    done = subprocess.run([sys.executable, SCRIPTS / "to_csv.py", path, *options],
                          capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout, done.stderr


def read(path):
    """Returns the lines above the header, the header and the columns of a file."""
    lines = path.read_text().splitlines()
    above = [line[2:] for line in lines if line.startswith("# ")]
    return above, lines[len(above)], np.loadtxt(lines[len(above) + 1:], delimiter=",").T


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("even", [True, False])
def test_forms_of_the_data(tmp_path, single, even):
    """Single and double precision, even and uneven frequencies: numbers, units and nodes."""
    pytest.importorskip("pyuff")
    path = tmp_path / "test.uff"
    path.write_text(data_set(H, single=single, even=even))
    out, err = convert(path)
    above, header, columns = read(tmp_path / "test.csv")
    assert err == ""
    assert out.splitlines()[1:] == [
        "   &record kind='frf', file='test.csv', quantity='accelerance' /"]
    assert "7 rows, 2 to 5 Hz, FRF beam 5+Z/node 1+Z [(m/s^2)/N], no coherence" in out
    assert header == "frequency_hz,real,imag"
    assert {"response beam 5+Z", "reference node 1+Z", "tip",
            "real, imag: accelerance [(m/s^2)/N]"} <= set(above)
    assert np.array_equal(columns[0], F)
    assert np.allclose(columns[1] + 1j * columns[2], H, rtol=1e-5 if single else 1e-11, atol=0)


@pytest.mark.parametrize("form", [0, 1])
def test_files_of_pyuff(tmp_path, form):
    """What pyuff writes, as text and as binary numbers."""
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "test.unv"
    ids = dict(id1="id", id2="NONE", id3="NONE", id4="NONE", id5="NONE")
    sets = [dict(
        ids, type=58, binary=form, func_type=FRF, func_id=0, ver_num=0, load_case_id=0,
        rsp_ent_name="plate", rsp_node=node, rsp_dir=-2, ref_ent_name="plate", ref_node=3,
        ref_dir=1, data=H * node, x=F, abscissa_spacing=1, abscissa_min=2.0, abscissa_inc=0.5,
        abscissa_spec_data_type=FREQUENCY, ordinate_spec_data_type=ACCELERATION,
        orddenom_spec_data_type=FORCE) for node in (1, 2)]
    units = dict(type=164, units_code=1, units_description="SI", temp_mode=1, length=1.0, force=1.0,
                 temp=1.0, temp_offset=0.0)
    pyuff.UFF(str(path)).write_sets([units, *sets], "overwrite")
    out, _ = convert(path)
    for node, name in ((1, "test.csv"), (2, "test_2.csv")):
        assert f"FRF plate {node}-Y/plate 3+X" in out
        assert f"&record kind='frf', file='{name}', quantity='accelerance' /" in out
        above, _, columns = read(tmp_path / name)
        assert "set 1, units: units_code 1" in above[-1] and "units_description SI" in above[-1]
        assert np.allclose(columns[1] + 1j * columns[2], H * node, rtol=1e-11)


def test_coherence_belongs_to_its_nodes(tmp_path):
    """A coherence goes to the FRF of the same nodes and directions. What has no place is named."""
    pytest.importorskip("pyuff")
    path = tmp_path / "test.uff"
    path.write_text(
        data_set(G, COHERENCE, response=(6, 3)) + data_set(H, response=(5, 3))
        + data_set(H, AUTO_SPECTRUM) + data_set(2 * H, response=(6, 3))
        + data_set(G, COHERENCE, response=(6, -3)) + data_set(G, COHERENCE, response=(5, 3),
                                                              reference=(2, 3)))
    out, err = convert(path)
    assert "sets 3, 5, 6 are left out: they are neither time series nor FRFs" in err
    assert read(tmp_path / "test.csv")[1] == "frequency_hz,real,imag"
    above, header, columns = read(tmp_path / "test_2.csv")
    assert header == "frequency_hz,real,imag,coherence"
    assert "response beam 6+Z" in above and np.allclose(columns[3], G)
    assert "FRF beam 6+Z/node 1+Z [(m/s^2)/N], with coherence" in out


def test_choice(tmp_path):
    """--channel chooses FRFs by name or number, and records beside them."""
    pytest.importorskip("pyuff")
    path, one = tmp_path / "test.uff", tmp_path / "one.csv"
    path.write_text(data_set(H) + data_set(3 * H, response=(6, 1))
                    + data_set(G, TIME_RESPONSE, abscissa=(TIME, "s")))
    for word in ("3", "FRF beam 6+X/node 1+Z", "frf beam 6+x/node 1+z [(m/s^2)/N]"):
        out, err = convert(path, "--channel", word, "--out", one)
        assert np.allclose(read(one)[2][1], 3 * H.real, rtol=1e-5) and "one.csv: 7 rows" in out
    assert "sets 1, 2 are FRFs, each written to a file of its own" in err
    out, _ = convert(path)
    assert [line.split("file=")[1].split(",")[0] for line in out.splitlines() if "file=" in line
            ] == ["'test.csv'", "'test_2.csv'", "'test_3.csv'"]
    assert read(tmp_path / "test.csv")[1] == "t [s],beam 5+Z [m/s^2]"


@pytest.mark.parametrize("axes, labels, quantity, unit", [
    ((ACCELERATION, FORCE), ("g", "N"), "accelerance", "g/N"),
    ((VELOCITY, FORCE), ("NONE", "NONE"), "mobility", ""),
    ((DISPLACEMENT, FORCE), ("mm", "N"), "receptance", "mm/N"),
    ((ACCELERATION, FORCE), ("(m/s^2)/N", "NONE"), "accelerance", "(m/s^2)/N"),
    ((0, 0), ("m/s", "N"), "mobility", "(m/s)/N"),
    ((0, 0), ("NONE", "NONE"), "", ""),
    ((0, 0), ("g", "NONE"), "", "g/?"),
    ((ACCELERATION, FORCE), ("g", "NONE"), "accelerance", "g/?"),
    ((0, FORCE), ("m", "N"), "receptance", "m/N"),
    ((ACCELERATION, ACCELERATION), ("g", "g"), "", "g/g")])
def test_quantity(tmp_path, axes, labels, quantity, unit):
    """The quantity follows from the types of the axes, or from their units."""
    pytest.importorskip("pyuff")
    path = tmp_path / "test.uff"
    path.write_text(data_set(H, axes=axes, labels=labels))
    out, _ = convert(path)
    stated = f"quantity='{quantity}'" if quantity else "quantity=..."
    assert f"file='test.csv', {stated} /" in out
    assert f"real, imag: {quantity or 'unknown quantity'} [{unit or 'unknown unit'}]" in read(
        tmp_path / "test.csv")[0]


def test_units_of_the_file(tmp_path):
    """Axes without a unit have that of the data set 164 before them."""
    pytest.importorskip("pyuff")
    path = tmp_path / "test.uff"
    units = "    -1\n   164\n{:10d}{:<20}{:10d}\n" + "".join(
        f"{x:25.16E}".replace("E", "D") for x in (1.0, 1.0, 1.0)) + (
        f"\n{0.0:25.16E}\n".replace("E", "D") + "    -1\n")
    for code, axes, unit in ((1, (ACCELERATION, FORCE), "(m/s^2)/N"),
                             (10, (DISPLACEMENT, FORCE), "mm/N"),
                             (7, (VELOCITY, FORCE), "(in/s)/lbf"),
                             (9, (ACCELERATION, FORCE), "unknown unit")):
        path.write_text(units.format(code, "units", 1) + data_set(
            H, axes=axes, labels=("NONE", "NONE")))
        out = tmp_path / "out.csv"
        convert(path, "--out", out)
        assert f"[{unit}]" in "\n".join(read(out)[0]), code


def test_units():
    """Units of motions and of ratios to a force."""
    for unit, word in (("m/s^2", "acceleration"), ("m/s\u00b2", "acceleration"), ("g",
                       "acceleration"), ("mm/s/s", "acceleration"), ("in/s", "velocity"),
                       ("um", "displacement"), ("lbf", "force"), ("V", ""), ("Pa", "")):
        assert measured_by(unit) == word, unit
    for unit, word in (("(m/s^2)/N", "accelerance"), ("g / N", "accelerance"),
                       ("1/kg", "accelerance"), ("m/s/N", "mobility"), ("m/N", "receptance"),
                       ("m/V", ""), ("", "")):
        assert quantity_of_unit(unit) == word, unit


TABLES = {
    "real and imaginary part": "frequency_hz,real,imag,coherence\n10,1,2,.5\n20,3,-4,.75\n",
    "a line of units": "Frequency;Real;Imag;Coh\nHz;m/s^2/N;m/s^2/N;-\n10;1;2;0,5\n20;3;-4;0,75\n",
    "magnitude and degrees": "f [kHz]\tMag [g/N]\tPhase [deg]\tCoherence\n"
    "0.010\t2.2360679775\t63.4349488229\t.5\n.020\t5\t-53.1301023542\t.75\n",
    "decibels and radians": "Frequency (Hz),Accelerance Amplitude (dB),Accelerance Phase (rad),"
    "Accelerance Coherence\n10,6.98970004336,1.10714871779,.5\n20,13.9794000867,-.927295218,.75\n",
    "wrapped phases without a unit": "f,magnitude,phase,coherence\n10,2.2360679775,423.4349488229,"
    ".5\n20,5,-53.1301023542,.75\n"}


@pytest.mark.parametrize("kind", TABLES)
def test_tables(tmp_path, kind):
    """Tables of frequencies become the same columns."""
    path = tmp_path / "table.txt"
    path.write_text(TABLES[kind])
    out, err = convert(path)
    _, header, columns = read(tmp_path / "table.csv")
    assert err == "" and "&record kind='frf', file='table.csv', quantity=" in out
    assert header == "frequency_hz,real,imag,coherence"
    assert np.allclose(columns, [[10, 20], [1, 3], [2, -4], [0.5, 0.75]], rtol=1e-9)


def test_several_frfs_in_a_table(tmp_path):
    """Names that differ in a word belong to different FRFs."""
    path = tmp_path / "table.csv"
    path.write_text("f (Hz),Re H1,Im H1,Re H2,Im H2\n1,1,2,3,4\n2,5,6,7,8\n")
    out, _ = convert(path)
    assert "table_frf.csv: 2 rows, 1 to 2 Hz, FRF h1" in out
    assert np.array_equal(read(tmp_path / "table_frf_2.csv")[2], [[1, 2], [3, 7], [4, 8]])


def test_phases_without_a_unit(tmp_path):
    """Small phases may be degrees or radians: the script asks."""
    path = tmp_path / "table.txt"
    path.write_text("f,magnitude,phase\n10,2,1.5\n20,5,-1.2\n")
    _, err = convert(path, status=2)
    assert "expected a name such as 'phase [deg]' or 'phase [rad]'" in err


def test_spectra_are_no_frfs(tmp_path):
    """A table of times stays a record, whatever else its columns are called."""
    path = tmp_path / "table.txt"
    path.write_text("time [s],frequency [Hz],amplitude\n0,10,2\n.5,20,5\n")
    out, _ = convert(path)
    assert "with times" in out and "kind='frf'" not in out
