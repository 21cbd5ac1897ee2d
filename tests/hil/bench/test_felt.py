"""What the bench hands on instead of the text of the phone's app is what the host reads in that."""

from hypothesis import given
from hypothesis import strategies as st

from hil.bench.felt import heard
from host.sensors.gyro import parsed
from sim_plant.gyro import Gyro, Sample, sensors_json

AXIS = st.one_of(
    st.floats(-40.0, 40.0),
    st.floats(-2e-6, 2e-6),
    st.integers(-(10**8), 10**8).map(lambda halves: halves / 2e6),
)
XYZ = st.tuples(AXIS, AXIS, AXIS)
SAMPLE = st.builds(Sample, st.floats(0.0, 1e5).map(Gyro.clock_s), XYZ, XYZ)


@given(st.lists(SAMPLE, max_size=5))
def test_the_host_hears_what_it_would_read_in_the_apps_answer(samples: list[Sample]) -> None:
    assert repr(heard(samples)) == repr(parsed(sensors_json(samples)))
