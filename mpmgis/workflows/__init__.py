"""One module per verb: reads its inputs, calls the computation, writes its files."""
