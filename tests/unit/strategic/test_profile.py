"""The ramp profile covers exactly its length, at bounded speed, without steps in velocity."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.strategic.profile import RampProfile

profiles = st.builds(
    RampProfile,
    length=st.floats(-10.0, 10.0).filter(lambda x: abs(x) > 1e-4),
    speed=st.floats(0.01, 2.0),
    ramp_s=st.floats(0.05, 3.0),
)


@given(profiles)
def test_covers_exactly_its_length(profile: RampProfile) -> None:
    assert profile.position(0.0) == 0.0
    assert profile.position(profile.duration_s) == pytest.approx(profile.length, rel=1e-12)
    assert profile.position(profile.duration_s + 9.0) == profile.position(profile.duration_s)


@given(profiles)
def test_sampled_mean_velocities_add_up_to_the_length(profile: RampProfile) -> None:
    samples = int(profile.duration_s / 0.02) + 2
    total = sum(profile.mean_velocity(0.02 * i, 0.02) * 0.02 for i in range(samples))
    assert total == pytest.approx(profile.length, rel=1e-8)


@given(profiles, st.floats(0.0, 1.0))
def test_speed_and_acceleration_are_bounded(profile: RampProfile, share: float) -> None:
    t, dt = share * profile.duration_s, 1e-4 * profile.ramp_s
    v0, v1 = profile.mean_velocity(t - dt, dt), profile.mean_velocity(t, dt)
    assert abs(v1) <= profile.cruise_speed * (1.0 + 1e-7)
    # smoothstep's steepest slope is 1.5 / ramp
    assert abs(v1 - v0) / dt <= 1.5 * profile.cruise_speed / profile.ramp_s * (1.0 + 1e-3) + 1e-9


def test_no_length_takes_no_time() -> None:
    assert RampProfile(0.0, 0.2, 1.0).duration_s == 0.0
    assert RampProfile(0.0, 0.2, 1.0).position(1.0) == 0.0


@pytest.mark.parametrize(("speed", "ramp"), [(0.0, 1.0), (-1.0, 1.0), (1.0, 0.0)])
def test_speed_and_ramp_must_be_positive(speed: float, ramp: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        RampProfile(1.0, speed, ramp)
