"""Ranking of demonstrations for a structure, without planning."""
