"""What was really flown: a log laid on its plan, what it saw, and the flight that shows what it left out.

Pure: trajectories and surfaces in, records out; the catalog keeps them and `upplied.fleet` reads the logs.
"""
