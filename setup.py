"""A shim for colcon's ament_python build; all metadata is in pyproject.toml."""

from setuptools import setup

setup(python_requires=">=3.10")
