"""The page for operators says what the code does: each figure, name, command and option of it."""

from __future__ import annotations

import inspect
import re
import shlex
from datetime import timedelta
from pathlib import Path

import pytest
import yaml
from prefect.settings import Settings

from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs.maintenance import KEEP_DAYS
from upplied.cli import app
from upplied.cli.serve import deploy
from upplied.cli.serve import serve as serve_command
from upplied.fleet import run as runs
from upplied.flows import automations, environment, pool, states, tasks, watch
from upplied.flows.parameters import Resources
from upplied.flows.transfer_fleet import transfer_fleet

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "operating.md"
WORDS = " ".join(PAGE.read_text(encoding="utf-8").split())
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
DECLARED = yaml.safe_load((ROOT / "prefect.yaml").read_text(encoding="utf-8"))["deployments"]
NUMBERS = {1: "one", 2: "two", 4: "four", 8: "eight", 10: "ten", 30: "thirty"}
#: Options of Prefect's commands that other tests call.
PREFECT = {
    "deployment run": {"--watch", "--param"},
    "worker start": {"--pool", "--limit", "--name"},
    "work-pool create": {"--type"},
    "deploy": {"--all", "--no-prompt"},
}


def commands(program: str) -> list[tuple[str, str]]:
    """Page and words of each command that is told, in a block or within a sentence."""
    lines = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        texts = [
            line.split(" #")[0].strip(" &")
            for block in re.findall(r"```(?:bash|sh|console)\n(.*?)```", text, re.DOTALL)
            for line in re.split(r"\n|&&|\$\(|\|", block.replace("\\\n", " "))
        ]
        texts += re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
        for command in texts:
            words = command.strip().rstrip(")").removeprefix("$ ")
            if words.startswith(f"{program} ") and "..." not in words and "{" not in words:
                lines.append((str(page.relative_to(ROOT)), words))
    return lines


def test_every_command_of_ours_that_is_told_is_understood():
    lines = commands("upplied")
    assert len(lines) > 80
    wrong = []
    for page, command in lines:
        words = [word for word in shlex.split(command)[1:] if word != "--quiet"]
        group = app
        while words and words[0] in set(group):
            group = group[words.pop(0)]
        known = (
            {name for parsed in group.assemble_argument_collection() for name in parsed.names}
            if (group.default_command)
            else set()
        )
        known |= {"--help", "--version", "--install-completion", "--catalog"}
        options = [word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)]
        if missing := [name for name in options if name not in known]:
            wrong.append(f"{page}: {command}: {missing}")
        elif group is app and words and not words[0].startswith("-"):
            wrong.append(f"{page}: {command}: no such command")
    assert not wrong, "\n".join(wrong)


def test_every_command_of_prefects_that_is_told_is_one_that_tests_call():
    lines = commands("prefect")
    assert len(lines) >= 6
    for page, command in lines:
        words = shlex.split(command)[1:]
        plain = " ".join(word for word in words if not word.startswith("-"))
        (name,) = [name for name in PREFECT if f"{plain} ".startswith(f"{name} ")]
        assert {word for word in words if word.startswith("-")} <= PREFECT[name], f"{page}: {command}"


def test_parameters_that_are_told_are_there():
    parameters = set(inspect.signature(transfer_fleet.fn).parameters)
    names = set(re.findall(r"--param (\w+)=", WORDS))
    assert names >= {"manifest", "logs", "presets", "catalog", "resources"} and names <= parameters
    of_resources = set(re.findall(r"resources\.(\w+)", WORDS)) | set(
        re.findall(r'"(\w+)": "(?:pool|dask|tcp)', WORDS)
    )
    assert of_resources >= {"timeout_s", "memory_gib", "shard_targets", "most_lost", "engine", "address"}
    assert of_resources <= set(Resources.model_fields)
    for name in ("prune", "retry_failed", "fly"):
        assert f"`{name}" in WORDS and name in parameters


def test_variables_that_are_told_are_read_somewhere():
    sources = [*(ROOT / "upplied").rglob("*.py"), *(ROOT / "flows").glob("*.py"), ROOT / "compose.yaml"]
    code = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    ours = set(re.findall(r"UPPLIED_[A-Z_]+", WORDS))
    assert len(ours) >= 5
    assert all(f"{name}" in code for name in ours), ours
    theirs = set(re.findall(r"PREFECT_[A-Z_]+", WORDS)) - {"PREFECT_HOME"}
    known = environment.SETTINGS.keys() | {"PREFECT_API_URL", "PREFECT_API_AUTH_STRING"}
    assert theirs <= known
    assert set(environment.SETTINGS) - {"DO_NOT_TRACK", "RAY_USAGE_STATS_ENABLED"} <= prefects()


