"""A hinged door opened from a wrong guess, in physics and over the bus: angle, radius, forces; and what each part of the law is good for."""

from pathlib import Path

import numpy as np
import pytest

from canipulator.outcome import Outcome

from .conftest import Runner, run
