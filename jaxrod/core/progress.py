"""What takes longer than two seconds says so: one line, on a terminal or in a notebook.  Knows no rods."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

from tqdm import tqdm

from .. import configuration

_AFTER, _EVERY = 2.0, 0.5  # s
_here = threading.local()  # the `line` that is open in a thread


class _Line:
    """A verb that is under way: what it does, and whether its program is being compiled."""

    def __init__(self, verb: str):
        self.verb, self.stage, self.compiling = verb, "", False
        self.began, self.ended = time.monotonic(), threading.Event()

    def __str__(self):
        said = f"{self.verb}: {self.stage}" if self.stage else self.verb
        return f"{said} (compiling, then running)" if self.compiling else said

    def show(self) -> None:
        """In a thread of its own, as compiling lets no other Python go on."""
        if self.ended.wait(_AFTER):
            return
        with tqdm(desc=str(self), bar_format="{desc}, {elapsed}", leave=False) as bar:
            bar.start_t -= _AFTER
            while not self.ended.wait(_EVERY):
                bar.set_description_str(str(self))


def wanted(progress: bool | None = None) -> bool:
    """Whether it is to be shown: as asked here, else by `configure`, else on a terminal and in a notebook alone."""
    if progress is None:
        progress = configuration.progress()
    if progress is None:
        progress = "ipykernel" in sys.modules or (_open_stream() and sys.stderr.isatty())
    return bool(progress) and _open_stream()


def _open_stream() -> bool:
    """Whether there is where to write: a program without a console has none."""
    return hasattr(sys.stderr, "isatty") and not getattr(sys.stderr, "closed", False)


@contextlib.contextmanager
def line(verb: str, progress: bool | None = None) -> Iterator[None]:
    """While it is open a line tells what `verb` does, if that is `wanted`; within another line it adds none."""
    if _opened() is not None or not wanted(progress):
        yield
        return
    here = _Line(verb)
    thread = threading.Thread(target=here.show, daemon=True)
    try:
        with contextlib.suppress(RuntimeError):  # where no thread can be had there is no line
            thread.start()
        _here.line = here
        yield
    finally:
        _here.line = None
        here.ended.set()
        if thread.is_alive():
            thread.join(1.0)


def say(stage: str) -> None:
    """What the open line, if there is one, is doing now."""
    here = _opened()
    if here is not None:
        here.stage, here.compiling = stage, False


def compiling() -> None:
    """To be called while a program is traced: until something else is said, it is being compiled, and then it runs."""
    here = _opened()
    if here is not None:
        here.compiling = True


def _opened() -> _Line | None:
    return getattr(_here, "line", None)
