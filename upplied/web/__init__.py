"""Everything that a person opens in a browser: one application, one login, one guard."""
