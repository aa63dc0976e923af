"""The command line: parser, progress, printed text."""
