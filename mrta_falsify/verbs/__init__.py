"""One room per command, callable from Python; the command line only parses and prints."""
