"""The door to Open3D: what it leaves aside while it loads works once it is asked for."""

from __future__ import annotations

import subprocess
import sys

PLOTS_TWICE = """
from upplied.scene import open3d
module = open3d()
drawing, box = module.visualization, module.geometry.TriangleMesh.create_box()
print("dash" in __import__("sys").modules)
for _ in range(2):
    print(type(drawing.get_plotly_fig([box])).__name__, drawing.draw_plotly.__name__ if _ else "")
import open3d.visualization.draw_plotly
"""


def test_open3ds_plots_load_when_they_are_asked_for():
    done = subprocess.run([sys.executable, "-c", PLOTS_TWICE], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "Figure", "Figure", "draw_plotly"]


def test_an_open3d_that_is_loaded_already_stays_as_it_is():
    code = """
from upplied.scene import open3d
before = open3d().visualization.draw_plotly
open3d.cache_clear()
print(open3d().visualization.draw_plotly is before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]
