"""Numbers that several rooms of the planner share: one for each purpose, wherever it serves. Uses nothing.

What one module alone needs stands there. The documentation has a page of all of them, with the evidence.
"""

# Surfaces and their parts.
FRAGMENT = 0.002  # share of the surface below which a piece or stretch is no part of its own
LEAST_PART = 0.01  # share of the surface from which a part counts when parts are counted, and may be a blade
# Sample spacings up to which samples are neighbours, on one surface or on two that touch: across the diagonal
# of a lattice's cell, on a surface that faces three lattices alike, they lie sqrt(2) 3^(1/4) = 1.86 apart.
TOUCH = 2.0
SAME_FACE = 0.5  # cosine of two normals from which surfaces face the same way: 60 deg
MAJORITY = 0.5  # share above which most of something is so
COMPACT = 0.2  # longest edge over the structure's diagonal, of parts of which there may be others: engines
SLENDER = 4.0  # length over width from which a part may point anywhere: blades
SAME_SIZE = 1.5  # ratio up to which parts of one structure are of one kind: decks 1.3, abutments 1.8
# Two structures.
TOLERANCE = (
    0.05  # of a size: what is less is nothing: no distance, no extent to compare, no side of the middle
)
MOST_RATIO = 3.0  # of extents or areas of parts that may correspond, and by which a path may be stretched
FACING = 0.03  # of the diagonal: what turning a normal by a right angle counts beside distance
CLEARLY_BETTER = 0.8  # share of a misfit, or of the coarseness of a division, up to which another is better
# Demonstrations.
JITTER_M = 0.02  # what no flight means, whether it is noise or not
JITTER = 0.002  # the same as a share of the flight's extent, round small structures
SMOOTH_S = 0.4  # over which what a flight did is averaged, where a moment is asked for
STILL = 0.25  # of the usual speed: slower is a pause
FOVEA = 0.2  # tangent, 11 deg: deviation of the gaze about the middle of the picture
