"""What was really flown: a log laid on its plan, what it saw, and the flight that shows what it left out."""
