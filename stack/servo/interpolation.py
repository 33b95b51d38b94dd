"""From cyclic set points to one set point per servo tick: cubic Hermite segments.

A drive learns its target once per SYNC period. Between the targets it follows the cubic that meets both ends in
position and velocity; the velocity at a node is the second-order backward difference of the targets, because the next
target is not known yet. The result passes through every target, is continuous in velocity, and reproduces motions of
constant velocity or constant acceleration exactly.
"""

from __future__ import annotations

from stack.compiled import compiled


@compiled
def node_velocity(target: float, previous: float, older: float, period_s: float) -> float:
    """Velocity at the newest of three targets, `(3 p_k - 4 p_{k-1} + p_{k-2}) / 2T`; exact for parabolas."""
    return (3.0 * target - 4.0 * previous + older) / (2.0 * period_s)


@compiled
def hermite(
    start: float, start_velocity: float, end: float, end_velocity: float, elapsed_s: float, period_s: float
) -> tuple[float, float]:
    """Position and velocity, `elapsed_s` after the start of a segment of length `period_s`.

    Past its end the segment goes on with its end velocity.
    """
    if elapsed_s >= period_s:
        return end + end_velocity * (elapsed_s - period_s), end_velocity
    u = elapsed_s / period_s
    chord = (end - start) / period_s
    curve = start_velocity + end_velocity - 2.0 * chord
    bend = 3.0 * chord - 2.0 * start_velocity - end_velocity
    position = start + elapsed_s * (start_velocity + u * (bend + u * curve))
    velocity = start_velocity + u * (2.0 * bend + 3.0 * u * curve)
    return position, velocity


@compiled
def linear(start: float, end: float, elapsed_s: float, period_s: float) -> float:
    """Straight line from `start` to `end` in `period_s`, constant afterwards."""
    if elapsed_s >= period_s:
        return end
    return start + (end - start) * (elapsed_s / period_s)
