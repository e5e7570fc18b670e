"""What takes long says so, where somebody looks on."""

import io
import sys
import threading
import time

import jax
import pytest

import jaxrod
from jaxrod.core import progress


class _Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(progress, "_AFTER", 0.05)
    monkeypatch.setattr(progress, "_EVERY", 0.02)
    monkeypatch.delenv("JAXROD_PROGRESS", raising=False)


def _shown(monkeypatch, stream, inner=lambda: None):
    monkeypatch.setattr(sys, "stderr", stream)
    with progress.line("plan"):
        progress.say("Ritz(3) by fine steps")
        progress.compiling()
        time.sleep(0.3)
        progress.say("Ritz(4)")
        inner()
        time.sleep(0.3)
    return stream.getvalue()


def test_a_line_on_a_terminal(monkeypatch, impatient):
    text = _shown(monkeypatch, _Terminal())
    assert "plan: Ritz(3) by fine steps (compiling, then running), " in text and "plan: Ritz(4), " in text
    assert text.endswith("\r") and "\n" not in text  # it is gone in the end


def test_none_in_logs_unless_asked(monkeypatch, impatient):
    assert _shown(monkeypatch, io.StringIO()) == ""
    monkeypatch.setenv("JAXROD_PROGRESS", "1")
    assert "Ritz(3)" in _shown(monkeypatch, io.StringIO())
    monkeypatch.setenv("JAXROD_PROGRESS", "0")
    assert _shown(monkeypatch, _Terminal()) == ""
    told = [("", {"progress": True})]  # what `configure` was told counts for more
    monkeypatch.setattr(jaxrod.configuration, "_done", told)
    assert "Ritz(3)" in _shown(monkeypatch, io.StringIO())


def test_one_line_of_verbs_within_another(monkeypatch, impatient):
    def inner():
        with progress.line("equilibrium"):
            time.sleep(0.3)

    text = _shown(monkeypatch, _Terminal(), inner)
    assert "plan" in text and "equilibrium" not in text


def test_each_thread_has_its_own(monkeypatch, impatient):
    def inner():
        other = threading.Thread(target=lambda: (progress.say("of another"), progress.compiling()))
        other.start()
        other.join()

    text = _shown(monkeypatch, _Terminal(), inner)
    assert "Ritz(4), " in text and "another" not in text


def test_no_thread_no_line(monkeypatch, impatient):
    def refused(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refused)
    assert _shown(monkeypatch, _Terminal()) == "" and progress._opened() is None


def test_none_of_what_is_quick(monkeypatch):
    monkeypatch.setattr(sys, "stderr", _Terminal())
    with progress.line("modes"):
        pass
    assert sys.stderr.getvalue() == "" and progress._opened() is None


def test_no_console(monkeypatch):
    closed = io.StringIO()
    closed.close()
    for stream in (None, closed):
        monkeypatch.setattr(sys, "stderr", stream)
        assert not progress.wanted() and not progress.wanted(True)


def test_an_interruption_ends_it(monkeypatch, impatient):
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _shown(monkeypatch, _Terminal(), interrupted)
    assert progress._opened() is None


def test_compiling_is_told_of_a_run(monkeypatch, impatient, scene):
    told = []
    monkeypatch.setattr(progress._Line, "show", lambda self: (self.ended.wait(), told.append(str(self))))
    monkeypatch.setattr(sys, "stderr", _Terminal())
    system = scene(basis=jaxrod.Ritz(2))
    jaxrod.simulate(system, system.state(rate=1.0), ts=jax.numpy.linspace(0.01, 0.02, 7))
    jaxrod.simulate(system, system.state(rate=2.0), ts=jax.numpy.linspace(0.01, 0.02, 7))
    assert told == ["simulate (compiling, then running)", "simulate"]
