"""Packages that are used where they are installed."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import MissingPackage


def optional(module: str, purpose: str, package: str = "") -> Any:
    """A module, or an error that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackage(package or module.split(".")[0], purpose) from error


def numpy(purpose: str) -> Any:
    """numpy."""
    return optional("numpy", purpose)
