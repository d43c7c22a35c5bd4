"""Messages of rclpy built from numpy values, by the same calls as those of rosbags."""

import operator
from array import array
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.node.message_classes import message_class


class RclpyFactory:
    """A `MessageFactory` of rclpy objects."""

    def make(self, type_name: str, /, **fields: Any) -> Any:
        """Return a new message; AttributeError for a field of no such name.

        Arrays of numbers must have the field's dtype (TypeError); they are copied. AssertionError
        for a value of another kind than the field's.
        """
        message = message_class(type_name)(check_fields=True)
        for name, value in fields.items():
            setattr(message, name, _as_field(getattr(message, name), value))
        return message


def _as_field(default: Any, value: Any) -> Any:
    """Return a value as rclpy wants it for a field that has this default.

    Without its checks, rclpy would read an int in a field of floats as if it were one.
    """
    if isinstance(value, np.ndarray) and not isinstance(default, np.ndarray):
        return _as_array(default, value)
    if isinstance(default, bytes):
        return bytes([operator.index(value)])
    if isinstance(default, float):
        return float(value)
    if isinstance(default, int) and not isinstance(default, bool):
        return operator.index(value)
    return value


def _as_array(default: Any, values: npt.NDArray[Any]) -> Any:
    """Return numbers as an `array.array`, where the field holds one; else as a list."""
    if not isinstance(default, array):
        return values.tolist()
    if np.dtype(default.typecode) != values.dtype:
        raise TypeError(f"an array of {values.dtype} for a field of {np.dtype(default.typecode)}")
    filled = array(default.typecode)
    filled.frombytes(values.tobytes())
    return filled
