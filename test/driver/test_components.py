"""Parts that get power in sequence, and lose it in reverse, whatever fails."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DeviceError, HandwaveError
from radar_driver.components import Component, PowerState, Radar

STEPS = ("power_up", "resume", "suspend", "power_down")


class Part(Component):
    """Writes down what is done to it; fails where it is told to."""

    def __init__(self, name, log, faults=()):
        self.name, self._log, self.faults = name, log, set(faults)

    def _do(self, step):
        self._log.append((step, self.name))
        if step in self.faults:
            raise DeviceError(f"{self.name} broke", gone="gone" in self.faults)

    def power_up(self):
        self._do("power_up")

    def power_down(self):
        self._do("power_down")

    def resume(self):
        self._do("resume")

    def suspend(self):
        self._do("suspend")

    def report(self):
        return {"faults": len(self.faults)}


def radar(n, faults=None):
    """Radar of ``n`` parts, faults by number; and what is done to them."""
    log = []
    parts = [Part(f"part{i}", log, (faults or {}).get(i, ())) for i in range(n)]
    return Radar(parts), parts, log


def names(n, backwards=False):
    order = range(n - 1, -1, -1) if backwards else range(n)
    return [f"part{i}" for i in order]


def test_sequence_and_its_reverse():
    """Up and resume in order, suspend and down backwards; every state is told."""
    one, _, log = radar(3)
    assert one.state is PowerState.OFF
    one.power_up()
    assert one.state is PowerState.SUSPENDED
    one.resume()
    assert one.state is PowerState.RUNNING
    one.suspend()
    assert one.state is PowerState.SUSPENDED
    one.power_down()
    assert one.state is PowerState.OFF
    wanted = [("power_up", n) for n in names(3)] + [("resume", n) for n in names(3)]
    wanted += [("suspend", n) for n in names(3, True)] + [("power_down", n) for n in names(3, True)]
    assert log == wanted


def test_a_radar_that_runs_is_suspended_before_it_loses_power():
    """Part by part, backwards."""
    one, _, log = radar(2)
    one.power_up()
    one.resume()
    log.clear()
    one.power_down()
    assert log == [("suspend", "part1"), ("power_down", "part1"), ("suspend", "part0"), ("power_down", "part0")]


def test_doing_things_twice_does_nothing():
    """Steps that are done already are not done again; power-down may always be asked for, and asks every part."""
    one, _, log = radar(2)
    one.resume()
    one.suspend()
    assert log == []
    for step in ("power_up", "resume", "suspend"):
        getattr(one, step)()
        log.clear()
        getattr(one, step)()
        assert log == []
    one.power_down()
    one.power_down()
    assert log == [("power_down", n) for n in names(2, True)] * 2


@given(n=st.integers(1, 6), step=st.sampled_from(["power_up", "resume", "suspend"]), data=st.data(), gone=st.booleans())
def test_a_failure_at_any_step_takes_everything_back(n, step, data, gone):
    """The error names part and step and says whether the device is gone; all parts are powered down, and it works again afterwards."""
    which = data.draw(st.integers(0, n - 1))
    one, parts, log = radar(n, {which: {step, "gone"} if gone else {step}})

    def work():
        one.power_up()
        one.resume()
        one.suspend()

    with pytest.raises(DeviceError, match=rf"part{which} did not {step.replace('_', ' ')}: part{which} broke") as caught:
        work()
    assert caught.value.gone is gone
    assert one.state is PowerState.FAILED
    order = names(n, step == "suspend")
    assert [name for what, name in log if what == step][: order.index(f"part{which}") + 1] == order[: order.index(f"part{which}") + 1]
    down = [name for what, name in log if what == "power_down"]
    assert down == names(n, True)
    report = one.report()
    assert report[f"part{which}.state"] == "failed"
    assert all(report[f"part{i}.state"] == "off" for i in range(n) if i != which)
    # Whatever ran was suspended before it lost power.
    running = set()
    for what, name in log:
        if what == "resume" and not (step == "resume" and name == f"part{which}"):
            running.add(name)
        if what == "suspend":
            running.discard(name)
        if what == "power_down":
            assert name not in running
    parts[which].faults.clear()
    one.power_up()
    one.resume()
    assert one.state is PowerState.RUNNING


@given(n=st.integers(1, 5), broken=st.sets(st.tuples(st.integers(0, 4), st.sampled_from(["suspend", "power_down"]))))
def test_power_down_never_fails(n, broken):
    """However many parts refuse, every other one is suspended and powered down."""
    one, parts, log = radar(n)
    one.power_up()
    one.resume()
    for which, step in broken:
        if which < n:
            parts[which].faults.add(step)
    log.clear()
    one.power_down()
    assert one.state is PowerState.OFF
    assert log == [(step, name) for name in names(n, True) for step in ("suspend", "power_down")]


@given(steps=st.lists(st.sampled_from(STEPS), max_size=12), n=st.integers(1, 4))
def test_any_order_of_requests_keeps_the_rules(steps, n):
    """No part is resumed without power, none loses power while it runs, all share one state."""
    one, _, log = radar(n)
    for step in steps:
        getattr(one, step)()
    state = dict.fromkeys(names(n), "off")
    for what, name in log:
        before = state[name]
        if what == "power_up":
            assert before == "off"
            state[name] = "suspended"
        elif what == "resume":
            assert before == "suspended"
            state[name] = "running"
        elif what == "suspend":
            assert before == "running"
            state[name] = "suspended"
        else:
            assert before != "running"
            state[name] = "off"
    assert len(set(state.values())) == 1
    assert one.state.value == state["part0"]


def test_report_has_every_part():
    """State and the part's own values, by its name."""
    one, _, _ = radar(2, {1: {"resume"}})
    one.power_up()
    assert one.report() == {"part0.state": "suspended", "part0.faults": 0, "part1.state": "suspended", "part1.faults": 1}


def test_parts_need_names_of_their_own():
    """Two of one name could not be told apart in a report; a radar without parts is off."""
    with pytest.raises(ValueError, match="names of their own"):
        Radar([Part("twin", []), Part("twin", [])])
    assert Radar([]).state is PowerState.OFF


def test_errors_of_the_family_become_device_errors():
    """A configuration that a part refuses is told with the part's name; anything else is a fault of the program and passes through."""

    class Odd(Part):
        error: Exception = ConfigError("too many registers")

        def resume(self):
            raise self.error

    log = []
    one = Radar([Part("first", log), Odd("odd", log)])
    one.power_up()
    with pytest.raises(DeviceError, match="odd did not resume: too many registers") as caught:
        one.resume()
    assert isinstance(caught.value, HandwaveError)
    assert not caught.value.gone
    assert log[-1] == ("power_down", "first")
