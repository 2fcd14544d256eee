"""Exceptions of the package, with the sentences of the program."""

from __future__ import annotations


class SpeculaError(Exception):
    """Base of all exceptions that the package raises of its own accord."""


class InvalidInput(SpeculaError, ValueError):
    """A value that a function does not take; the sentence says which, and what to do."""


class Unsupported(SpeculaError, NotImplementedError):
    """A feature that the package does not have."""


class UnsupportedKey(Unsupported, KeyError):
    """An entry of `meta` that only gsplat's own kernels have."""

    def __str__(self) -> str:
        return Unsupported.__str__(self)


class FileError(SpeculaError, OSError):
    """A file that cannot be read or written."""


class DeviceError(SpeculaError, RuntimeError):
    """A failure of the device that computes."""


class TrainingError(SpeculaError, RuntimeError):
    """A training that cannot start, or failed."""
