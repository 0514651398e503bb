"""The command ``gridfold``."""
