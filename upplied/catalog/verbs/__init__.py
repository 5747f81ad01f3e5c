"""What is done with it: add, query, exchange, maintain, verify."""
