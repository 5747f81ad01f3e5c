"""Plan the inspection of every structure of a kind from one expert's flight."""

__version__ = "0.1.0"
