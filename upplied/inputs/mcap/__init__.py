"""The container of a log and its messages: bounded, salvaged where damaged, decoded to columns."""
