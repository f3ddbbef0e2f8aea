"""The OpenGL context of this process: one, made at first use, without a window.

An OpenGL context belongs to the thread that made it and does not survive a fork: forked children hang in the driver.
Both are turned into an `ObserverError` here. Other libraries (MuJoCo's renderer) make their own contexts current on the
same thread, so that ours must be made current again before every use: always go through `current_context`.
"""

from __future__ import annotations

import os
import sys
import threading
from dataclasses import dataclass, field
from typing import Any, Final

from swarm_mj.errors import ObserverError

#: Without a display server Linux needs EGL; the sonames, because the unversioned links belong to development packages.
_PLATFORM_SETTINGS: Final[dict[str, Any]] = (
    dict(backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1") if sys.platform == "linux" else {}
)
_INSTALL_HINT: Final = "on Debian or Ubuntu install it with `apt-get install libegl1 libgl1`"


@dataclass(frozen=True)
class ContextOwner:
    """The process and thread that an OpenGL context belongs to."""

    pid: int = field(default_factory=os.getpid)
    thread: int = field(default_factory=threading.get_ident)

    def check(self) -> None:
        """Raise an `ObserverError` in any other process or thread."""
        self.check_process()
        if self.thread != threading.get_ident():
            raise ObserverError(
                "the OpenGL context belongs to another thread of this process: observe and draw from the thread that did "
                "so first, use one process per worker (spawn), or use the raycast observer"
            )

    def check_process(self) -> None:
        """Raise an `ObserverError` in a forked child."""
        if self.pid != os.getpid():
            raise ObserverError(
                f"process {os.getpid()} was forked from {self.pid} after that made its OpenGL context, which a fork "
                "cannot share: start workers with multiprocessing.get_context('spawn'), or use the raycast observer"
            )

    def is_here(self) -> bool:
        """Whether the caller may use the context."""
        return self.pid == os.getpid() and self.thread == threading.get_ident()


class _Slot:
    """The one place where the process keeps its context; OpenGL itself leaves no choice but a global."""

    context: Any = None
    owner: ContextOwner | None = None
    failure: str | None = None
    #: Who made the first context of any kind in this process or in one that it was forked from.
    first: ContextOwner | None = None


def check_fork() -> None:
    """Refuse to make an OpenGL context in a forked child of a process that has made one: the driver would hang.

    Raises:
        ObserverError: This is such a child.
    """
    if _Slot.first is not None:
        _Slot.first.check_process()


def own_context() -> ContextOwner:
    """To be called when an OpenGL context has been made: its owner."""
    owner = ContextOwner()
    _Slot.first = _Slot.first or owner
    return owner


def current_context() -> Any:
    """The process's moderngl context, made at the first call, and current on the calling thread.

    Raises:
        ObserverError: OpenGL cannot be loaded, or the caller is a forked child or another thread.
    """
    check_fork()
    if _Slot.owner is not None:
        _Slot.owner.check()
    if _Slot.context is None:
        if _Slot.failure is None:
            _create()
        if _Slot.failure is not None:
            raise ObserverError(_Slot.failure)
    _Slot.context.__enter__()
    return _Slot.context


def gl_available() -> tuple[bool, str]:
    """Whether face-ID buffers can be drawn here, and the renderer's name or the reason why not.

    Makes the context of this process; do not fork afterwards.
    """
    try:
        return True, str(current_context().info["GL_RENDERER"])
    except ObserverError as error:
        return False, str(error)


def may_release(context: Any) -> bool:
    """Whether GL objects of `context` can be deleted by the caller; elsewhere their process's end frees them."""
    if sys.is_finalizing() or _Slot.owner is None or context is not _Slot.context:
        return False
    return _Slot.owner.is_here()


def _create() -> None:
    try:
        import moderngl

        context = moderngl.create_context(require=330, standalone=True, **_PLATFORM_SETTINGS)
    except Exception as error:  # moderngl raises plain Exception, and each driver its own
        reason = str(error).strip() or type(error).__name__
        _Slot.failure = f"OpenGL 3.3 cannot be loaded ({reason}); {_INSTALL_HINT}, or use the raycast observer"
        return
    _Slot.context, _Slot.owner = context, own_context()
