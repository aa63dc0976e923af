"""One file a verb: path in, path out; wiring only."""
