"""How good a plan is: the same measures for every preset."""
