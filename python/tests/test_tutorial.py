"""The pages about the Python package print what they say."""
import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]


def alike(expected, found):
    """Two lines have the same words, and numbers within 0.2 % or 1.5 units of the last digit."""
    left, right = expected.split(), found.split()
    for k, word in enumerate(left):
        if word == "..." and k == len(left) - 1:
            return True
        if k >= len(right):
            return False
        numbers = [re.fullmatch(r"[-+]?(\d+\.?(\d*))(?:[eE]([-+]?\d+))?[,:]?", item)
                   for item in (word, right[k])]
        if not all(numbers):
            if word != right[k]:
                return False
            continue
        unit = 10.0**(int(numbers[0][3] or 0) - len(numbers[0][2]))
        x, y = (float(item.rstrip(",:")) for item in (word, right[k]))
        if not abs(x - y) <= max(2e-3*abs(x), 1.5*unit):
            return False
    return len(left) == len(right)


def run_page(name, monkeypatch, tmp_path, capsys):
    """Run the blocks of a page as one session. Each block prints what stands below it; '...'
    stands for any lines, or for the rest of a line. Return the variables of the session, and the
    number of lines that were compared."""
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("pandas")
    text = (CHECKOUT / "docs" / name).read_text()
    (tmp_path / "data").symlink_to(CHECKOUT / "data")
    monkeypatch.chdir(tmp_path)
    space, compared = {}, 0
    for language, block in re.findall(r"^```(python|text)\n(.*?)^```$", text, re.M | re.S):
        if language == "python":
            exec(compile(block, "python.md", "exec"), space)
            printed = capsys.readouterr().out.splitlines()
            continue
        expected = block.splitlines()
        while expected:
            line = expected.pop(0)
            if line == "...":
                while expected and printed and not alike(expected[0], printed[0]):
                    printed.pop(0)
                continue
            assert printed and alike(line, printed.pop(0)), line
            compared += 1
        assert printed == [] or block.splitlines()[-1] == "..."
    from matplotlib import pyplot
    pyplot.close("all")
    return space, compared


def test_tutorial(monkeypatch, tmp_path, capsys):
    """The tutorial prints what it says, draws its pictures, and finds the true values."""
    space, compared = run_page("tutorials/python.md", monkeypatch, tmp_path, capsys)
    assert compared > 30
    assert {"fit.png", "profiles.png"} <= {path.name for path in tmp_path.iterdir()}
    true = dict(E=2e11, m_S=0.012, c_D=4e6, gamma=0.1)
    for name, value in true.items():
        assert space["fit"][name].interval[0] < value < space["fit"][name].interval[1]


def test_how_to(monkeypatch, tmp_path, capsys):
    """The page on comparisons, responses and designs prints what it says."""
    _, compared = run_page("how-to/python.md", monkeypatch, tmp_path, capsys)
    assert compared > 15
    assert (tmp_path / "response.png").exists()
