"""The version, in one place; a test compares package.xml."""

__version__ = "0.1.0"
