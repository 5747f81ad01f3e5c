"""Settings say what is wrong with them, and their hash is theirs alone."""

from dataclasses import fields

import pytest

from upplied.config import PRESETS, settings_for
from upplied.errors import SettingsError


@pytest.mark.parametrize("preset", PRESETS)
def test_every_default_passes_its_own_check(preset):
    settings = settings_for(preset)
    stages = [item.name for item in fields(settings) if item.name != "preset"]
    again = settings_for(preset, **{stage: vars(getattr(settings, stage)) for stage in stages})
    assert again == settings and again.sha256 == settings.sha256


@pytest.mark.parametrize(
    ("stage", "values", "hint"),
    [
        ("rout", {"clearance_m": 2.0}, "route"),
        ("route", {"clearance": 2.0}, "clearance_m"),
        ("route", {"clearance_m": -1.0}, "0 to 1000"),
        ("route", {"clearance_m": "2"}, "a number"),
        ("route", {"clearance_m": float("nan")}, "a number"),
        ("route", {"enforce": 1}, "true or false"),
        ("clouds", {"voxel_points": 700.5}, "a whole number"),
        ("transfer", {"standoff": "same"}, "'kept'"),
        ("correspondence", {"counterparts": ["engine"]}, "pairs"),
        ("retime", {"min_gimbal_pitch_deg": 40.0}, "above retime.max_gimbal_pitch_deg, which is 30"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(stage, values, hint):
    with pytest.raises(SettingsError, match=hint):
        settings_for("recommended", **{stage: values})


def test_an_unknown_preset_lists_the_known_ones():
    with pytest.raises(SettingsError, match="paper, recommended, baseline"):
        settings_for("best")


def test_other_settings_have_another_hash():
    hashes = {settings_for(preset).sha256 for preset in PRESETS}
    hashes.add(settings_for("recommended", route={"clearance_m": 3.0}).sha256)
    assert len(hashes) == 4
