"""Demonstrations and plans in the layout of LeRobot's datasets, version 3.

An episode is a trajectory, a frame a pose of the camera at a steady rate in the structure frame (x y z, m;
quaternion x y z w, continuous); the action is the pose of the next frame. What the layout has no place for
stands beside each episode in ``meta/episodes``, and what a person should know in ``README.md``.
"""

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from io import BytesIO
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import upplied
from upplied.catalog.database import Catalog
from upplied.catalog.verbs.exporting import SHARES, kinds_of, new_folder, split_of, splits_of
from upplied.errors import InputError
from upplied.files import replace_file
from upplied.geometry import poses
from upplied.outputs.learning.episodes import Episode, of_demonstrations, of_plans, with_path
from upplied.records import Floats, Trajectory

_NAMES = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_FRAMES_A_FILE = 1_000_000  # of 80 bytes: below the 100 MB that the layout allows a file
_FILES_A_CHUNK = 1000
_POSE_FEATURES = ("observation.state", "action")
_HEADLINES = ("coverage_inspected_pct", "coverage_seen_pct", "min_clearance_m", "frechet_z")
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def export_lerobot(
    catalog: Catalog,
    folder: str | os.PathLike[str],
    transfers: pd.DataFrame | Sequence[str],
    fps: int = 10,
    demonstrations: Sequence[str] | None = None,
    licence: str = "",
    attribution: str = "",
) -> dict[str, int]:
    """Write plans, and the demonstrations, as a dataset in LeRobot's layout, version 3, with a data card.

    Returns the numbers of episodes (of a demonstration one for each stretch without a gap), plans,
    demonstrations and frames.

    Parameters
    ----------
    catalog, folder, transfers, licence, attribution
        As those of `export_dataset`; plans without a trajectory are left out, and no licence need be stated.
    fps : int
        Frames a second; trajectories are interpolated at this rate, but for the gaps of a log.
    demonstrations : sequence of str, optional
        Ids; by default every one in use.

    Raises InputError where the folder is not empty, or there is nothing to write.
    """
    place = new_folder(folder)
    rows = with_path(catalog, transfers)
    known = {row["demonstration_id"]: row for row in catalog.demonstrations().to_dict("records")}
    names = known if demonstrations is None else {*demonstrations}
    flown = {name: row for name, row in known.items() if name in names}
    if not len(rows) + len(flown) or fps < 1:
        fault = f"{len(rows)} plans with a trajectory, {len(flown)} demonstrations, {fps} frames a second"
        raise InputError("episodes", fault, "at least one of each")
    side = split_of(kinds_of(catalog))
    episodes = [*of_demonstrations(catalog, flown, rows, side, fps), *of_plans(catalog, rows, known, side)]
    episodes.sort(key=lambda each: list(SHARES).index(each.split))  # a split is a range of episodes
    tasks = {task: at for at, task in enumerate(dict.fromkeys(each.task for each in episodes))}
    described: list[dict[str, Any]] = []
    frames: list[dict[str, Any]] = []  # of the file being filled
    total = file = 0
    for number, each in enumerate(episodes):
        columns = _frames(each.path, fps, number, tasks[each.task], total)
        count = len(columns["index"])
        if frames and sum(len(part["index"]) for part in frames) + count > _FRAMES_A_FILE:
            _write_frames(place, file, frames)
            frames, file = [], file + 1
        frames.append(columns)
        described.append(_episode(each, columns, total, file))
        total += count
    _write_frames(place, file, frames)
    _write(place / _EPISODES, pa.Table.from_pylist(described))
    by_task = pd.DataFrame({"task_index": list(tasks.values())}, index=pd.Index(tasks, name="task"))
    _write(place / "meta" / "tasks.parquet", pa.Table.from_pandas(by_task))
    features = sorted({name.split("/")[1] for name in described[0] if name.startswith("stats/")})
    splits = splits_of(catalog, rows, flown)
    for way, column in (("by_structure", "split"), ("by_kind", "kind")):
        for value, part in splits[way].items():
            part["episodes"] = [row["episode_index"] for row in described if row[column] == value]
    info = _info(described, total, len(tasks), fps)
    statistics = {feature: _pooled(described, f"stats/{feature}/") for feature in features}
    for name, content in (("stats", statistics), ("splits", splits), ("info", info)):
        replace_file(place / "meta" / f"{name}.json", json.dumps(content, indent=4))
    replace_file(place / "README.md", _data_card(described, info, licence, attribution).encode())
    return {"episodes": len(episodes), "plans": len(rows), "demonstrations": len(flown), "frames": total}


def _frames(path: Trajectory, fps: int, episode: int, task: int, first: int) -> dict[str, Any]:
    """Frames of one episode, at a steady rate; the sign of the quaternion does not jump."""
    count = max(1, int(np.floor(path.t_s[-1] * fps + 1e-9)) + 1)
    steady = poses.interpolate(path, np.arange(count) / fps)
    quats = steady.quat_xyzw.copy()
    turned = (quats[1:] * quats[:-1]).sum(axis=1) < 0
    quats[1:] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    state = np.column_stack([steady.positions, quats]).astype(np.float32)
    return {
        "observation.state": state,
        "action": np.concatenate([state[1:], state[-1:]]),
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, episode),
        "index": np.arange(first, first + count),
        "task_index": np.full(count, task),
    }


