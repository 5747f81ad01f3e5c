"""Coverage-guided fuzzing of the readers of logs, side-cars and manifests.

    make fuzz
    python tests/faults/fuzz_logs.py --seconds 600

Needs atheris (Linux), which `make fuzz` installs. The readers may refuse with an `UppliedError`;
any other exception, a warning, ten seconds or 2 GiB for one small file is a finding. Findings of
one kind are kept once, in the folder given by ``--findings``; the small ones belong into
``tests/data/findings``, where `tests/inputs/test_logs_findings.py` replays them for ever.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

FOLDER = Path(__file__).parents[1]
KINDS = (b"L", b"S", b"T", b"C")  # first byte: a log, a side-car, a manifest in TOML or in CSV


def replay(data: bytes, folder: Path) -> str:
    """What the fuzzer does with one input: why it is refused, empty where it is read; raises what is a fault.

    Parameters
    ----------
    data : bytes
        One byte for the kind, then the content of the file.
    folder : Path
        For the file, and for ``sound.mcap``, the log that a fuzzed side-car lies next to.
    """
    from upplied.errors import UppliedError
    from upplied.inputs.logs import LogOptions, read_demonstration
    from upplied.inputs.manifests import read_manifest

    kind, content = data[:1], data[1:]
    options = LogOptions(min_duration_s=0.0)
    try:
        if kind == b"S":
            (folder / "sound.toml").write_bytes(content)
            read_demonstration(folder / "sound.mcap", options)
        elif kind in (b"T", b"C"):
            manifest = folder / ("m.toml" if kind == b"T" else "m.csv")
            manifest.write_bytes(content)
            read_manifest(manifest)
        else:
            (folder / "fuzz.mcap").write_bytes(content)
            demonstration = read_demonstration(folder / "fuzz.mcap", options)
            assert len(demonstration) >= 2 and (demonstration.t_ns[1:] > demonstration.t_ns[:-1]).all()
    except UppliedError as error:
        return str(error)
    return ""


def seeds(folder: Path) -> None:
    """One small sound file for each family, container and kind of input."""
    sys.path.insert(0, str(FOLDER))
    from made_seeds import seed_inputs

    for name, data in seed_inputs(folder).items():
        (folder / name).write_bytes(data)


def main() -> None:
    """Fuzz for the time that is asked for and report what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--findings", type=Path, default=FOLDER.parent / "build" / "findings")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    try:
        import atheris
    except ImportError:
        sys.exit("atheris is not installed: .venv/bin/python -m pip install atheris")
    with atheris.instrument_imports(include=["upplied.inputs", "upplied.checks"]):
        import upplied.inputs.logs
        import upplied.inputs.manifests  # noqa: F401
    warnings.simplefilter("error")
    arguments.findings.mkdir(parents=True, exist_ok=True)
    failures: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as name:
        folder, corpus = Path(name), Path(name) / "corpus"
        corpus.mkdir()
        seeds(corpus)
        (folder / "sound.mcap").write_bytes((corpus / "PoseStamped").read_bytes()[1:])

        def one(data: bytes) -> None:
            try:
                replay(data, folder)
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                frames = [f for f in traceback.extract_tb(error.__traceback__) if "upplied" in f.filename]
                where = frames[-1] if frames else place
                key = f"{type(error).__name__} in {Path(where.filename).name}:{where.lineno}"
                failures[key] = failures.get(key, 0) + 1
                if failures[key] == 1:
                    digest = hashlib.sha256(key.encode()).hexdigest()[:12]
                    (arguments.findings / digest).write_bytes(data)
                    (arguments.findings / f"{digest}.txt").write_text(key + "\n" + traceback.format_exc())
                    sys.stdout.write(f"finding {digest}: {key}: {str(error)[:120]}\n")

        limits = [
            f"-max_total_time={arguments.seconds}",
            "-timeout=10",
            "-rss_limit_mb=2048",
            "-max_len=20000",
        ]
        argv = [
            sys.argv[0],
            *limits,
            f"-seed={arguments.seed}",
            f"-artifact_prefix={arguments.findings}/",
            "-print_final_stats=1",
            str(corpus),
        ]
        atheris.Setup(argv, one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
