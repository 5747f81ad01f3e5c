"""The zones that are asked of a structure, as surface that its plans are to show first."""

from __future__ import annotations

from upplied.catalog import Catalog
from upplied.catalog.verbs.required import zones_named
from upplied.planning.correspondence.memo import Memo
from upplied.proof.asking import Asking
from upplied.records import Camera, Structure
from upplied.records.required import RequiredSurface


def required_surface(
    catalog: Catalog, memo: Memo, target: Structure, name: str
) -> tuple[RequiredSurface | None, tuple[str, ...]]:
    """What plans of a structure are to show first, and the zones that cannot be planned for, in words.

    Parameters
    ----------
    catalog : Catalog
    memo : Memo
        Remembers how structures correspond, for zones that are carried.
    target : Structure
    name : str
        Of the zones, as `required.zones` of the settings has it; empty: none.

    Raises
    ------
    CatalogError
        If zones of that name are not known.
    """
    if not name:
        return None, ()
    zones = zones_named(catalog, target.kind, target.structure_id, name)
    known = Camera(), zones, catalog.faces_labelled
    # Where the zones are is asked, not what may be seen of them: what was never scanned plays no part.
    asking = Asking(catalog.structure, memo, target, None, *known)
    return asking.required()
