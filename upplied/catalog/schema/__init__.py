"""What is kept: tables and columns, and records as rows."""
