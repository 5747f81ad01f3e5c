"""The height of mean sea level above the ellipsoid, by grids of PROJ on this machine; none is fetched."""

from __future__ import annotations

GRIDS = ("us_nga_egm08_25.tif", "us_nga_egm96_15.tif", "egm08_25.gtx", "egm96_15.gtx")
_PIPELINE = (
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
    " +step +proj=vgridshift +grids={} +multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
)


def undulation_m(lat_deg: float, lon_deg: float) -> tuple[float | None, str]:
    """Undulation of the geoid, m (EGM2008, else EGM96), and by which grid; None, and what is missing."""
    try:
        from pyproj import Transformer, network
        from pyproj.exceptions import ProjError
    except ImportError:
        return None, 'pip install "upplied[geoid]", and a grid of PROJ such as us_nga_egm96_15.tif'
    network.set_network_enabled(False)
    for grid in GRIDS:
        try:
            transformer = Transformer.from_pipeline(_PIPELINE.format(grid))
            height = transformer.transform((lon_deg + 180) % 360 - 180, lat_deg, 0.0, errcheck=True)[2]
        except ProjError:  # the grid is not here, or does not reach there
            continue
        return float(height), f"by the grid {grid}"
    return None, f"none of PROJ's grids {', '.join(GRIDS[:2])} is on this machine (projsync --file NAME)"