def _episode(each: Episode, frames: Mapping[str, Any], first: int, file: int) -> dict[str, Any]:
    """The row of one episode: where its frames lie, their statistics, and where it came from."""
    statistics = {
        f"stats/{name}/{measure}": value
        for name, values in frames.items()
        for measure, value in _statistics(values).items()
    }
    chunk, count = _chunk(file), len(frames["index"])
    return {
        "episode_index": int(frames["episode_index"][0]),
        "tasks": [each.task],
        "length": count,
        **{f"data/{name}": number for name, number in chunk.items()},
        "dataset_from_index": first,
        "dataset_to_index": first + count,
        **{f"meta/episodes/{name}": 0 for name in chunk},
        "split": each.split,
        **statistics,
        **each.about,
    }


def _chunk(file: int) -> dict[str, int]:
    return {"chunk_index": file // _FILES_A_CHUNK, "file_index": file % _FILES_A_CHUNK}


def _statistics(values: Floats) -> dict[str, list[float]]:
    table = np.asarray(values, float).reshape(len(values), -1)
    measures = {name: getattr(table, name)(axis=0) for name in ("min", "max", "mean", "std")}
    measures |= {name: np.quantile(table, share, axis=0) for name, share in _QUANTILES.items()}
    return {"count": [len(table)], **{name: values.tolist() for name, values in measures.items()}}


def _pooled(episodes: Sequence[Mapping[str, Any]], prefix: str) -> dict[str, list[float]]:
    """Statistics of a feature in all frames from those of the episodes; quantiles are weighted means."""
    names = [name.removeprefix(prefix) for name in episodes[0] if name.startswith(prefix)]
    of = {name: np.array([each[prefix + name] for each in episodes]) for name in names}
    weight = of["count"] / of["count"].sum()
    pooled = {name: (weight * of[name]).sum(axis=0) for name in ("mean", *_QUANTILES)}
    variance = (weight * (of["std"] ** 2 + (of["mean"] - pooled["mean"]) ** 2)).sum(axis=0)
    pooled |= {"min": of["min"].min(axis=0), "max": of["max"].max(axis=0), "std": np.sqrt(variance)}
    return {"count": [int(of["count"].sum())], **{name: values.tolist() for name, values in pooled.items()}}


def _info(episodes: Sequence[Mapping[str, Any]], frames: int, tasks: int, fps: int) -> dict[str, Any]:
    counts = [sum(row["split"] == name for row in episodes) for name in SHARES]
    ends = [0, *accumulate(counts)]
    names = ["val" if name == "validation" else name for name in SHARES]  # as LeRobot's tools call it
    pose = {"dtype": "float32", "shape": [len(_NAMES)], "names": _NAMES}
    whole = {"dtype": "int64", "shape": [1], "names": None}
    return {
        "codebase_version": "v3.0",
        "robot_type": "drone",
        "total_episodes": len(episodes),
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": _FILES_A_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {name: f"{a}:{b}" for name, (a, b) in zip(names, pairwise(ends), strict=True) if b > a},
        "data_path": _DATA,
        "video_path": None,
        "features": {
            **dict.fromkeys(_POSE_FEATURES, pose),
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), whole),
        },
    }


def _write_frames(place: Path, file: int, parts: Sequence[Mapping[str, Any]]) -> None:
    columns = {}
    for name in parts[0]:
        values = np.concatenate([part[name] for part in parts])
        if name in _POSE_FEATURES:
            columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), len(_NAMES))
        else:
            columns[name] = pa.array(values)
    _write(place / _DATA.format(**_chunk(file)), pa.table(columns))


def _write(path: Path, table: pa.Table) -> None:
    sink = BytesIO()
    pq.write_table(table, sink, compression="snappy")
    replace_file(path, sink.getvalue())


def _data_card(episodes: Sequence[Mapping[str, Any]], info: dict[str, Any], licence: str, named: str) -> str:
    """``README.md``: what the dataset holds, how to read it and what it is not, as dataset hubs read it."""
    counts = Counter((row["kind"], row["split"], row["origin"]) for row in episodes)
    kinds = sorted({kind for kind, _, _ in counts})
    table = [
        f"| {kind} | {split} | {counts[kind, split, 'demonstration']} | {counts[kind, split, 'plan']} |"
        for kind in kinds
        for split in dict.fromkeys(row["split"] for row in episodes)
        if counts[kind, split, "demonstration"] + counts[kind, split, "plan"]
    ]
    plans = [row for row in episodes if row["origin"] == "plan"]
    measures = [_line(name, [row[name] for row in plans]) for name in _HEADLINES] if plans else []
    text = files(__package__).joinpath("lerobot.md").read_text(encoding="utf-8")
    return text.format(
        licence=json.dumps(licence or "unknown"),
        rights=licence or "none was stated: ask whoever gave you this before you pass it on",
        whom=f" Please name: {named}." if named else "",
        episodes=len(episodes),
        frames=info["total_frames"],
        fps=info["fps"],
        tasks=info["total_tasks"],
        counts="\n".join(table),
        measures="\n".join(measures) or "There are no plans.",
        version=upplied.__version__,
    )


def _line(name: str, values: Sequence[float | None]) -> str:
    known = pd.Series(values, dtype=float).dropna().to_numpy()
    if not len(known):
        return f"- `{name}`: not computed"
    low, middle, high = np.quantile(known, (0, 0.5, 1))
    return f"- `{name}`: {middle:.4g} in the median, {low:.4g} to {high:.4g} ({len(known)} plans)"
