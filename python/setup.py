"""Has the library and the program built by the project's own script, and puts them into the
package, with the scripts that draw."""
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
        scripts = HERE.parent / "scripts"
        if not (scripts / "library.sh").exists():
            raise SystemExit(f"found no {scripts / 'library.sh'}, expected to be installed from a "
                             "checkout: pip install ./python")
        super().run()
        package = Path(self.build_lib, "beamid")
        if self.editable_mode:
            package = HERE / "beamid"
        else:
            subprocess.run([scripts / "copy_scripts.sh", package / "scripts"], check=True)
        subprocess.run([scripts / "library.sh", package / "lib"], check=True)


class WheelOfThisMachine(bdist_wheel):
    """Any Python 3, but only this kind of machine."""

    def get_tag(self):
        return ("py3", "none", super().get_tag()[2])


class WithLibrary(Distribution):
    def has_ext_modules(self):
        return True


setup(cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": WheelOfThisMachine},
      distclass=WithLibrary)
