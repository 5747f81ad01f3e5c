"""`upplied transfer --reproduce`: a stored plan made again from its recorded inputs, and compared."""

from __future__ import annotations

from upplied.cli.terminal import errors, opened, say
from upplied.errors import RefusedError


def reproduce(catalog: str, transfer_id: str) -> int:
    """Plan again what a transfer was planned from; 0 when the same bytes come of it, else 1."""
    from dataclasses import replace

    from upplied.catalog import recipe
    from upplied.fleet.required import required_surface
    from upplied.planning.correspondence.memo import no_memo
    from upplied.planning.plan import METHOD_VERSION, plan_transfer
    from upplied.provenance import causes

    store = opened(catalog)
    made_from = recipe(store, store.find_transfer(transfer_id))
    purpose = made_from.row["purpose"] or ""
    if purpose.startswith("gap "):
        remedy = f"plan it again: upplied flights gap {purpose.removeprefix('gap ')}"
        raise RefusedError(f"plan {transfer_id}", "was made from a flight", "", remedy)
    if purpose.startswith(("reshoot ", "campaign ")):
        remedy = f"plan it again: upplied reshoot --on {made_from.row['target_id']}"
        raise RefusedError(f"plan {transfer_id}", "was made from findings", "", remedy)
    with errors.status("planning again"):
        settings = made_from.settings
        zones, untold = required_surface(store, store.cache, made_from.target, settings.required.zones)
        inputs = (made_from.demonstration, made_from.source, made_from.target)
        plan = plan_transfer(*inputs, settings, no_memo, zones, made_from.siblings)
        plan = replace(plan, warnings=(*plan.warnings, *untold))
    different = made_from.differences(plan)
    row = made_from.row
    for doubt in made_from.doubts:
        say(f"note: {doubt}")
    if not different:
        what = f"{row['n_waypoints']} waypoints" if row["status"] == "ok" else row["status"]
        say(f"{transfer_id}: the same again ({what})")
        return 0
    say(f"{transfer_id}: differs in {', '.join(different)}")
    why = causes(row, METHOD_VERSION)
    origin = f"It was planned by method {row['method_version']}, code {row['code_version']}."
    origin += (
        f" Cause: {'; '.join(why)}."
        if why
        else (" Method, sources, libraries and machine are unchanged: please report this as a fault.")
    )
    say(origin)
    return 1
