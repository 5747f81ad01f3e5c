"""The export for learning, loaded by pandas, polars, DuckDB, evo and by `lerobot` itself (`make lerobot`)."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from catalog_records import demonstration, key_of, plan, structure

from upplied.catalog import Catalog, open_catalog
from upplied.outputs.learning import export_lerobot, export_tum

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-lerobot" / "bin" / "python"


TARGETS = 12


@pytest.fixture(scope="module")
def catalog(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("from"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(TARGETS))])
    catalog.add_demonstrations(
        [demonstration(), demonstration("other", 1, breaks=np.array([49]), about="part_3")]
    )
    plans = [plan(f"t{at}", at) for at in range(TARGETS)]
    plans = [replace(each, trajectory=replace(each.trajectory, t_s=np.arange(60) / 20)) for each in plans]
    catalog.add_plans([(key_of(at), each, {"run_id": "r"}) for at, each in enumerate(plans)])
    return catalog


@pytest.fixture(scope="module")
def folder(catalog, tmp_path_factory) -> Path:
    catalog.release(catalog.transfers()["transfer_id"].iloc[0], by="Ada", force=["verdict"])
    place = tmp_path_factory.mktemp("export") / "set"
    export_lerobot(catalog, place, catalog.transfers(), 20, licence="CC-BY-4.0", attribution="Ada & sons")
    return place


def read(folder: Path, what: str) -> pd.DataFrame:
    return pd.concat([pd.read_parquet(path) for path in sorted((folder / what).rglob("*.parquet"))])


def test_the_database_goes_out_whole_with_the_measures_of_its_plans(catalog, folder):
    episodes = read(folder, "meta/episodes")
    plans = episodes[episodes["origin"] == "plan"].set_index("transfer_id")
    rows = catalog.transfers().set_index("transfer_id").loc[plans.index]
    assert len(plans) == TARGETS
    for name in ("coverage_inspected_pct", "min_clearance_m", "frechet_z", "state", "source_sha256"):
        assert plans[name].tolist() == rows[name].tolist(), name
    assert plans["structure_id"].tolist() == rows["target_id"].tolist()
    flown = episodes[episodes["origin"] == "demonstration"]
    assert flown["demonstration_id"].value_counts().to_dict() == {"flight": 3, "other": 1}
    assert flown[["coverage_inspected_pct", "min_clearance_m"]].isna().all(axis=None)
    assert set(flown["hfov_deg"]) == {80.0} and set(episodes["operator"]) == {"Ada"}


def test_a_demonstration_goes_out_as_it_was_flown_and_nothing_is_made_up_for_its_gaps(folder):
    episodes, frames, flight = read(folder, "meta/episodes"), read(folder, "data"), demonstration()
    own = episodes[episodes["demonstration_id"].eq("flight") & episodes["origin"].eq("demonstration")]
    for (_, row), begin, end in zip(own.iterrows(), (0, 10, 20), (10, 20, 50), strict=True):
        states = np.stack(
            frames["observation.state"].iloc[row["dataset_from_index"] : row["dataset_to_index"]]
        )
        t_s = (flight.t_ns[begin:end] - flight.t_ns[begin]) * 1e-9
        assert len(states) == int(t_s[-1] * 20) + 1
        assert np.allclose(states[0, :3], flight.positions[begin], atol=1e-5)
        at = np.arange(len(states)) / 20
        expected = [np.interp(at, t_s, flight.positions[begin:end, axis]) for axis in range(3)]
        assert np.allclose(states[:, :3], np.transpose(expected), atol=1e-4)


def test_quaternions_are_continuous_within_an_episode(catalog, folder):
    frames = read(folder, "data")
    states, actions = (np.stack(frames[name]) for name in ("observation.state", "action"))
    same = np.diff(frames["episode_index"]) == 0
    turned = (states[1:, 3:] * states[:-1, 3:]).sum(axis=1)[same]
    assert turned.min() > 0, "the sign of a quaternion jumps"
    assert (states[:, 6] < 0).any(), "no episode passes w = 0, so nothing was shown"
    assert np.allclose(np.linalg.norm(states[:, 3:], axis=1), 1, atol=1e-6)
    assert (actions[:-1][same] == states[1:][same]).all()


def test_tasks_are_words_that_a_demonstration_and_its_plans_share(folder):
    episodes, tasks = read(folder, "meta/episodes"), pd.read_parquet(folder / "meta" / "tasks.parquet")
    words = "Fly the camera round the box and inspect"
    assert set(tasks.index) == {
        f"{words} its part (left), as flight shows.",
        f"{words} part_3, as other shows.",
    }
    by_flight = episodes.groupby("demonstration_id")["tasks"].agg(lambda each: {one[0] for one in each})
    assert all(len(each) == 1 for each in by_flight)


def test_splits_are_ranges_of_episodes_and_keep_structures_apart(folder):
    episodes = read(folder, "meta/episodes")
    info = json.loads((folder / "meta" / "info.json").read_text())
    splits = json.loads((folder / "meta" / "splits.json").read_text())
    by_split = {}
    for name, text in info["splits"].items():
        begin, end = map(int, text.split(":"))
        by_split["validation" if name == "val" else name] = list(range(begin, end))
    assert list(by_split) == ["train", "validation", "test"]
    for name, numbers in by_split.items():
        assert splits["by_structure"][name]["episodes"] == numbers
        assert set(episodes.loc[episodes["split"] == name, "episode_index"]) == set(numbers)
    assert episodes.groupby("structure_id")["split"].nunique().max() == 1
    assert splits["by_kind"]["box"]["episodes"] == list(range(len(episodes)))


def test_the_card_says_what_it_holds_and_whose_it_is(folder, catalog, tmp_path):
    card = (folder / "README.md").read_text()
    assert card.startswith('---\nlicense: "CC-BY-4.0"\n') and "Please name: Ada & sons." in card
    episodes = read(folder, "meta/episodes")
    assert f"{len(episodes)} episodes of {len(read(folder, 'data'))} frames" in card
    middle = episodes["coverage_inspected_pct"].median()
    assert f"`coverage_inspected_pct`: {middle:.4g} in the median" in card
    export_lerobot(catalog, tmp_path / "none", [], demonstrations=["flight"])
    bare = (tmp_path / "none" / "README.md").read_text()
    assert "There are no plans." in bare and "ask whoever gave you this" in bare
    assert set(read(tmp_path / "none", "meta/episodes")["demonstration_id"]) == {"flight"}


def test_polars_and_duckdb_read_what_pandas_reads(folder):
    polars, duckdb = pytest.importorskip("polars"), pytest.importorskip("duckdb")
    frames, episodes = read(folder, "data"), read(folder, "meta/episodes")
    length = frames.groupby("episode_index").size().to_dict()
    assert length == dict(zip(episodes["episode_index"], episodes["length"], strict=True))
    read_by_polars = polars.read_parquet(folder / "data/*/*.parquet")
    assert dict(read_by_polars.group_by("episode_index").len().iter_rows()) == length
    states = read_by_polars["observation.state"].to_numpy()
    assert (np.stack(list(states)) == np.stack(frames["observation.state"])).all()
    query = f"""
        select e.split, count(*), avg(f."observation.state"[3])
        from '{folder}/data/*/*.parquet' f join '{folder}/meta/episodes/*/*.parquet' e using (episode_index)
        where e.origin = 'plan' group by 1 order by 1
    """
    joined = frames.merge(episodes[["episode_index", "split", "origin"]], on="episode_index")
    joined = joined[joined["origin"] == "plan"].assign(
        z_m=lambda rows: [each[2] for each in rows["observation.state"]]
    )
    expected = joined.groupby("split")["z_m"].agg(["size", "mean"])
    for split, count, mean in duckdb.sql(query).fetchall():
        assert count == expected["size"][split]
        assert mean == pytest.approx(expected["mean"][split], abs=1e-4)


def test_evo_reads_episodes_and_text_files_as_the_same_trajectories(catalog, folder, tmp_path):
    pytest.importorskip("evo")
    from evo.core import metrics, sync
    from evo.core.trajectory import PoseTrajectory3D
    from evo.tools import file_interface

    export_tum(catalog, tmp_path / "tum", catalog.transfers())
    episodes, frames = read(folder, "meta/episodes"), read(folder, "data")
    for row in episodes[episodes["origin"] == "plan"].head(3).to_dict("records"):
        own = frames.iloc[row["dataset_from_index"] : row["dataset_to_index"]]
        states = np.stack(own["observation.state"]).astype(float)
        quats = states[:, [6, 3, 4, 5]] / np.linalg.norm(states[:, 3:], axis=1, keepdims=True)
        episode = PoseTrajectory3D(states[:, :3], quats, own["timestamp"].to_numpy(float))
        text = file_interface.read_tum_trajectory_file(
            tmp_path / "tum" / "plans" / f"{row['transfer_id']}.txt"
        )
        for each in (episode, text):
            valid, details = each.check()
            assert valid, details
        pairs = sync.associate_trajectories(text, episode, max_diff=1e-6)
        ape = metrics.APE(metrics.PoseRelation.full_transformation)
        ape.process_data(pairs)
        assert pairs[0].num_poses == 60
        assert ape.get_statistic(metrics.StatisticsType.max) < 1e-4


@pytest.mark.skipif(not PYTHON.exists(), reason="lerobot is not installed: make lerobot (5 GB)")
def test_lerobot_itself_loads_what_was_exported(catalog: Catalog, tmp_path: Path) -> None:
    counts = export_lerobot(catalog, tmp_path / "set", catalog.transfers(), fps=20)
    command = [str(PYTHON), str(Path(__file__).parent / "read_by_lerobot.py"), str(tmp_path / "set")]
    home = {"HF_HOME": str(tmp_path / "home"), "HF_LEROBOT_HOME": str(tmp_path / "home")}
    process = subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=os.environ | home, check=False
    )
    assert process.returncode == 0, process.stderr[-3000:]
    dataset = json.loads(process.stdout.splitlines()[-1])
    assert (dataset["episodes"], dataset["frames"]) == (counts["episodes"], counts["frames"])
    assert dataset["fps"] == 20
    frames = read(tmp_path / "set", "data")
    assert np.allclose(dataset["states"], np.stack(frames["observation.state"].to_list()))
    assert np.allclose(dataset["actions"], np.stack(frames["action"].to_list()))
    assert dataset["episode_of"] == frames["episode_index"].tolist()
    assert np.allclose(dataset["seconds"], frames["timestamp"])
    assert dataset["tasks"] == sorted(pd.read_parquet(tmp_path / "set" / "meta" / "tasks.parquet").index)
    splits = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())["splits"]
    assert dataset["splits"] == splits
    assert dataset["kinds"] == ["box"] * counts["episodes"], "what stands beside each episode was not read"
