"""Demonstrations and plans for machine learning: episodes in LeRobot's layout, and text files of TUM's."""

from upplied.outputs.learning.lerobot import export_lerobot
from upplied.outputs.learning.tum import export_tum

__all__ = ["export_lerobot", "export_tum"]
