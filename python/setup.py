"""Has the shared library built by the project's own script, and puts it into the package."""
import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.dist import Distribution

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:
    from wheel.bdist_wheel import bdist_wheel

HERE = Path(__file__).resolve().parent


class BuildWithLibrary(build_py):
    def run(self):
        script = HERE.parent / "scripts" / "library.sh"
        if not script.exists():
            raise SystemExit(f"found no {script}, expected to be installed from a checkout: "
                             "pip install ./python")
        super().run()
        folder = Path(self.build_lib, "beamid", "lib")
        if self.editable_mode:
            folder = HERE / "beamid" / "lib"
        subprocess.run([str(script), str(folder)], check=True)


class WheelOfThisMachine(bdist_wheel):
    """Any Python 3, but only this kind of machine."""

    def get_tag(self):
        return ("py3", "none", super().get_tag()[2])


class WithLibrary(Distribution):
    def has_ext_modules(self):
        return True


setup(cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": WheelOfThisMachine},
      distclass=WithLibrary)
