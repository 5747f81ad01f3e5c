"""One file per family of schemas: what it reads, and how that becomes a track."""
