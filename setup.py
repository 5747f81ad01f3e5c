"""Which folders are the package; all else is said in pyproject.toml.

`flows/` lies at the root, where whoever comes for the flows looks first, and is the package `upplied.flows`
wherever it is installed, editable or from a wheel: one name for imports, deployments and the workers of a
cluster, and no top-level package called "flows" in anybody's site-packages. A wheel also carries the
deployments and the locked versions, which lie at the root as well.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

CARRIED = ("prefect.yaml", "requirements-runtime.lock")


class Build(build_py):
    """Takes the files of the root into the wheel, beside the flows; an editable install finds them there."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            for name in CARRIED:
                shutil.copy(name, Path(self.build_lib, "upplied", "flows", name))


setup(
    packages=[*find_packages(include=["upplied*"]), "upplied.flows"],
    package_dir={"upplied.flows": "flows"},
    cmdclass={"build_py": Build},
)
