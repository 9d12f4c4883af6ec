"""Robots, one file per family, and the contract that they fulfil."""
