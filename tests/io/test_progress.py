"""The time that is left, and what long work will take."""

from time import sleep

import pytest
from rich.console import Console

from swarm_mj.io import progress
from swarm_mj.io.progress import Forecast, Remaining, in_words, progress_bars, said_when_late, using_bars


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands until it is put forward."""

    class Clock:
        now = 0.0

    monkeypatch.setattr(progress.time, "perf_counter", lambda: Clock.now)
    return Clock


def test_the_time_left_is_told_where_steps_are_minutes_apart(clock):
    bars = progress_bars(Console(), quiet=True)
    bars.get_time = lambda: clock.now
    task = bars.add_task("work", total=10.0)
    column = Remaining()
    for step in (0, 1, 2):
        bars.update(task, completed=step)
        assert column.render(bars.tasks[0]).plain == ("0:16:00" if step == 2 else "-:--:--")
        clock.now += 120.0
    bars.update(task, completed=10)
    assert column.render(bars.tasks[0]).plain == "0:00:00"


def test_the_time_left_is_not_hours_because_the_first_step_was_compiled(clock):
    bars = progress_bars(Console(), quiet=True)
    bars.get_time = lambda: clock.now
    task, column, told = bars.add_task("work", total=1.0), Remaining(), []
    for second in range(60):  # compiled for 20 s, then 2 % of the work a second
        bars.update(task, completed=max(0.0, 0.001 + 0.02 * (second - 20)))
        told.append(column.render(bars.tasks[0]).plain)
        clock.now += 1.0
    assert set(told[:22]) == {"-:--:--"}
    assert told[22] == "0:00:47" and told[40] == "0:00:29"


def test_what_was_kept_from_before_makes_no_forecast_too_short(clock):
    bars = progress_bars(Console(), quiet=True)
    bars.get_time = lambda: clock.now
    task, column = bars.add_task("work", total=100.0), Remaining()
    for done in (80, 81, 82, 83):
        clock.now += 10.0
        bars.update(task, completed=done)
        told = column.render(bars.tasks[0]).plain
    assert told == "0:02:50"


def test_a_long_piece_of_work_is_foretold_once_by_its_rate(clock):
    told, said = [], []
    forecast = Forecast("the flight", 1000.0, told.append, said.append)
    clock.now = 50.0  # compiled meanwhile: it does not count
    for done in (0.0, 4.0, 6.0, 8.0):
        forecast(done)
        clock.now += 1.0
    assert told == [0.0, 4.0, 6.0, 8.0]
    assert said == ["the flight will take about 6 min"]  # 6 of 1000 in 2 s


def test_what_is_compiled_on_the_way_is_not_foretold(clock):
    said = []
    forecast = Forecast("the flight", 100.0, lambda done: None, said.append)
    for done, took in ((0.0, 30.0), (1.0, 0.1), (2.0, 0.1), (30.0, 3.0), (60.0, 3.0)):
        forecast(done)
        clock.now += took
    assert not said


def test_a_short_piece_of_work_is_not_foretold(clock):
    said = []
    forecast = Forecast("the flight", 100.0, lambda done: None, said.append)
    for done in range(5):
        forecast(10.0 * done)
        clock.now += 1.0
    assert not said


@pytest.mark.parametrize(("seconds", "words"), [(90, "90 s"), (130, "2 min"), (7300, "2 h"), (864000, "10 days")])
def test_times_have_the_unit_that_fits(seconds, words):
    assert in_words(seconds) == words


def test_unasked_bars_appear_on_stderr_only_when_work_takes_long_and_somebody_looks(monkeypatch, capsys):
    def work(late_s, until):
        monkeypatch.setattr(progress, "LATE_S", late_s)
        with using_bars(None) as bars:
            bars.add_task("work", total=1.0)
            while not until(bars):
                sleep(0.01)
        return capsys.readouterr()

    with using_bars(None) as nobody:
        assert nobody is None  # under pytest stderr is no terminal
    monkeypatch.setattr(progress, "is_watched", lambda: True)
    assert work(1e3, lambda bars: True) == ("", "")
    out, err = work(0.0, lambda bars: bars.live.is_started)
    assert out == "" and "work" in err
    with using_bars(False) as none:
        assert none is None


def test_late_words_are_said_once_and_not_of_what_is_soon_over(monkeypatch, capsys):
    monkeypatch.setattr(progress, "is_watched", lambda: True)
    with said_when_late("soon over"):
        pass
    monkeypatch.setattr(progress, "LATE_S", 0.0)
    with said_when_late("compiling"):
        said = ""
        while not said:
            sleep(0.01)
            said = capsys.readouterr().err
    assert said == "compiling\n"
