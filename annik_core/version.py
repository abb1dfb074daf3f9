"""The version of annik, as installed; package.xml defines it."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("annik_ros")
except PackageNotFoundError:  # run from a checkout that was never installed
    VERSION = "0+not.installed"
