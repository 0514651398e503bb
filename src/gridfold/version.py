"""The version of this package, from its installed metadata."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("gridfold")
except PackageNotFoundError:  # a source tree that has not been installed
    __version__ = "0.0.0"
