"""The terms of the optimisation: each a value, and its slope with respect to the flown path."""
