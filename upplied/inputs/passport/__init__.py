"""The passport of a flight: what it is measured to be, and the rules that it keeps or breaks."""
