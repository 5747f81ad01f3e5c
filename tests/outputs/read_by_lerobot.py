"""Run by the Python that has `lerobot`: load an exported dataset with it and say what it finds, as JSON."""

from __future__ import annotations

import json
import os
import sys

os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ.setdefault("HF_DATASETS_OFFLINE", "1")

from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("local/upplied", root=sys.argv[1])
frames = [dataset[index] for index in range(len(dataset))]
print(  # noqa: T201 - read by the test
    json.dumps(
        {
            "episodes": dataset.meta.total_episodes,
            "frames": len(dataset),
            "fps": dataset.meta.fps,
            "splits": dict(dataset.meta.info.splits),
            "kinds": [str(episode["kind"]) for episode in dataset.meta.episodes],
            "tasks": sorted({frame["task"] for frame in frames}),
            "states": [frame["observation.state"].tolist() for frame in frames],
            "actions": [frame["action"].tolist() for frame in frames],
            "episode_of": [int(frame["episode_index"]) for frame in frames],
            "seconds": [float(frame["timestamp"]) for frame in frames],
        }
    )
)
