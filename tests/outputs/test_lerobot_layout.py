"""The files of the export for learning: frames, episodes, tasks and statistics agree with one another."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import Catalog, open_catalog
from upplied.errors import InputError
from upplied.outputs.learning import export_lerobot, lerobot


@pytest.fixture(scope="module")
def catalog(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("from"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(4))])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan(f"t{at}", at), {}) for at in range(3)])
    catalog.add_plans([(key_of(3), plan("t3", status="refused"), {})])
    return catalog


def test_lerobot_layout(catalog, tmp_path):
    counts = export_lerobot(catalog, tmp_path / "set", catalog.transfers(), fps=20, demonstrations=[])
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["total_episodes"] == counts["episodes"] == 3  # the refused one has no trajectory
    frames = pd.read_parquet(tmp_path / "set" / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(frames.columns) == set(info["features"])
    assert len(frames) == info["total_frames"] == counts["frames"]
    assert list(frames["index"]) == list(range(len(frames)))
    episodes = pd.read_parquet(tmp_path / "set" / "meta/episodes/chunk-000/file-000.parquet")
    tasks = pd.read_parquet(tmp_path / "set" / "meta" / "tasks.parquet")
    assert info["total_tasks"] == len(tasks)
    for episode in episodes.to_dict("records"):
        own = frames.iloc[episode["dataset_from_index"] : episode["dataset_to_index"]]
        assert len(own) == episode["length"]
        assert (own["episode_index"] == episode["episode_index"]).all()
        assert np.allclose(np.diff(own["timestamp"]), 1 / 20, atol=1e-5)
        assert tasks["task_index"][episode["tasks"][0]] == own["task_index"].iloc[0]
        path = catalog.trajectory(episode["transfer_id"])
        state = np.stack(own["observation.state"].to_list())
        assert np.allclose(state[:, :3], path.at(np.arange(len(own)) / 20).positions, atol=1e-5)
        assert np.allclose(np.stack(own["action"].to_list())[:-1], state[1:])
        assert np.allclose(episode["stats/observation.state/mean"], state.mean(axis=0), atol=1e-5)


def test_lerobot_statistics_are_those_of_all_frames(catalog, tmp_path):
    export_lerobot(catalog, tmp_path / "set", catalog.transfers())
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())
    frames = pd.read_parquet(tmp_path / "set" / "data/chunk-000/file-000.parquet")
    state = np.stack(frames["observation.state"].to_list()).astype(float)
    for name, value in (
        ("mean", state.mean(0)),
        ("std", state.std(0)),
        ("min", state.min(0)),
        ("max", state.max(0)),
    ):
        assert np.allclose(stats["observation.state"][name], value, atol=1e-6), name
    assert stats["index"]["count"] == [len(frames)]


def test_lerobot_files_are_split_between_episodes(catalog, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot, "_FRAMES_A_FILE", 400)
    counts = export_lerobot(catalog, tmp_path / "set", catalog.transfers())
    files = sorted((tmp_path / "set" / "data" / "chunk-000").iterdir())
    assert len(files) > 1
    assert sum(pq.read_metadata(path).num_rows for path in files) == counts["frames"]
    episodes = pd.read_parquet(tmp_path / "set" / "meta/episodes/chunk-000/file-000.parquet")
    for number, path in enumerate(files):
        own = set(pd.read_parquet(path)["episode_index"])
        assert own == set(episodes[episodes["data/file_index"] == number]["episode_index"])


def test_lerobot_needs_a_trajectory(catalog, tmp_path):
    with pytest.raises(InputError, match="0 plans with a trajectory, 0 demonstrations"):
        export_lerobot(catalog, tmp_path / "x", catalog.transfers(status="refused"), demonstrations=[])


def test_lerobot_is_written_from_one_frame_a_second_on(catalog, tmp_path):
    counts = export_lerobot(catalog, tmp_path / "slow", catalog.transfers(), fps=1)
    usual = export_lerobot(catalog, tmp_path / "usual", catalog.transfers(), fps=20)
    assert counts["episodes"] == usual["episodes"] and 0 < counts["frames"] < usual["frames"] / 10
    with pytest.raises(InputError, match="0 frames a second"):
        export_lerobot(catalog, tmp_path / "none", catalog.transfers(), fps=0)