def prefects() -> set[str]:
    """The names of all settings that this Prefect knows: a wrong one changes nothing, and says nothing."""
    names = set()

    def look(model, prefix: str) -> None:
        for name, item in model.model_fields.items():
            if hasattr(item.annotation, "model_fields"):
                look(
                    item.annotation,
                    item.annotation.model_config.get("env_prefix", f"{prefix}{name.upper()}_"),
                )
            names.add(f"{prefix}{name}".upper())
            aliases = getattr(item.validation_alias, "choices", ())
            names.update(str(alias).upper() for alias in aliases)

    look(Settings, "PREFECT_")
    return names


SILENCE = f"{automations.SILENCE_S} s"
HOUR, MINUTE = re.fullmatch(r"(\d+) (\d+) \* \* \*", DECLARED[0]["schedules"][0]["cron"]).groups()[::-1]
PORT = inspect.signature(serve_command).parameters["port"].default


@pytest.mark.parametrize(
    "phrase",
    [
        f"`transfer-fleet` runs at {int(HOUR):02}:{int(MINUTE):02} UTC",
        f"http://127.0.0.1:{PORT}>",
        f"http://127.0.0.1:{PORT + 1}>",
        f"after {NUMBERS[automations.SILENCE_S // automations.HEARTBEAT_S]} silent heartbeats ({SILENCE})",
        f"marked crashed by the automation after {SILENCE}",
        "repeated after 2, 4 and 8 seconds",
        f"nothing was written for {NUMBERS[int(watch.QUIET_S)]} seconds",
        f"reported after {NUMBERS[int(watch.PATIENCE_S // 60)]} minutes",
        f"emits `{watch.LANDED}`",
        f"emits `{watch.FLOWN}`",
        f"the event `{tasks.RECALLED}`",
        f"up to {NUMBERS[pool.SHARDS_EACH]} for each machine, of at least {pool.SHARD_TARGETS} targets",
        f"work pool `{pool.POOL}`",
        f"results up to {NUMBERS[int(runs.EVERY_S)]} seconds before are stored",
        f"| `{states.TROUBLED}` |",
        "stored for thirty days (`PREFECT_SERVER_SERVICES_DB_VACUUM_RETENTION_PERIOD`)",
        "are more than `resources.most_lost` (half)",
        f"younger than {NUMBERS[int(KEEP_DAYS)]} days",
        "every Sunday at 05:00 UTC",
    ],
)
def test_figures_and_names_are_those_of_the_code(phrase):
    assert phrase in WORDS


def test_figures_of_prefects_settings_are_those_that_are_set():
    seconds = int(environment.SETTINGS["PREFECT_SERVER_SERVICES_DB_VACUUM_RETENTION_PERIOD"])
    assert seconds == timedelta(days=30).total_seconds()
    assert sum(2**n for n in range(1, int(environment.SETTINGS["PREFECT_CLIENT_MAX_RETRIES"]) + 1)) >= 120
    assert Resources().most_lost == 0.5
    assert (tasks.STORED["retries"], tasks.STORED["retry_delay_seconds"](3)) == (3, [2, 4, 8])
    night, weekly = DECLARED[0], DECLARED[-1]
    assert night["concurrency_limit"]["collision_strategy"] == "CANCEL_NEW" and "`CANCEL_NEW`" in WORDS
    assert night["concurrency_limit"]["grace_period_seconds"] == 300 and "within five minutes" in WORDS
    assert (weekly["name"], weekly["schedules"][0]["cron"]) == ("maintain-catalog", "0 5 * * 0")
    assert inspect.signature(deploy).parameters["port"].default == PORT


def test_states_and_columns_that_are_told_are_there():
    rows = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert rows == ["Completed", states.TROUBLED, "Failed", "Crashed", "Cancelled"]
    words = re.search(r"for each run that ends ((?:`\w+`,? ?(?:or )?)+)", WORDS)[1]
    assert set(re.findall(r"`(\w+)`", words)) == set(automations.TROUBLE)
    (column,) = re.findall(r"Column `(\w+)` of `transfers`", WORDS)
    assert column in TABLES["transfers"].names
