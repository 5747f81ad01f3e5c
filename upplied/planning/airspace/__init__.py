"""Where the vehicle may be, and ways round a structure."""
