"""Parameters of the flows that take files in: the rules and bounds of `--allow` and `--set`, no others."""

from __future__ import annotations

import pytest
from prefect.exceptions import ParameterTypeError

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.flows.ingest import ingest_demonstrations, ingest_structures, log_options
from upplied.flows.parameters import FlightBounds, bound_options
from upplied.inputs.rules import PassportSettings
from upplied.outputs.logs import write_log
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

FLOWS = {
    "flights": (ingest_demonstrations, {"logs": ["flight.mcap"]}),
    "structures": (ingest_structures, {"manifest": "structures.toml"}),
}


@pytest.mark.parametrize("what", FLOWS)
@pytest.mark.parametrize(
    "wrong",
    [
        {"allow": ["no-such-rule"]},
        {"allow": "below-ground"},
        {"strict": "perhaps"},
        {"bounds": {"no_such_bound": 1}},
        {"bounds": {"max_speed_mps": -1, "size_ratio": -1}},
        {"bounds": {"max_speed_mps": "nan", "size_ratio": float("nan")}},
        {"bounds": {"max_speed_mps": 1e12, "size_ratio": 1e12}},
    ],
)
def test_what_no_rule_or_bound_can_be_is_refused_when_it_is_said(what, wrong):
    flow, parameters = FLOWS[what]
    flow.validate_parameters(parameters)
    with pytest.raises(ParameterTypeError):
        flow.validate_parameters({**parameters, **wrong})


def test_bounds_that_are_said_reach_the_reader():
    changed = PassportSettings.changed
    assert changed(tuple(bound_options(FlightBounds()))) == changed(())
    options = bound_options(FlightBounds(max_speed_mps=40, max_clock_steps=3))
    assert changed(tuple(options)) == changed(("max_speed_mps=40", "max_clock_steps=3"))


def read(catalog: str, folder, allow=(), strict=False, bounds=()) -> list[dict]:
    """What the flow's task makes of a folder, and what of it people read."""
    options = log_options(allow, strict, bounds)
    files = fleet.ingest_demonstrations(open_catalog(catalog), [folder], 1, options=options)
    return [{**vars(one), "findings": "; ".join(one.findings)} for one in files]


@pytest.mark.ci
def test_a_flow_overrules_and_refuses_as_the_command_does(tmp_path):
    cube, catalog = member("cube-v1").structure, str(tmp_path / "catalog")
    open_catalog(catalog).add_structures([cube])
    write_log(tmp_path / "flight.mcap", fly(cube, "sides"), cube)
    slow = ["max_speed_mps=0.1", "odd_speed_mps=0.1"]
    (refused,) = read(catalog, tmp_path, (), False, slow)
    assert refused["status"] == "failed" and "--allow too-fast" in refused["reason"]
    (taken,) = read(catalog, tmp_path, ("too-fast",), False, slow)
    assert taken["status"] == "added" and "[overruled]" in taken["findings"]
    (again,) = read(catalog, tmp_path)
    assert again["status"] == "unchanged"  # what was overruled by a person stays so
    (row,) = open_catalog(catalog).demonstrations().to_dict("records")
    assert (row["overruled"], row["verdict"]) == ("too-fast", "overruled")


@pytest.mark.slow
def test_what_was_taken_with_a_warning_is_refused_where_that_is_asked(tmp_path):
    cube, catalog = member("cube-v1").structure, str(tmp_path / "catalog")
    open_catalog(catalog).add_structures([cube])
    write_log(tmp_path / "flight.mcap", fly(cube, "sides"), cube)
    (taken,) = read(catalog, tmp_path, (), False, ["odd_speed_mps=0.1"])
    (strict,) = read(catalog, tmp_path, (), True, ["odd_speed_mps=0.1"])
    assert (taken["status"], strict["status"]) == ("added", "failed") and "fast: " in strict["reason"]
