"""Demonstrations and plans for machine learning: episodes in LeRobot's layout, and text files of TUM's."""

from upplied.outputs.learning.episodes import export_tum
from upplied.outputs.learning.lerobot import export_lerobot

__all__ = ["export_lerobot", "export_tum"]
