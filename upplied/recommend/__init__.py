"""Which demonstration fits a structure best, and why, without planning any."""
