"""beamid beside another OpenMP runtime in one process: scikit-learn from PyPI brings its own."""
import os
import subprocess
import sys
from pathlib import Path

import pytest

sklearn = pytest.importorskip("sklearn")
RUNTIMES = list(Path(sklearn.__file__).parents[1].glob("scikit_learn.libs/libgomp*"))
pytestmark = pytest.mark.skipif(not RUNTIMES, reason="scikit-learn has no own OpenMP runtime")
CASE = Path(__file__).resolve().parents[2] / "data" / "table_4_1_noisy.nml"

COMMON = """
import ctypes, sys, threading

def neighbour():
    import numpy as np
    from sklearn.cluster import KMeans
    x = np.random.default_rng(1).normal(size=(5000, 4))
    return float(KMeans(4, n_init=2, random_state=0).fit(x).inertia_)

def numbers(case):
    import beamid
    fit = beamid.load(case).fit()
    return fit.values.tolist(), beamid.bootstrap(fit).estimates.tolist()

def runtimes():
    # Files, not paths: the same library may be reached by several names.
    return {line.split()[4] for line in open("/proc/self/maps") if "libgomp" in line}
"""

ORDERS = {
    "alone": "print(numbers(CASE))",
    "scikit-learn first": "neighbour(); print(numbers(CASE))",
    "beamid first": "import beamid; neighbour(); print(numbers(CASE))",
    "by turns": "a = numbers(CASE); b = neighbour(); assert numbers(CASE) == a; "
                "assert neighbour() == b; print(a)",
    "at the same time": """
other = threading.Thread(target=lambda: [neighbour() for _ in range(5)])
other.start()
print(numbers(CASE))
other.join()""",
    # As torch does, whose symbols then come before those of libraries that are loaded later.
    "symbols in the global scope": """
for library in RUNTIMES:
    ctypes.CDLL(library, ctypes.RTLD_GLOBAL)
neighbour()
print(numbers(CASE))""",
}


def output(order):
    """Standard output of a process that uses beamid and scikit-learn in this order.

    It asserts that two runtimes are loaded unless beamid is alone; else the test would be void.
    """
    code = (f"CASE = {str(CASE)!r}\nRUNTIMES = {[str(path) for path in RUNTIMES]}\n{COMMON}\n"
            f"{ORDERS[order]}\n")
    if order != "alone":
        code += "assert len(runtimes()) == 2, runtimes()\n"
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, text=True, timeout=300,
                          capture_output=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def alone():
    return output("alone")


@pytest.mark.parametrize("order", [order for order in ORDERS if order != "alone"])
def test_numbers_do_not_depend_on_another_runtime(alone, order):
    """Estimates and 1000 fits of resampled records, to the last digit."""
    assert output(order) == alone
