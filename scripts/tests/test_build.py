"""fpm.sh repeats a build that failed because of module files that are out of date, and no other."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parent.parent
#: Stands in for fpm: counts its builds, and fails with the message as long as the object of the
#: project or the file `always` exists.
FPM = """#!/bin/bash
if [[ $1 == --version ]]; then echo 'Version:     0.12.0, alpha'; exit; fi
[[ $1 == build ]] || exit 0
echo build >>builds
[[ -e always || -e build/gfortran_B/project/src_a_b.f90.o ]] || exit 0
cat message
exit 1
"""
STALE = ["Error: Mismatch in components of derived type 'a_t' from module 'a' at (1)",
         "Fatal Error: Cannot open module file 'a.mod' for reading at (1)",
         "Error: Symbol 'x' referenced at (1) not found in module 'a'"]
OF_PROJECT = ["src_a_b.f90.o", "src_a_b.f90.o.digest", "src_a_b.f90.o.log"]
OF_OTHERS = ["external_c.f90.o", "external_c.f90.o.log"]


@pytest.fixture
def checkout(tmp_path):
    """A checkout whose build folders hold objects of two profiles and of a dependency."""
    for folder in ("src/a", "app", "test", "example", "bin"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "src/a/b.f90").write_text("module Beam_a\nend module Beam_a\n")
    (tmp_path / "bin/fpm").write_text(FPM)
    (tmp_path / "bin/fpm").chmod(0o755)
    for age, profile in enumerate(("B", "A")):
        objects = tmp_path / f"build/gfortran_{profile}/project"
        objects.mkdir(parents=True)
        for name in [*OF_PROJECT, *OF_OTHERS, "../beam_a.mod", "../c.mod"]:
            (objects / name).write_text("")
            os.utime(objects / name, (10**9 - age, 10**9 - age))
    (tmp_path / "build/cache.toml").write_text("")
    (tmp_path / "build/sources").write_text("src/a/b.f90\n")
    return tmp_path


def build(checkout, message):
    """Returns the exit status, standard error and the number of builds."""
    (checkout / "message").write_text(message + "\n")
    script = (f"set -euo pipefail; checkout={checkout}; source {SCRIPTS}/fpm.sh; find_fpm; "
              "build release --tests")
    path = f"{checkout}/bin:{os.environ['PATH']}"
    run = subprocess.run(["bash", "-c", script], env={**os.environ, "PATH": path},
                         capture_output=True, text=True)
    return run.returncode, run.stderr, len((checkout / "builds").read_text().split())


@pytest.mark.parametrize("message", STALE)
def test_stale_module(checkout, message):
    status, said, builds = build(checkout, message)
    assert (status, builds) == (0, 2)
    assert said.count("\n") == 1
    assert "out of date" in said
    left = sorted(path.name for path in checkout.glob("build/gfortran_B/**/*") if path.is_file())
    assert left == sorted([*OF_OTHERS, "c.mod"])
    other_profile = list(checkout.glob("build/gfortran_A/**/*.*"))
    assert len(other_profile) == len(OF_PROJECT) + len(OF_OTHERS) + 2


def test_second_failure_is_reported(checkout):
    (checkout / "always").write_text("")
    status, said, builds = build(checkout, STALE[0])
    assert (status, builds) == (1, 2)
    assert said.count(STALE[0]) == 1


def test_other_errors_are_not_repeated(checkout):
    status, said, builds = build(checkout, "Error: Syntax error in argument list at (1)")
    assert (status, builds) == (1, 1)
    assert said == "Error: Syntax error in argument list at (1)\n"
    assert (checkout / "build/gfortran_B/project/src_a_b.f90.o").exists()
